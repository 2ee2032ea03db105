"""The pillar controller as a ROS node; README.md lists its topics and parameters."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Deque, Optional, Tuple

import rospy
import tf2_ros
from geometry_msgs.msg import Point, Twist
from sensor_msgs.msg import LaserScan
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from husky_highlevel_controller import messages
from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.control import ControlConfig, Phase, advance, target_from_pillar
from husky_highlevel_controller.datatypes import STOP, Pillar, Pose, Scan
from husky_highlevel_controller.geometry import transform_point
from husky_highlevel_controller.nodes.starting import publish, run_node
from husky_highlevel_controller.pillar import PillarConfig, find_pillars

ODOM, BASE = "odom", "base_link"
IN_ODOM, IN_LASER = "pillar_in_odom", "pillar_in_laser"  # namespaces of the two markers
COLORS = {IN_ODOM: ColorRGBA(1.0, 0.45, 0.0, 0.9), IN_LASER: ColorRGBA(0.0, 0.6, 1.0, 0.4)}
REPORT_PERIOD = 5.0  # [s] between two lines of what the scan holds
PATIENCE = 50  # scans that may have to do without a transform before that is worth a word


@dataclass(frozen=True)
class ScanTopicConfig:
    """Where the scans come from."""

    scan_topic_name: str = field(default="/front/scan", metadata={"help": "topic of the lidar's scans"})
    scan_topic_queue_size: int = field(
        default=1, metadata={"min": 1, "max": 1000, "help": "scans kept while busy; an old scan is of no use"}
    )


class ControllerNode:
    """Answers every scan with a velocity command, and shows where the pillar is."""

    def __init__(self) -> None:
        topic, self._control, self._looks = read_config(
            rospy.get_param("~", {}), rospy.get_name() + "/", ScanTopicConfig, ControlConfig, PillarConfig
        )
        self._phase = Phase.WAITING
        self._started_at: Optional[float] = None
        self._scans_without_base = 0
        self._shown = False
        self._told_missing = False
        self._unplaced: Deque[Tuple[Scan, Pillar]] = deque(maxlen=PATIENCE)
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms)
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self._markers = rospy.Publisher("~visualization_marker", Marker, queue_size=10)
        rospy.on_shutdown(self._stop)
        rospy.Subscriber(
            topic.scan_topic_name,
            LaserScan,
            self._on_scan,
            queue_size=topic.scan_topic_queue_size,
            tcp_nodelay=True,
        )
        rospy.loginfo("waiting for scans on %s", rospy.resolve_name(topic.scan_topic_name))

    def run(self) -> None:
        """Work until the node is shut down."""
        rospy.spin()

    def _stop(self) -> None:
        publish(self._velocity, messages.twist_to_msg(STOP))

    def _on_scan(self, msg: LaserScan) -> None:
        scan = messages.scan_from_msg(msg)
        if self._started_at is None:
            self._started_at = scan.stamp
        pillar = next(iter(find_pillars(scan, self._looks)), None)
        laser_in_base = self._pose(scan.frame, BASE)
        self._scans_without_base = 0 if laser_in_base else self._scans_without_base + 1
        if self._scans_without_base > PATIENCE:
            rospy.logwarn_throttle(
                REPORT_PERIOD,
                f"no transform from '{scan.frame}' to '{BASE}', so the robot stands still; "
                "is robot_state_publisher running?",
            )
        target = None
        if pillar is not None and laser_in_base is not None:
            target = target_from_pillar(pillar, laser_in_base)
        before = self._phase
        self._phase, twist = advance(before, target, self._control)
        publish(self._velocity, messages.twist_to_msg(twist))
        self._tell(scan, pillar, before)
        self._show(scan, pillar)

    def _pose(self, child: str, parent: str, stamp: Optional[float] = None) -> Optional[Pose]:
        """Pose of one frame in another, at a time or (None) the latest; None where TF does not know it."""
        time = rospy.Time() if stamp is None else messages.time_to_msg(stamp)
        try:
            # no timeout: a callback that waits for TF hangs while the clock stands still
            return messages.pose_from_transform(self._transforms.lookup_transform(parent, child, time))
        except tf2_ros.TransformException:
            return None

    def _tell(self, scan: Scan, pillar: Optional[Pillar], before: Phase) -> None:
        """Log what changed, and now and then what the scan holds."""
        nearest = scan.ranges[scan.valid]
        if pillar is not None:
            rospy.loginfo_throttle(
                REPORT_PERIOD,
                f"smallest range {nearest.min():.3f} m; pillar at x {pillar.x:.3f} m, y {pillar.y:.3f} m, "
                f"angle {pillar.bearing:.3f} rad in {scan.frame}",
            )
        if self._phase is before and (self._phase is not Phase.WAITING or self._told_missing):
            return
        if self._phase is Phase.ARRIVED and pillar is not None:
            rospy.loginfo(
                f"arrived after {scan.stamp - (self._started_at or 0.0):.2f} s of simulated time, "
                f"{pillar.distance:.3f} m from the pillar (stop_distance {self._control.stop_distance:g} m)"
            )
        elif self._phase is Phase.DRIVING and pillar is not None:
            rospy.loginfo(f"driving to the pillar, {pillar.distance:.2f} m away")
        elif pillar is None:
            what = (
                f"none of its {len(nearest)} returns" if len(nearest) else "it has no valid range, so nothing"
            )
            rospy.logwarn(f"no pillar in the scan ({what} looks like one): the robot stands still")
        self._told_missing = self._phase is Phase.WAITING and pillar is None

    def _show(self, scan: Scan, pillar: Optional[Pillar]) -> None:
        """Mark the pillar in the laser's frame at once, and in odom as soon as TF knows the scan's moment."""
        if pillar is None:
            self._unplaced.clear()
            if self._shown:
                publish(self._markers, messages.no_marker(scan.stamp, scan.frame, IN_LASER))
                publish(self._markers, messages.no_marker(scan.stamp, ODOM, IN_ODOM))
            self._shown = False
            return
        self._shown = True
        self._mark(Point(pillar.x, pillar.y, 0.0), pillar.radius, scan.stamp, scan.frame, IN_LASER)
        self._unplaced.append((scan, pillar))
        while self._unplaced:
            seen_scan, seen = self._unplaced[0]
            laser_in_odom = self._pose(seen_scan.frame, ODOM, seen_scan.stamp)
            if laser_in_odom is None:  # TF travels by another road and may come a little later
                break
            center = Point(*transform_point(laser_in_odom, (seen.x, seen.y, 0.0)))
            self._mark(center, seen.radius, seen_scan.stamp, ODOM, IN_ODOM)
            self._unplaced.popleft()

    def _mark(self, center: Point, radius: float, stamp: float, frame: str, namespace: str) -> None:
        color = COLORS[namespace]
        publish(self._markers, messages.pillar_to_marker(center, radius, stamp, frame, namespace, color))


def main() -> None:
    """Run the node."""
    run_node("husky_highlevel_controller", ControllerNode)
