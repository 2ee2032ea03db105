"""Stops the controller before the robot touches anything; docs/reference.md lists topics and parameters."""

from __future__ import annotations

from math import inf, isfinite

import rospy
import tf2_ros
from sensor_msgs.msg import LaserScan

from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.controller.safety import ProximityConfig, too_close
from husky_highlevel_controller.controller.sensor_faults import frame_sentence
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import parameters_and_robot, run_node
from husky_highlevel_controller.ros.safety.guard import REPORT_PERIOD, Guard, ServiceConfig
from husky_highlevel_controller.ros.transforms import lookup_pose

BASE = "base_link"
# [s] The clocks of lidar and odometry may seem to differ by this. If a lidar is slow, its scans come up to
# 0.2 s after their stamps, although its clock is right.
CLOCK_TOLERANCE = 0.3
# [s] missing odometry or transforms cause a warning only if they are missing for this time
STARTING_TIME = 1.0


class ProximityStopNode:
    """Checks every scan, and stops the controller if the robot must brake now to avoid an obstacle."""

    def __init__(self) -> None:
        """Read the parameters, and subscribe to odometry and scans; ConfigError for a wrong parameter."""
        values, self._robot = parameters_and_robot()
        service, self._config = read_config(values, rospy.get_name() + "/", ServiceConfig, ProximityConfig)
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms)
        # [s] time of the first scan that could not be evaluated; inf if the last scan was evaluated
        self._blind_since = inf
        self._guard = Guard(service, self._robot, CLOCK_TOLERANCE)
        self._guard.watch(self._robot.topics.scan, LaserScan, self._on_scan)

    def run(self) -> None:
        """Work until the node is shut down."""
        self._guard.run()

    def _on_scan(self, msg: LaserScan) -> None:
        """Judge one scan: the guard stops the controller if an obstacle in the robot's path is too close.

        A scan cannot be judged without odometry or without the lidar's transform. The guard warns of this
        only after STARTING_TIME, because both may come late at the start.
        """
        try:
            scan = conversions.scan_from_msg(msg)
        except conversions.ScanError as error:
            rospy.logwarn_throttle(REPORT_PERIOD, f"guard inactive: {error}")
            return
        # time of the scan by odometry's clock; a warning with these texts is logged if the clocks differ
        stamp = self._guard.time_of(scan.stamp, "scans are", "the newest odometry is used for them")
        twist = self._guard.twist(stamp)
        laser_in_base = lookup_pose(self._transforms, BASE, scan.frame)
        if twist is None:
            self._note_blind_scan("no odometry in the last 0.5 s; check that the robot is running")
            return
        if laser_in_base is None:
            self._note_blind_scan(frame_sentence(scan.frame))
            return
        self._blind_since = inf
        # [m] distance to an obstacle for which the robot must brake now; None if there is no such obstacle
        clearance = too_close(scan, laser_in_base, twist, self._config, self._robot)
        danger = None
        # a velocity that is not finite is unknown, so it counts as a danger
        if not (isfinite(twist.linear) and isfinite(twist.angular)):
            danger = f"odometry reports {twist.linear} m/s, {twist.angular} rad/s"
        elif clearance is not None:
            danger = (
                f"something is {clearance:.2f} m away, and the robot moves towards it at "
                f"{twist.linear:.2f} m/s, {twist.angular:.2f} rad/s"
            )
        # `judge` is called for every scan, also without a danger, because it notices when the robot drives
        # again after a stop
        self._guard.judge(stamp, danger)

    def _note_blind_scan(self, reason: str) -> None:
        """Note that a scan cannot be judged; warn with the reason if this has lasted for STARTING_TIME."""
        now = rospy.get_time()  # ROS time, because the stamps of the scans may stand still
        # the first blind scan sets the time in place of inf; the time is set again if ROS time has gone back
        self._blind_since = min(self._blind_since, now)
        if now - self._blind_since >= STARTING_TIME:
            rospy.logwarn_throttle(REPORT_PERIOD, f"guard inactive: {reason}")


def main() -> None:
    """Run the node."""
    run_node("proximity_stop", ProximityStopNode)
