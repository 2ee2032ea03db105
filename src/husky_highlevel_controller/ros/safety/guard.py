"""Shared by the stop nodes: the latest velocity, and one call of the start/stop service for each danger.

Once stopped, the controller stands still until it is started again. The guard detects that by the robot's
motion, and is then ready to stop it again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, Optional

import rospy
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool

from husky_highlevel_controller.controller.safety import Latch, advance_latch, is_moving
from husky_highlevel_controller.datatypes import Twist2D
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.ros import conversions

REPORT_PERIOD = 5.0  # [s] between two complaints about the same
FRESH = 0.5  # [s], an older velocity says nothing about now


@dataclass(frozen=True)
class ServiceConfig:
    """Service that is called in danger."""

    start_stop_service_name: str = field(
        default="husky_highlevel_controller/start_stop",
        metadata={"help": "std_srvs/SetBool service that stops the controller"},
    )


class Guard:
    """Stops the controller, once for each danger."""

    def __init__(
        self,
        config: ServiceConfig,
        robot: Robot,
        on_odometry: Optional[Callable[[float, Twist2D], None]] = None,
    ) -> None:
        """Subscribe to odometry.

        Args:
            config: the service to call.
            robot: whose odometry it is.
            on_odometry: also called with stamp [s] and twist of every odometry message.
        """
        self._service = rospy.resolve_name(config.start_stop_service_name)
        self._latch = Latch()
        self._odometry: Optional[Odometry] = None
        self._pass_on = on_odometry
        rospy.Subscriber(robot.topics.odometry, Odometry, self._on_odometry, queue_size=1, tcp_nodelay=True)

    def _on_odometry(self, msg: Odometry) -> None:
        self._odometry = msg
        if self._pass_on is not None:
            self._pass_on(msg.header.stamp.to_sec(), conversions.twist_from_msg(msg.twist.twist))

    def run(self) -> None:
        """Wait for the service, then work until the node is shut down."""
        while not rospy.is_shutdown():
            try:
                rospy.wait_for_service(self._service, timeout=REPORT_PERIOD)
            except rospy.ROSException:
                if not rospy.is_shutdown():
                    rospy.logwarn(
                        f"no service {self._service} to stop the controller with; is it running, and is "
                        f"{rospy.get_name()}/start_stop_service_name its start_stop_service_name?"
                    )
            else:
                rospy.loginfo(f"on guard; in danger {self._service} is called")
                rospy.spin()

    def twist(self, stamp: float) -> Optional[Twist2D]:
        """Velocity at a time [s]; None where odometry is missing or not fresh."""
        msg = self._odometry
        if msg is None or abs(stamp - msg.header.stamp.to_sec()) > FRESH:
            return None
        return conversions.twist_from_msg(msg.twist.twist)

    def judge(self, stamp: float, danger: Optional[str]) -> None:
        """Stop the controller if there is a danger, put in words, and it was not stopped for it already."""
        twist = self.twist(stamp)
        moving = twist is None or is_moving(twist)
        latch, stop = advance_latch(self._latch, danger is not None, moving, stamp)
        if stop and danger is not None and not self._stop(danger):
            return  # the latch stays as it was: the next message tries again
        if self._latch.tripped_at is not None and latch.tripped_at is None:
            rospy.loginfo("the robot moves again: on guard again")
        self._latch = latch

    def _stop(self, danger: str) -> bool:
        failure = self._call()
        if failure is not None:
            rospy.logwarn_throttle(
                REPORT_PERIOD, f"{danger}, but {self._service} did not stop the controller: {failure}"
            )
            return False
        rospy.logwarn(
            f"{danger}: stopped the controller. When the way is free: rosservice call {self._service} true"
        )
        return True

    def _call(self) -> Optional[str]:
        """Call the service; what went wrong, or None."""
        try:
            answer = rospy.ServiceProxy(self._service, SetBool)(False)
        except rospy.ServiceException as error:
            return str(error)
        return None if answer.success else f"it answered '{answer.message}'"
