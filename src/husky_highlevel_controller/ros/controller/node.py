"""The pillar controller as a ROS node; docs/reference.md lists its topics, services and parameters."""

from __future__ import annotations

import logging
import threading
from collections import deque
from dataclasses import dataclass
from math import inf, isfinite, isnan
from typing import Any, Deque, Optional, Tuple

import rosgraph.names
import rospy
import tf2_ros
from geometry_msgs.msg import Twist
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from husky_highlevel_controller.config import ConfigError, number, read_config, setting
from husky_highlevel_controller.controller.behaviour import (
    ControllerState,
    ControlOutput,
    Observation,
    State,
    decide,
)
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.obedience import Obedience
from husky_highlevel_controller.controller.pillar_detection import Pillar, PillarConfig
from husky_highlevel_controller.controller.sensor_faults import clock_sentence
from husky_highlevel_controller.datatypes import STOP, Scan, Twist2D
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.controller.diagnostics import Diagnostics, Health
from husky_highlevel_controller.ros.controller.disobedience import Disobedience
from husky_highlevel_controller.ros.controller.display import BASE, ODOM, Display, how_to_drive_again
from husky_highlevel_controller.ros.controller.reconfigure import ReconfigureServer
from husky_highlevel_controller.ros.controller.scan_absence import ScanAbsence
from husky_highlevel_controller.ros.controller.scan_placement import Listener, ScanPlacement
from husky_highlevel_controller.ros.node import contained, parameters_and_robot, publish, run_node
from husky_highlevel_controller.ros.registration import LOST, RegistrationWatch

# rospy's logger; its level is checked before a DEBUG line is formatted, because formatting takes time
LOG = logging.getLogger("rosout")
REPORT_PERIOD = 5.0  # [s] time between two warnings of the same kind
# [s] time between two lines of the log with the smallest range, by the stamps of the scans
RANGE_PERIOD = 1.0
RATE_SCANS = 50  # number of scans from which the rate of the scans is measured
POLL_PERIOD = 0.1  # [s] longest wall time between two rounds of the node's main loop


@dataclass(frozen=True)
class ScanTopicConfig:
    """Topic and queue of the scans."""

    scan_topic_name: str = setting("topic of the lidar's scans", default=f"/{load_robot().topics.scan}")
    scan_topic_queue_size: int = number(
        1, 1000, "maximum number of scans that wait while the node is busy; 1 keeps the newest", default=1
    )


@dataclass(frozen=True)
class StartStopConfig:
    """Start/stop service, and whether the robot drives from the start."""

    start_stop_service_name: str = setting(
        "service that starts (true) and stops (false) the robot", default="~start_stop"
    )
    start_enabled: bool = setting("drive from the start; if false, wait for the service", default=True)


class ControllerNode:
    """Answers every scan with a velocity command, and publishes markers, log and diagnostics."""

    def __init__(self, tunable: Any) -> None:
        """Read the parameters, and set up topics, service and placement of scans.

        `tunable` is the module that catkin makes from cfg/Controller.cfg.

        Raises:
            ConfigError: a parameter is not valid.
        """
        # parameters
        namespace = rospy.get_name() + "/"
        values, robot = parameters_and_robot()
        topic_config, start_stop, control, detector_config = read_config(
            values, namespace, ScanTopicConfig, StartStopConfig, ControlConfig, PillarConfig
        )
        service = start_stop.start_stop_service_name
        if not rosgraph.names.is_legal_name(service):
            raise ConfigError(
                f"{namespace}start_stop_service_name = {service!r} is not a valid ROS name; use '~start_stop'"
            )

        # memory of the controller
        self._enabled = start_stop.start_enabled  # true while the robot may drive
        self._controller_state = ControllerState()  # memory of `decide`, which computes the commands
        # Lock that is held during a decision and during a stop, so that no command follows the zero command
        # of a stop. It is an RLock, because the signal that ends the node may interrupt a decision of the
        # main thread.
        self._decision_lock = threading.RLock()
        self._has_ended = False  # true when the shutdown has begun; then all commands are zero
        self._last_announced: Optional[bool] = None  # last announcement on ~arrived; None before the first
        # [m] a warning is logged if the lidar cannot measure a distance as small as the stop distance; this
        # is the stop distance of the last warning, or 0 before the first one
        self._blind_stop_distance = 0.0
        self._range_logged_at = -inf  # [s] stamp of the scan whose smallest range was logged last

        # data for the status on /diagnostics
        self._pillar_status = "unknown"  # state of the pillar: "seen", "remembered" or "unknown"
        self._reason = ""  # reason of the last command
        self._scan_stamps: Deque[float] = deque(maxlen=RATE_SCANS)  # [s] stamps of the last answered scans
        self._scan_frame = ""  # frame of the last scan
        self._scan_fault = ""  # sentence on the fault of the last scan; empty if the scan was valid
        self._scan_stamp = 0.0  # [s] stamp of the last scan
        self._scan_age = 0.0  # [s] age of the last scan when it came
        self._tf_stamp = 0.0  # [s] stamp of the last new transform odom -> base_link
        self._scan_time: Optional[float] = None  # [s] ROS time when the last scan came
        # [s] ROS time of the last new transform odom -> base_link; None if TF has no such transform
        self._tf_time: Optional[float] = None

        # commands; reasons why the robot does not follow them, and why no scans come
        self._command_publisher = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self._last_command = STOP
        self._obedience = Obedience()  # compares the commands with the motion of the robot
        self._disobedience = Disobedience(robot, self._command_publisher)  # finds why the robot does not obey
        self._disobedience_reason = ""  # sentence on why the robot does not obey; empty while it obeys
        self._scan_absence = ScanAbsence(rospy.resolve_name(topic_config.scan_topic_name))
        self._absence_reason = ""  # sentence on why no scans come; empty if they come

        # other outputs
        self._arrived_publisher = rospy.Publisher("~arrived", Bool, queue_size=1, latch=True)
        self._display = Display(robot)
        # lets users change gains while the node runs
        self._tuning = ReconfigureServer(tunable, control, detector_config)
        self._diagnostics = Diagnostics(self._examine)
        # makes the robot stand still if the ROS master no longer knows this node, because a program that is
        # started later could not find the node, and so could not stop the robot
        self._registration = RegistrationWatch(self._stand_still)

        # must come last, because the callbacks use everything that is set above
        self._connect_inputs(topic_config, service, robot.footprint)

    def _connect_inputs(self, config: ScanTopicConfig, service: str, footprint: Footprint) -> None:
        """Subscribe to transforms and scans, offer the start/stop service, and log the topic of the scans."""
        transforms = tf2_ros.Buffer()
        # holds a scan until TF has the pose of its stamp, and then calls `_answer`
        self._placement = ScanPlacement(transforms, self._answer, footprint)
        # fills `transforms`, and calls the placement after each message, because a scan may wait for the pose
        # in this message
        self._listener = Listener(transforms, self._placement)
        rospy.on_shutdown(self._end)
        rospy.Service(service, SetBool, self._on_start_stop)
        rospy.Subscriber(
            config.scan_topic_name,
            numpy_msg(LaserScan),
            self._on_scan,
            queue_size=config.scan_topic_queue_size,
            tcp_nodelay=True,
        )
        rospy.loginfo("waiting for scans on %s", rospy.resolve_name(config.scan_topic_name))
        if not self._enabled:
            rospy.loginfo(
                "standing still until started; start with rosservice call %s true",
                rospy.resolve_name(service),
            )

    def run(self) -> None:
        """Do the work that no message triggers, every POLL_PERIOD, until the node is shut down.

        Commands are sent in callbacks, when a scan or its transform comes. This loop notices what does not
        come, such as scans, transforms or motion, and keeps the status and the markers up to date.
        """
        self._registration.start()
        while not rospy.is_shutdown():
            with contained("placing a scan"):
                self._placement.update()  # a scan whose transform is overdue is used without waiting longer
            with contained("comparing commands with motion"):
                self._notice_disobedience()
            with contained("asking why no scans come"):
                self._notice_absence()
            with contained("the status on /diagnostics"):
                # if the ROS master no longer knows this node, RegistrationWatch publishes the status instead
                if not self._registration.is_lost:
                    self._diagnostics.update()
            with contained("showing the last scan"):
                self._display.update()
            self._diagnostics.wait(POLL_PERIOD)  # ends early if the status has changed

    def _notice_disobedience(self) -> None:
        """Log, once each time it begins, why the robot does not move as commanded, and keep the reason.

        The reason is a part of the status on /diagnostics.
        """
        if self._obedience.obeys:
            self._disobedience_reason = ""
        elif not self._disobedience_reason:  # a known reason has been logged already
            # [s] time for which the robot has not moved although it was commanded to move
            disobeyed_for = self._obedience.stamp - self._obedience.since
            self._disobedience_reason = self._disobedience.sentence(self._last_command, disobeyed_for)
            rospy.logwarn(self._disobedience_reason)
            self._diagnostics.hasten()

    def _notice_absence(self) -> None:
        """Log why no scans come when the reason changes, and keep it for the status."""
        absence = self._scan_absence.update(rospy.get_time(), self._scan_time)
        if absence != self._absence_reason:
            self._absence_reason = absence
            self._diagnostics.hasten()
            if absence:
                rospy.logwarn(absence)

    def _stop(self) -> None:
        """Send one command of zero; the next scan may start the robot again."""
        self._command(STOP)

    def _end(self) -> None:
        """Stop the robot at the shutdown of the node; rospy may still deliver scans afterwards."""
        with self._decision_lock:
            self._has_ended = True  # makes `_command` send zero for any scan
            self._stop()

    def _stand_still(self) -> None:
        """Send one command of zero, but not in the middle of a decision; `RegistrationWatch` calls this."""
        with self._decision_lock:
            self._stop()

    def _command(self, twist: Twist2D) -> None:
        """Publish a velocity command; zero if the command is not finite, or if the node has ended."""
        if not (isfinite(twist.linear) and isfinite(twist.angular)):
            rospy.logwarn_throttle(
                REPORT_PERIOD, f"standing still: the command {twist} is not finite and was not sent"
            )
            twist = STOP
        if self._has_ended:
            twist = STOP
        publish(self._command_publisher, conversions.twist_to_msg(twist))

    def _on_start_stop(self, request: SetBoolRequest) -> SetBoolResponse:
        """Start or stop driving, as the service requests. A stop sends a zero command before it returns.

        A node that has lost its registration at the master refuses to start.
        """
        if request.data and self._registration.is_lost:
            return SetBoolResponse(False, LOST)
        with self._decision_lock:
            already = self._enabled is request.data
            self._enabled = request.data
            if not request.data:
                self._stop()
        self._diagnostics.hasten()
        now = "driving to the pillar" if request.data else "standing still until started"
        message = f"{'already ' if already else ''}{now}"
        rospy.loginfo("%s: %s", "started" if request.data else "stopped", message)
        return SetBoolResponse(True, message)

    def _on_scan(self, msg: LaserScan) -> None:
        """Keep a scan until its transforms have come, and then give the observation to `_answer`.

        A scan that is not valid stops the robot, and scans that still wait are dropped.
        """
        self._scan_time, self._scan_stamp = rospy.get_time(), msg.header.stamp.to_sec()
        self._scan_age = self._scan_time - self._scan_stamp
        try:
            scan = conversions.scan_from_msg(msg)
        except conversions.ScanError as error:
            self._scan_fault = str(error)
            self._placement.discard()
            self._stop()
            rospy.logwarn_throttle(REPORT_PERIOD, f"standing still: {error}; check the driver of the lidar")
            return
        self._scan_frame, self._scan_fault = scan.frame, ""
        self._placement.add(scan, msg.header.stamp)

    def _answer(self, observation: Observation) -> None:
        """Answer one scan with a velocity command, then log and show the answer.

        `ScanPlacement` calls this in one thread at a time. If the decision raises an error, the robot stops,
        and the caller gets the error.

        Args:
            observation: the scan, and the poses of lidar and robot at its stamp.
        """
        # Another thread may stop the robot at any time, and then sends a zero command. Because of the lock, a
        # command that was decided before the stop is never sent after the zero command.
        with self._decision_lock:
            control, detector_config = self._tuning.records
            before = self._controller_state
            # a node that the ROS master has lost must not drive, because no new program can stop it
            enabled = self._enabled and not self._registration.is_lost
            try:
                self._controller_state, output = decide(
                    before, observation, enabled, control, detector_config
                )
            except Exception:  # the caller logs the error
                self._stop()
                raise
            self._command(output.twist)
        self._remember_command(observation, output.twist, control.stop_distance)
        if output.state is not before.state:
            self._diagnostics.hasten()
        self._scan_stamps.append(observation.scan.stamp)
        self._log(observation, before, output, control)
        if output.at_pillar is not self._last_announced:
            publish(self._arrived_publisher, Bool(output.at_pillar))
        self._last_announced = output.at_pillar
        self._display.show(observation, output, control.stop_distance, detector_config.pillar_height)

    def _remember_command(self, observation: Observation, twist: Twist2D, stop_distance: float) -> None:
        """Remember a command, so that `_notice_disobedience` can compare the commands with the motion.

        With stop_distance 0, the robot pushes the pillar. Then it may stand still although it is commanded to
        drive. This is not disobedience, so zero is remembered in place of the command.
        """
        self._last_command = STOP if stop_distance == 0.0 else twist
        self._obedience = self._obedience.after(
            observation.scan.stamp, observation.base_in_odom, self._last_command
        )

    def _log(
        self, observation: Observation, before: ControllerState, output: ControlOutput, control: ControlConfig
    ) -> None:
        """Log the answer to a scan, and keep its reason and the state of the pillar for /diagnostics.

        - A warning is logged if the clocks of lidar and odometry differ, or if the stop distance is too small
          for the lidar to measure.
        - Each scan is logged at DEBUG level.
        - A change of the state is logged at INFO level, or at WARN level if the robot must wait.
        - The smallest range is logged at INFO level every RANGE_PERIOD. It is the first number of its line,
          because the exercise sheet asks for it.

        Args:
            observation: the scan, and the poses at its stamp.
            before: state of the controller before the scan.
            output: answer to the scan.
            control: gains and limits of the answer.
        """
        scan, pillar, state = observation.scan, output.pillar, output.state
        if observation.ahead_of_odometry > 0.0:  # the clocks of lidar and odometry differ
            rospy.logwarn_throttle(
                REPORT_PERIOD, clock_sentence("scans are", observation.ahead_of_odometry, "odometry")
            )
        self._warn_of_blind_stop(control.stop_distance, scan.range_min)
        self._pillar_status = _pillar_status(output)
        if LOG.isEnabledFor(logging.DEBUG):
            twist = output.twist
            rospy.logdebug(
                f"scan {scan.stamp:.2f}: {state.value}, {twist.linear:.2f} m/s, {twist.angular:.2f} rad/s; "
                f"{_scan_summary(scan, pillar)}; {output.reason}"
            )
        # true if the state of the controller or the stage of its search has changed
        has_new_stage = _stage(self._controller_state) != _stage(before)
        # a robot that waits is logged again if the reason for its waiting has changed
        has_new_reason = state is State.WAITING and output.reason != self._reason
        self._reason = output.reason
        if has_new_stage or has_new_reason:
            self._log_change(observation, before, output, control)
        self._log_smallest_range(scan, output)

    def _log_smallest_range(self, scan: Scan, output: ControlOutput) -> None:
        """Log the smallest range of a scan, and the answer to the scan, if RANGE_PERIOD is over."""
        # the difference is negative after a restart of the simulator; then the smallest range is logged, too
        if 0.0 <= scan.stamp - self._range_logged_at < RANGE_PERIOD:
            return
        self._range_logged_at = scan.stamp
        rospy.loginfo(
            f"{_smallest_range(scan)}; {output.state.value}{_to_go(output)}, "
            f"commanding {output.twist.linear:.2f} m/s, {output.twist.angular:.2f} rad/s"
        )

    def _warn_of_blind_stop(self, stop_distance: float, range_min: float) -> None:
        """Warn, once for each stop distance, if the lidar cannot measure so small a distance to the pillar.

        Args:
            stop_distance: distance from the lidar to the pillar's surface at the stop [m].
            range_min: smallest range that the lidar measures [m].
        """
        # with stop_distance 0 there is no warning, because the robot drives on until it touches the pillar,
        # also if it no longer sees the pillar
        if 0.0 < stop_distance < range_min and stop_distance != self._blind_stop_distance:
            rospy.logwarn(
                f"stop_distance = {stop_distance:g} m, but the lidar measures no range below {range_min:g} m "
                "(range_min), so the robot loses the pillar before it arrives; set stop_distance above "
                f"{range_min:g}"
            )
            self._blind_stop_distance = stop_distance

    def _log_change(
        self, observation: Observation, before: ControllerState, output: ControlOutput, control: ControlConfig
    ) -> None:
        """Log a new state, or a new reason to wait.

        Args:
            observation: the scan, and the poses at its stamp.
            before: state of the controller before the scan.
            output: answer to the scan.
            control: gains and limits of the answer.
        """
        scan, pillar, state = observation.scan, output.pillar, output.state
        if state is State.ARRIVED and pillar is not None and before.at_pillar:
            # the robot was stopped at the pillar and started again, so it has not driven
            rospy.loginfo(f"at the pillar already, {pillar.distance:.3f} m from it")
        elif state is State.ARRIVED and pillar is not None:
            # `started_at` is never None here, because a controller that has arrived was started before; the 0
            # is only for the type checker
            duration = scan.stamp - (self._controller_state.started_at or 0.0)
            seconds = "s" if rospy.rostime.is_wallclock() else "s of simulated time"
            rospy.loginfo(
                f"arrived after {duration:.2f} {seconds}, {pillar.distance:.3f} m from the pillar "
                f"(stop_distance {control.stop_distance:g} m)"
            )
            rospy.loginfo(how_to_drive_again(self._display.viewers, self._disobedience.reset_service))
        elif state is State.DRIVING:
            rospy.loginfo(f"{output.reason}; {_scan_summary(scan, pillar)}{_to_go(output)}")
        elif state is State.SEARCHING:
            rospy.loginfo(output.reason)
        # ScanPlacement itself logs that the lidar's transform is missing
        elif state is State.WAITING and observation.laser_in_base is not None:
            rospy.logwarn(output.reason)

    def _state(self) -> State:
        """Return the state at the last scan, corrected if the start/stop service was called since then."""
        if not self._enabled:
            return State.STOPPED
        state = self._controller_state.state  # read once, because a callback may change it
        # if the state is STOPPED, the robot was started after the last scan, and waits for the next scan
        return State.WAITING if state is State.STOPPED else state

    def _examine(self, paused: bool) -> Health:
        """Return the figures for /diagnostics; `paused` says whether simulated time stands still."""
        now, stamps = rospy.get_time(), list(self._scan_stamps)
        tf_age = self._look_at_odometry(now)
        # [s] time between the first and the last scan in `stamps`
        span = stamps[-1] - stamps[0] if len(stamps) > 1 else 0.0
        state = self._state()
        # `_reason` is the reason of the state at the last scan. If the start/stop service has changed the
        # state since then, the reason of the new state is unknown until the next scan.
        reason = self._reason if state is self._controller_state.state else ""
        return Health(
            paused=paused,
            scan_silence=None if self._scan_time is None else now - self._scan_time,
            scan_age=self._scan_age,
            scan_stamp=self._scan_stamp,
            scan_rate=(len(stamps) - 1) / span if span > 0.0 else None,
            scan_fault=self._scan_fault,
            scan_frame=self._scan_frame,
            has_lidar_transform=self._placement.lookup(BASE, self._scan_frame) is not None,
            tf_silence=None if self._tf_time is None else now - self._tf_time,
            tf_age=tf_age,
            scans_ahead=self._placement.ahead_of_odometry,
            state=state,
            pillar=self._pillar_status,
            reason=reason,
            disobedience=self._disobedience_reason,
            scan_absence=self._absence_reason,
        )

    def _look_at_odometry(self, now: float) -> float:
        """Return the age [s] of the latest transform odom -> base_link; 0 if it is missing or fixed.

        The call also sets `_tf_time`, from which /diagnostics computes how long odometry has been silent.
        `_tf_time` becomes None without a transform, and otherwise the ROS time `now` [s] if the transform is
        fixed or has a new stamp.
        """
        latest = self._placement.lookup(ODOM, BASE)
        if latest is None:
            self._tf_time = None
            return 0.0
        if latest.header.stamp.is_zero():  # a fixed transform is always up to date
            self._tf_time = now
            return 0.0
        stamp = latest.header.stamp.to_sec()
        if stamp != self._tf_stamp:  # a new transform has come since the last call
            self._tf_time, self._tf_stamp = now, stamp
        return now - stamp


def _pillar_status(output: ControlOutput) -> str:
    """Return "seen" if the scan shows the pillar, otherwise whether it is "remembered" or "unknown"."""
    if output.pillar is not None:
        return "seen"
    return "unknown" if output.estimate is None else "remembered"


def _smallest_range(scan: Scan) -> str:
    """Return the smallest valid range of a scan as text for the log."""
    valid = scan.ranges[scan.valid]  # ranges from range_min to range_max, without NaN and inf
    return f"smallest range {valid.min():.3f} m" if len(valid) else "no valid range"


def _to_go(output: ControlOutput) -> str:
    """Return the remaining way as text for the log; empty if the pillar's position is unknown."""
    return "" if isnan(output.distance_error) else f", {output.distance_error:.2f} m to go"


def _scan_summary(scan: Scan, pillar: Optional[Pillar]) -> str:
    """Return the smallest range of a scan, the pillar if it was found, and the frame, as text for the log."""
    summary = _smallest_range(scan)
    if pillar is not None:
        summary += f", pillar at x {pillar.x:.3f} m, y {pillar.y:.3f} m, angle {pillar.bearing:.3f} rad"
    return f"{summary} in {scan.frame}"


def _stage(controller_state: ControllerState) -> Tuple[State, bool]:
    """Return the state, and whether a search has begun to drive; `_log` logs when one of the two changes.

    A search begins with a full turn on the spot. Then the robot drives along the straight legs of a spiral.
    """
    search_drives = controller_state.search is not None and controller_state.search.leg > 0
    return controller_state.state, search_drives


def main() -> None:
    """Run the node."""
    # imported only here, because this module exists only in a built workspace, and tests run without one
    from husky_highlevel_controller.cfg import ControllerConfig

    run_node("husky_highlevel_controller", lambda: ControllerNode(ControllerConfig), in_one_thread=True)
