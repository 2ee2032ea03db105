"""Stops the controller before the robot touches anything; README.md lists topics and parameters."""

from __future__ import annotations

from typing import Optional

import rospy
import tf2_ros
from sensor_msgs.msg import LaserScan

from husky_highlevel_controller import messages
from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.nodes.starting import run_node
from husky_highlevel_controller.nodes.stopping import REPORT_PERIOD, Guard, ServiceConfig
from husky_highlevel_controller.safety import ProximityConfig, too_close

BASE = "base_link"


class ProximityStopNode:
    """Looks at every scan."""

    def __init__(self) -> None:
        service, self._config = read_config(
            rospy.get_param("~", {}), rospy.get_name() + "/", ServiceConfig, ProximityConfig
        )
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms)
        self._guard = Guard(service)
        rospy.Subscriber("front/scan", LaserScan, self._on_scan, queue_size=1, tcp_nodelay=True)

    def run(self) -> None:
        """Work until the node is shut down."""
        self._guard.run()

    def _on_scan(self, msg: LaserScan) -> None:
        scan = messages.scan_from_msg(msg)
        twist = self._guard.twist(scan.stamp)
        laser_in_base = self._laser_in_base(scan.frame)
        if twist is None or laser_in_base is None:
            missing = "fresh odometry" if twist is None else f"transform from '{scan.frame}' to '{BASE}'"
            rospy.logwarn_throttle(
                REPORT_PERIOD, f"no {missing}, so nothing stops the robot; is the robot running?"
            )
            return
        clearance = too_close(scan, laser_in_base, twist, self._config)
        danger = None
        if clearance is not None:
            danger = (
                f"something is {clearance:.2f} m away, and the robot moves towards it at "
                f"{twist.linear:.2f} m/s, {twist.angular:.2f} rad/s"
            )
        self._guard.judge(scan.stamp, danger)

    def _laser_in_base(self, frame: str) -> Optional[Pose]:
        try:
            # no timeout: a callback that waits for TF hangs while the clock stands still
            transform = self._transforms.lookup_transform(BASE, frame, rospy.Time())
        except tf2_ros.TransformException:
            return None
        return messages.pose_from_transform(transform)


def main() -> None:
    """Run the node."""
    run_node("proximity_stop", ProximityStopNode)
