"""With search off the robot stands still where a scan has no pillar, the markers go, and the log says why."""

from math import cos, inf

import rosnode
import rospy
from geometry_msgs.msg import Twist
from player import NODE, Player, bearings, pillar_ahead
from rosgraph_msgs.msg import Log
from visualization_msgs.msg import Marker

PILLAR = pillar_ahead(3.0)


def wall_ahead():
    return [2.0 / cos(angle) if abs(angle) < 1.2 else inf for angle in bearings()]


class StopsWithoutPillar(Player):
    def setUp(self):
        super().setUp()
        self.markers = self.remember(f"{NODE}/visualization_marker", Marker)
        self.log = self.remember("rosout", Log)
        self.play_until(lambda: self.commands[-1].linear.x > 0.5, PILLAR, "it drives to the pillar")

    def namespaces(self, action):
        return {marker.ns for marker in list(self.markers) if marker.action == action}

    def assert_stops_at(self, ranges, why):
        self.play_until(lambda: len(self.namespaces(Marker.ADD)) == 2, PILLAR, "the pillar is marked twice")
        start = rospy.Time.now()
        for _ in range(3):
            self.assertEqual(self.answer(ranges), Twist())
        self.wait_until(
            lambda: self.namespaces(Marker.DELETE) == self.namespaces(Marker.ADD), "both markers are deleted"
        )
        self.assertGreater(self.answer(PILLAR).linear.x, 0.5, "it goes on when the pillar is back")

        def said():
            return [line.msg for line in list(self.log) if line.header.stamp >= start]

        self.wait_until(lambda: any("driving" in line for line in said()), "the log says that it goes on")
        complaints = [line for line in said() if "no pillar" in line]
        self.assertEqual(len(complaints), 1, complaints)
        self.assertIn(why, complaints[0])
        self.assertRegex(complaints[0], "set ~search|lidar covered", "it says what would help")

    def test_no_range_at_all(self):
        self.assert_stops_at([], "no valid range")

    def test_a_wall_is_not_a_pillar(self):
        self.assert_stops_at(wall_ahead(), "none of its")

    def test_zzz_its_last_word_is_stop(self):
        self.assertGreater(self.answer(PILLAR).linear.x, 0.5)
        rosnode.kill_nodes([NODE])
        self.wait_until(lambda: self.commands[-1] == Twist(), "a zero Twist ends its work")
