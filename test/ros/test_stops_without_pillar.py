#!/usr/bin/env python3
"""Where a scan shows no pillar the robot stands still, the markers go, and the log says why."""

from math import cos, inf, nan, sqrt

import rosnode
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped, Twist
from harness import RosTest, run
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import Marker

BEAMS, HALF_VIEW = 720, 2.35619


def scan_of(ranges):
    msg = LaserScan(angle_min=-HALF_VIEW, angle_max=HALF_VIEW, range_min=0.1, range_max=30.0)
    msg.angle_increment = 2.0 * HALF_VIEW / (BEAMS - 1)
    msg.header.frame_id = "front_laser"
    msg.header.stamp = rospy.Time.now()
    msg.ranges = ranges
    return msg


def bearings():
    return [-HALF_VIEW + i * 2.0 * HALF_VIEW / (BEAMS - 1) for i in range(BEAMS)]


def pillar_ahead(distance=3.0, radius=0.2):
    ranges = []
    for angle in bearings():
        inside = radius**2 - (distance * sqrt(1.0 - cos(angle) ** 2)) ** 2
        ranges.append(distance * cos(angle) - sqrt(inside) if inside > 0.0 and cos(angle) > 0.0 else inf)
    return ranges


def wall_ahead():
    return [2.0 / cos(angle) if abs(angle) < 1.2 else inf for angle in bearings()]


class StopsWithoutPillar(RosTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.static = tf2_ros.StaticTransformBroadcaster()
        tree = []
        for parent, child, x, roll in (
            ("odom", "base_link", 0.0, 0.0),
            ("base_link", "front_laser", 0.3, 1.0),
        ):
            transform = TransformStamped()
            transform.header.frame_id, transform.child_frame_id = parent, child
            transform.transform.translation.x = x
            transform.transform.rotation.x, transform.transform.rotation.w = roll, 1.0 - roll
            tree.append(transform)
        cls.static.sendTransform(tree)

    def setUp(self):
        self.commands = self.remember("cmd_vel", Twist)
        self.markers = self.remember("husky_highlevel_controller/visualization_marker", Marker)
        self.log = self.remember("rosout", Log)
        self.scans = self.publisher("front/scan", LaserScan)
        self.wait_until(lambda: self.answer(pillar_ahead()).linear.x > 0.5, "it drives to the pillar")

    def answer(self, ranges):
        """The command that answers a scan."""
        seen = len(self.commands)
        self.scans.publish(scan_of(ranges))
        self.wait_until(lambda: len(self.commands) > seen, "the scan is answered")
        return self.commands[-1]

    def namespaces(self, action):
        return {marker.ns for marker in list(self.markers) if marker.action == action}

    def assert_stops_at(self, ranges, why):
        self.wait_until(lambda: len(self.namespaces(Marker.ADD)) == 2, "the pillar is marked twice")
        start = rospy.Time.now()
        for _ in range(3):
            self.assertEqual(self.answer(ranges), Twist())
        self.wait_until(
            lambda: self.namespaces(Marker.DELETE) == self.namespaces(Marker.ADD), "both markers are deleted"
        )
        self.assertGreater(self.answer(pillar_ahead()).linear.x, 0.5, "it goes on when the pillar is back")

        def said():
            return [line.msg for line in list(self.log) if line.header.stamp >= start]

        self.wait_until(lambda: any("driving" in line for line in said()), "the log says that it goes on")
        complaints = [line for line in said() if "no pillar" in line]
        self.assertEqual(len(complaints), 1, complaints)
        self.assertIn(why, complaints[0])

    def test_nothing_in_view(self):
        self.assert_stops_at([inf] * BEAMS, "no valid range")

    def test_nothing_but_nan(self):
        self.assert_stops_at([nan] * BEAMS, "no valid range")

    def test_a_scan_without_beams(self):
        self.assert_stops_at([], "no valid range")

    def test_a_wall_is_not_a_pillar(self):
        self.assert_stops_at(wall_ahead(), "none of its")

    def test_a_lone_beam_is_not_a_pillar(self):
        self.assert_stops_at([1.0 if i == 300 else inf for i in range(BEAMS)], "none of its")

    def test_zzz_its_last_word_is_stop(self):
        self.assertGreater(self.answer(pillar_ahead()).linear.x, 0.5)
        rosnode.kill_nodes(["husky_highlevel_controller"])
        self.wait_until(lambda: self.commands[-1] == Twist(), "a zero Twist ends its work")


if __name__ == "__main__":
    run(StopsWithoutPillar)
