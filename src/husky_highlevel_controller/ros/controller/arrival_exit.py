"""Node that ends when the robot arrives, so that CI can test a drive: exit code 0, or 1 without an arrival.

This package's controller announces its arrival. With another controller the robot has arrived when it has
driven and then stands near something. Without an arrival, the node logs the reason.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import inf, pi
from typing import Optional

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool

from husky_highlevel_controller.config import number, read_config
from husky_highlevel_controller.controller.behaviour import State
from husky_highlevel_controller.controller.safety import is_moving, nearest_clearance
from husky_highlevel_controller.course import REACHED
from husky_highlevel_controller.datatypes import HuskyError, Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import parameters_and_robot, run_node

CONTROLLER = "husky_highlevel_controller"  # name of the controller's node, in this node's namespace
# [s] wall time between two checks; in a fast simulation this is half a second of simulated time
POLL_PERIOD = 0.02
STANDING_TIME = 1.0  # [s] simulated time for which a robot must stand at an object to count as arrived


@dataclass(frozen=True)
class ExitConfig:
    """Time after which a robot that has not arrived ends the run."""

    deadline: float = number(0.1, 1e6, "time limit of the run, simulated [s]", default=120.0)


class ArrivalExit:
    """Waits for the arrival that the controller announces, or that odometry and scans show."""

    def __init__(self) -> None:
        """Read the deadline, and subscribe to odometry and to the controller's arrival and diagnostics.

        Raises:
            ConfigError: a parameter is not valid.
        """
        values, self._robot = parameters_and_robot()
        # [s] ROS time at which the run begins: 0 in simulated time, otherwise the time of day, which is large
        self._begin = 0.0 if rospy.get_param("/use_sim_time", False) else rospy.get_time()
        (self._config,) = read_config(values, rospy.get_name() + "/", ExitConfig)
        # the clearance needs the pose of the lidar, which comes from the data of the robot, not from TF
        mount = self._robot.lidar_mount
        turn = quat_from_rpy(pi if mount.upside_down else 0.0, 0.0, 0.0)
        self._pose_laser_in_base = Pose((mount.x, 0.0, mount.z), turn)
        self._arrived = False  # true after an arrival, which ends `run`
        self._has_driven = False  # true after the first motion of the robot
        # [s] stamp of odometry at which the robot came to a stop; inf while it moves, and before the first
        # message of odometry
        self._standing_since = inf
        self._clearance = inf  # [m] distance from the footprint to the nearest return of the last scan
        # subscriber of the scans; None until the robot has driven and stopped
        self._scans: Optional[rospy.Subscriber] = None
        # true if the controller drives from its start on, without a call of its start service
        self._starts_enabled = rospy.get_param(f"{CONTROLLER}/start_enabled", True)
        # parts of the controller's last status on /diagnostics; empty before the first status
        self._controller_state, self._controller_message = "", ""
        # a connection of this subscriber shows that the controller announces its arrival
        self._arrived_subscriber = rospy.Subscriber(f"{CONTROLLER}/arrived", Bool, self._on_arrived)
        rospy.Subscriber("/diagnostics", DiagnosticArray, self._on_diagnostics)
        rospy.Subscriber(self._robot.topics.odometry, Odometry, self._on_odometry, queue_size=1)

    def run(self) -> None:
        """Wait until the robot has arrived, or until the node is shut down; both end it with exit code 0.

        Raises:
            HuskyError: the deadline is over, or the controller was stopped on its way; this ends the node
                with exit code 1.
        """
        while not (self._arrived or rospy.is_shutdown()):
            # a controller that does not start enabled is in the state STOPPED until it is started
            if self._starts_enabled and self._controller_state == State.STOPPED.value:
                raise HuskyError(
                    f"stopped on its way after {rospy.get_time() - self._begin:.1f} s of simulated time, "
                    "by a guard or the start/stop service"
                )
            if rospy.get_time() - self._begin > self._config.deadline:
                raise HuskyError(
                    f"no arrival within {self._config.deadline:g} s of simulated time; "
                    f"last: {self._last_activity()}"
                )
            time.sleep(POLL_PERIOD)

    def _last_activity(self) -> str:
        """Return what the controller or the robot did last, for the error that no arrival has come."""
        if self._controller_message:
            return self._controller_message
        is_standing = self._standing_since < inf
        if self._has_driven:
            return "the robot stands" if is_standing else "the robot moves"
        return "the robot has not moved" if is_standing else "no odometry has come"

    def _on_arrived(self, message: Bool) -> None:
        """Keep whether the robot is at the pillar, as the controller announces."""
        self._arrived = message.data

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Keep the controller's state and message from its entry on /diagnostics."""
        for status in message.status:
            if status.name == rospy.resolve_name(CONTROLLER).strip("/"):
                figures = {item.key: item.value for item in status.values}
                self._controller_state = figures.get("state", "")
                self._controller_message = status.message

    def _on_odometry(self, message: Odometry) -> None:
        """Notice the arrival of a robot whose controller does not announce its arrival.

        The robot has arrived if it has driven, has then stood for STANDING_TIME, and is at most REACHED from
        the nearest return of a scan that was made after it had stopped.
        """
        stamp = message.header.stamp.to_sec()
        if is_moving(conversions.twist_from_msg(message.twist.twist)):
            self._has_driven = True
            self._standing_since = inf
            self._clearance = inf  # the clearance that was measured at another place is no longer right
            return
        # `_standing_since` is inf until the first message after a stop
        self._standing_since = min(self._standing_since, stamp)
        stands_after_drive = self._has_driven and stamp - self._standing_since >= STANDING_TIME
        controller_announces = self._arrived_subscriber.get_num_connections() > 0
        if not stands_after_drive or controller_announces:
            return
        # scans are needed only now, so the subscription begins here; without a scan, the clearance is inf
        if self._scans is None:
            self._scans = rospy.Subscriber(self._robot.topics.scan, LaserScan, self._on_scan, queue_size=1)
        if self._clearance <= REACHED and not self._arrived:
            self._arrived = True
            duration = self._standing_since - self._begin
            rospy.loginfo(
                f"arrived after {duration:.2f} s of simulated time: the robot stands, "
                f"{self._clearance:.3f} m from the nearest object"
            )

    def _on_scan(self, message: LaserScan) -> None:
        """Measure the clearance, if the scan was made after the robot had stopped."""
        try:
            scan = conversions.scan_from_msg(message)
        except conversions.ScanError:
            # an invalid scan is ignored; it comes from another node, because the simulator's scans are always
            # valid
            return
        if scan.stamp >= self._standing_since:
            self._clearance = nearest_clearance(scan, self._pose_laser_in_base, self._robot.footprint)


def main() -> None:
    """Run the node."""
    run_node("arrival_exit", ArrivalExit)
