"""Guard: part of both stop nodes that knows the robot's velocity, and stops the controller in danger.

The controller is stopped only once for each danger. Then it stands still until somebody starts it again. The
guard notices the start by the motion of the robot, and is then ready to stop the controller again.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, Optional

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool

from husky_highlevel_controller.config import setting
from husky_highlevel_controller.controller.safety import Latch, advance_latch, is_moving
from husky_highlevel_controller.controller.sensor_faults import ClockOffset, clock_sentence, zero_sentence
from husky_highlevel_controller.datatypes import STOP, Twist2D
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import publish
from husky_highlevel_controller.ros.registration import RegistrationWatch
from husky_highlevel_controller.ros.safety.stop_request import StopRequest

REPORT_PERIOD = 5.0  # [s] time between two warnings of the same kind
MAX_VELOCITY_AGE = 0.5  # [s] a measured velocity counts as the present velocity up to this age


@dataclass(frozen=True)
class ServiceConfig:
    """Service that is called in danger."""

    start_stop_service_name: str = setting(
        "std_srvs/SetBool service that stops the controller", default="husky_highlevel_controller/start_stop"
    )


class Guard:
    """Keeps the latest velocity, and stops the controller once for each danger.

    For a stop, it calls the controller's service, and sends zero commands until the service has answered.
    """

    def __init__(
        self,
        config: ServiceConfig,
        robot: Robot,
        clock_tolerance: float,
        on_velocity: Callable[[float, Twist2D], None] = lambda *_: None,
        queue_size: int = 1,
    ) -> None:
        """Subscribe to odometry, which gives the velocity of the robot.

        Args:
            config: the service to call.
            robot: names of its topics; zero commands have priority over the controller's commands.
            clock_tolerance: largest offset between the clocks of a sensor and odometry that counts as 0 [s].
            on_velocity: function that gets the stamp [s] and the velocity of each message of odometry.
            queue_size: number of odometry messages that wait; with 1, only the newest counts.
        """
        self._latch = Latch()  # memory of the last stop, so that each danger stops the controller only once
        self._odometry: Optional[Odometry] = None  # newest message of odometry; None before the first message
        self._on_velocity = on_velocity  # gets the stamp [s] and the velocity of each message of odometry
        # measures the offset between the sensor's clock and odometry's clock
        self.clocks = ClockOffset(clock_tolerance)
        self._stop_service = rospy.resolve_name(config.start_stop_service_name)
        # `velocity` lists topics of commands, highest priority first; the controller sends on the last topic,
        # so a zero command on the topic before it stops the robot
        self._zero_publisher = rospy.Publisher(robot.topics.velocity[-2], Twist, queue_size=1)
        self._stop_request = StopRequest(self._call, self._command_zero, self._on_failure, self._on_success)
        # sends zero commands if the ROS master no longer knows this node, because then no program that is
        # started later could stop the robot
        self._registration = RegistrationWatch(self._command_zero)
        # subscriber of the sensor that shows dangers, and whether a message has come since the last check
        self._sensor: Optional[rospy.Subscriber] = None
        self._has_sensor_message = threading.Event()
        # Set when the shutdown begins; `rospy.is_shutdown()` becomes true only later. The hook is added here
        # and not in `run`, because rospy never calls a hook that is added after the shutdown has begun.
        self._is_over = threading.Event()
        rospy.on_shutdown(self._is_over.set)
        topic = robot.topics.odometry
        rospy.Subscriber(topic, Odometry, self.on_odometry, queue_size=queue_size, tcp_nodelay=True)

    def watch(self, topic: str, kind: Any, callback: Callable[[Any], None], queue_size: int = 1) -> None:
        """Subscribe to the sensor that shows dangers; `run` warns while none of its messages comes."""

        def receive(msg: Any) -> None:
            """Note that the sensor works, and pass its message on."""
            self._has_sensor_message.set()
            callback(msg)

        self._sensor = rospy.Subscriber(topic, kind, receive, queue_size=queue_size, tcp_nodelay=True)

    def on_odometry(self, msg: Odometry) -> None:
        """Keep a message of odometry, and pass the velocity of the robot on; rospy calls this."""
        stamp = msg.header.stamp.to_sec()
        self._odometry = msg
        # `time_of` compares the stamps of the sensor with the stamps of odometry
        self.clocks.add_reference(stamp)
        self._on_velocity(stamp, conversions.twist_from_msg(msg.twist.twist))

    def time_of(self, stamp: float, who: str, effect: str) -> float:
        """Return the time of a sensor's message by odometry's clock [s].

        The call also measures the offset between the clocks of sensor and odometry (`clocks.seconds`). If the
        clocks agree, the result is the stamp of the message. Otherwise the stamp would not show which
        velocity the robot had, so the result is the stamp of the newest odometry, and a warning is logged.

        Args:
            stamp: stamp of the message [s].
            who: beginning of the warning that the clocks differ, such as "scans are".
            effect: end of this warning, such as "no crash is detected". It says what the guard does as long
                as the clocks differ.
        """
        self.clocks.add(stamp, time.monotonic())
        # the clocks agree; an offset within the tolerance is exactly 0
        if self.clocks.seconds == 0.0 or self._odometry is None:
            return stamp
        if stamp == 0.0:  # the driver of the sensor does not set stamps
            sentence = zero_sentence(who)
        else:
            sentence = clock_sentence(who, self.clocks.seconds, "odometry")
        rospy.logwarn_throttle(REPORT_PERIOD, f"{sentence}; until then {effect}")
        newest: float = self._odometry.header.stamp.to_sec()
        return newest

    def twist(self, stamp: float) -> Optional[Twist2D]:
        """Return the velocity of the robot at a time [s]; None if odometry has none near this time."""
        msg = self._odometry
        if msg is None or abs(stamp - msg.header.stamp.to_sec()) > MAX_VELOCITY_AGE:
            return None
        return conversions.twist_from_msg(msg.twist.twist)

    def judge(self, stamp: float, danger: Optional[str]) -> None:
        """Stop the controller in danger, but only once, until somebody has started the robot again.

        Call this for every message of the sensor, also without a danger, because it notices the start.

        Args:
            stamp: time of the message by odometry's clock [s], see `time_of`.
            danger: text that describes the danger; None if there is no danger.
        """
        twist = self.twist(stamp)
        moving = twist is None or is_moving(twist)  # a robot without odometry may be moving
        # The latch remembers a stop (`tripped_at`) until somebody has started the robot again. As long as it
        # remembers a stop, no danger stops the controller.
        latch, must_stop = advance_latch(self._latch, danger=danger is not None, moving=moving, stamp=stamp)
        if self._latch.tripped_at is not None and latch.tripped_at is None:
            rospy.loginfo("guard active again: the robot moves")
        self._latch = latch
        if must_stop and danger is not None:
            self._stop_request.start(danger)

    def run(self) -> None:
        """Wait for the stop service, then warn while the sensor is silent, until the node is shut down.

        The stops themselves are served in a thread of their own, also while this method waits.
        """
        threading.Thread(target=self._stop_request.run, args=(rospy.is_shutdown,), daemon=True).start()
        self._registration.start()
        while not self._is_over.is_set():
            try:
                rospy.wait_for_service(self._stop_service, timeout=REPORT_PERIOD)
            except rospy.ROSException:
                if not self._is_over.is_set():
                    rospy.logwarn(
                        f"no service {self._stop_service} to stop the controller; check that it is running "
                        f"and that {rospy.get_name()}/start_stop_service_name is its start_stop_service_name"
                    )
            else:
                rospy.loginfo(f"guard active: will call {self._stop_service} on danger")
                self._warn_while_sensor_is_silent()

    def _warn_while_sensor_is_silent(self) -> None:
        """Warn at the end of each REPORT_PERIOD without a message of the sensor, until the shutdown."""
        earlier = rospy.get_time()
        while not self._is_over.wait(REPORT_PERIOD):
            now, has_come = rospy.get_time(), self._has_sensor_message.is_set()
            self._has_sensor_message.clear()
            # sensors are silent in a pause of simulated time, in which `now` does not advance
            if self._sensor is not None and not has_come and now > earlier:
                rospy.logwarn(
                    f"guard inactive: no message on {self._sensor.resolved_name} for {REPORT_PERIOD:g} s; "
                    "check that the sensor is on, and that this is its topic"
                )
            earlier = now

    def _call(self) -> Optional[str]:
        """Stop the controller by its service, and return the reason of a failure, or None."""
        try:
            answer = rospy.ServiceProxy(self._stop_service, SetBool)(False)  # false stops the controller
        except (rospy.ServiceException, rospy.ROSException) as error:
            return str(error)
        return None if answer.success else f"it answered '{answer.message}'"

    def _command_zero(self) -> None:
        """Publish one zero command, with a higher priority than the controller's commands."""
        publish(self._zero_publisher, conversions.twist_to_msg(STOP))

    def _on_failure(self, danger: str, reason: str) -> None:
        """Warn that the service did not stop the controller."""
        rospy.logwarn_throttle(
            REPORT_PERIOD,
            f"{danger}, but {self._stop_service} did not stop the controller: {reason}; "
            f"commanding zero on {self._zero_publisher.resolved_name} until it does",
        )

    def _on_success(self, danger: str) -> None:
        """Log that the controller was stopped, and how to continue."""
        rospy.logwarn(
            f"{danger}: stopped the controller. To continue: rosservice call {self._stop_service} true"
        )
