"""Node that makes a scan of each point cloud on cloud_in, if pointcloud_to_laserscan is not installed.

`simulator/sensors/points_to_scan.py` names the original, and the test that compares the two.
"""

from __future__ import annotations

from typing import Optional

import rospy
import tf2_ros
from sensor_msgs.msg import LaserScan, PointCloud2

from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.geometry import transform_points
from husky_highlevel_controller.ros.clouds import points_from_msg
from husky_highlevel_controller.ros.node import publish, run_node
from husky_highlevel_controller.ros.transforms import lookup_pose
from husky_highlevel_controller.simulator.sensors.points_to_scan import FlattenConfig, flatten, parameters_of

MAX_POINTS = 1_000_000  # largest number of points of a cloud that are used; a larger cloud is thinned
REPORT_PERIOD = 5.0  # [s] shortest time between two warnings


class PointsToScanNode(rospy.SubscribeListener):
    """Makes a LaserScan of each cloud; subscribes to clouds only while a node subscribes to the scans.

    The original, pointcloud_to_laserscan, also subscribes only then.
    """

    def __init__(self) -> None:
        """Read the parameters, and advertise the scan; ConfigError for a wrong parameter."""
        parameters = rospy.get_param("~", {})  # unknown parameters are ignored, as in pointcloud_to_laserscan
        (self._config,) = read_config(parameters_of(parameters), rospy.get_name() + "/", FlattenConfig)
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms) if self._config.target_frame else None
        self._clouds: Optional[rospy.Subscriber] = None
        # `self` gets the calls of `peer_subscribe` and `peer_unsubscribe`
        self._scans = rospy.Publisher("scan", LaserScan, self, queue_size=10)

    def run(self) -> None:
        """Work until the node is shut down."""
        rospy.spin()

    def peer_subscribe(self, *_: object) -> None:
        """Subscribe to the clouds when a node subscribes to the scans; rospy calls this."""
        if self._clouds is None:
            self._clouds = rospy.Subscriber("cloud_in", PointCloud2, self._on_cloud, queue_size=1)

    def peer_unsubscribe(self, _topic: str, listeners: int) -> None:
        """Unsubscribe from the clouds when the last subscriber of the scans has left; rospy calls this."""
        if listeners == 0 and self._clouds is not None:
            self._clouds.unregister()
            self._clouds = None

    def _on_cloud(self, msg: PointCloud2) -> None:
        """Publish a cloud as a scan in the target frame, or warn if TF has no transform to it."""
        config, frame = self._config, msg.header.frame_id
        points = points_from_msg(msg, MAX_POINTS).astype(float)  # points (N, 3) [m] in the frame of the cloud
        target = config.target_frame or frame  # an empty parameter means the frame of the cloud
        if target != frame:
            pose = lookup_pose(self._transforms, target, frame)
            if pose is None:
                sentence = (
                    f"no scan from the cloud, because there is no transform from '{frame}' to '{target}'"
                )
                rospy.logwarn_throttle(REPORT_PERIOD, sentence)
                return
            points = transform_points(pose, points)  # points (N, 3) [m] in the target frame
        scan = LaserScan(
            angle_min=config.angle_min,
            angle_max=config.angle_max,
            angle_increment=config.angle_increment,
            scan_time=config.scan_time,
            range_min=config.range_min,
            range_max=config.range_max,
            ranges=flatten(points, config).tolist(),
        )
        scan.header.stamp, scan.header.frame_id = msg.header.stamp, target
        publish(self._scans, scan)


def main() -> None:
    """Run the node."""
    run_node("pointcloud_to_laserscan", PointsToScanNode)
