"""Markers and numbers show what the robot sees, remembers, wants and does, where it is, and each once."""

import subprocess
from math import atan2, cos, hypot, pi, sin

from geometry_msgs.msg import PointStamped, Vector3Stamped
from harness import WALL_LIMIT, stamp
from player import LASER_X, NODE, NOTHING, Player, pillar_at
from visualization_msgs.msg import Marker, MarkerArray

PILLAR = (4.0, 1.5)  # [m], centre, in odom
RADIUS, STOP_DISTANCE = 0.2, 0.4


def place(marker):
    return (marker.pose.position.x, marker.pose.position.y)


class MarkersShow(Player):
    def look(self):
        """The ranges that the upside-down lidar reads from where the robot stands."""
        x, y = self.in_base(*PILLAR)
        return pillar_at(x - LASER_X, -y)

    def in_base(self, x, y):
        at_x, at_y, yaw = self.pose
        dx, dy = x - at_x, y - at_y
        return dx * cos(yaw) + dy * sin(yaw), dy * cos(yaw) - dx * sin(yaw)

    def assert_near(self, place, wanted, off=0.02):
        self.assertLess(hypot(place[0] - wanted[0], place[1] - wanted[1]), off, f"{place} is not {wanted}")

    def setUp(self):
        super().setUp()
        self.single = self.remember(f"{NODE}/visualization_marker", Marker)
        self.arrays = self.remember(f"{NODE}/visualization_marker_array", MarkerArray)
        self.pillars = self.remember(f"{NODE}/pillar", PointStamped)
        self.errors = self.remember(f"{NODE}/error", Vector3Stamped)

    def drive(self):
        for step in range(6):
            self.stand_at(0.2 * step, 0.1 * step, 0.1 * step)
            self.answer(self.look())
        moment = Player.moment
        self.wait_until(lambda: self.arrays and self.at(moment), "the last scan is shown")
        return {marker.ns: marker for marker in self.at(moment)}

    def at(self, moment):
        """The markers of the array of a scan."""
        shown = [array.markers for array in self.arrays if abs(stamp(array.markers[0]) - moment) < 1e-6]
        return shown[-1] if shown else []

    def is_now(self, msg):
        return abs(stamp(msg) - Player.moment) < 1e-6

    def test_1_the_array_shows_estimate_path_target_and_state(self):
        shown = self.drive()
        self.assertEqual(set(shown), {"estimate", "path", "target", "state"})
        self.assertTrue(all(marker.action == Marker.ADD for marker in shown.values()))
        self.assertTrue(all(marker.color.a > 0.0 for marker in shown.values()))

        estimate = shown["estimate"]
        self.assertEqual(estimate.header.frame_id, "odom")
        self.assert_near(place(estimate), PILLAR)
        self.assertGreater(estimate.scale.x, 2.0 * RADIUS, "its rim says how uncertain it is")
        self.assertLess(estimate.scale.z, 0.1, "it is flat")

        path = shown["path"]
        self.assertEqual((path.header.frame_id, path.type), ("odom", Marker.LINE_STRIP))
        self.assert_near((path.points[-1].x, path.points[-1].y), self.pose[:2])
        self.assertLessEqual(len(path.points), 6)

        target = shown["target"]
        self.assertEqual(target.header.frame_id, "base_link")
        x, y = self.in_base(*PILLAR)
        self.assertAlmostEqual(
            hypot(x - target.pose.position.x, y - target.pose.position.y), STOP_DISTANCE + RADIUS, delta=0.02
        )

        state = shown["state"]
        self.assertEqual((state.header.frame_id, state.type), ("base_link", Marker.TEXT_VIEW_FACING))
        self.assertIn("driving", state.text)
        self.assertRegex(state.text, r"\d\.\d\d m to go")
        above = state.pose.position
        self.assertLess(hypot(x - above.x, y - above.y), 0.1, "above the pillar")
        self.assertGreater(above.z, 1.0)
        self.assertLess(state.scale.z, 0.03 * (hypot(x, y) + 8.0), "small, as seen from behind the robot")

    def test_2_the_pillar_is_on_the_single_topic_and_nothing_is_shown_twice(self):
        shown = self.drive()

        def marked():  # to whoever has just subscribed a scan is shown twice
            return {(marker.ns, stamp(marker)) for marker in list(self.single)}

        self.wait_until(lambda: len(marked()) >= 12, "both markers of every scan")
        self.assertEqual({marker.ns for marker in self.single}, {"pillar_in_odom", "pillar_in_laser"})
        self.assertFalse({marker.ns for marker in self.single} & set(shown))
        for marker in self.single:
            if marker.ns == "pillar_in_odom":
                self.assert_near(place(marker), PILLAR)
        in_laser = [m for m in self.single if m.ns == "pillar_in_laser"][-1]
        self.assertEqual(in_laser.header.frame_id, "front_laser", "it is where the lidar sees it")
        x, y = self.in_base(*PILLAR)
        self.assert_near(place(in_laser), (x - LASER_X, -y))

    def test_3_pillar_and_error_are_numbers_to_plot(self):
        self.drive()
        self.wait_until(lambda: any(map(self.is_now, self.errors)), "there is the error of the last scan")
        self.wait_until(lambda: any(map(self.is_now, self.pillars)), "there is its pillar")
        x, y = self.in_base(*PILLAR)
        self.assertEqual(self.pillars[-1].header.frame_id, "base_link")
        self.assert_near((self.pillars[-1].point.x, self.pillars[-1].point.y), (x, y))
        error = self.errors[-1].vector
        self.assertAlmostEqual(error.x, hypot(x - LASER_X, y) - RADIUS - STOP_DISTANCE, delta=0.02)
        self.assertAlmostEqual(error.y, atan2(y, x), delta=0.02)

    def test_4_the_pillar_is_placed_by_the_pose_at_the_scan_s_moment(self):
        self.drive()
        ranges = self.look()
        then, there = Player.moment + 0.1, self.pose
        self.tell_pose(then)
        self.stand_at(9.0, 9.0, pi)
        self.tell_pose(then + 0.1)  # TF is ahead of the scan already, and the robot has moved on
        self.stand_at(*there)
        self.answer(ranges, pose_first=None)

        def placed():
            return [m for m in self.single if m.ns == "pillar_in_odom" and self.is_now(m)]

        self.wait_until(placed, "the scan is marked in odom")
        self.assert_near(place(placed()[0]), PILLAR)
        Player.moment += 0.1

    def test_5_what_is_no_more_is_taken_away(self):
        self.drive()

        def deleted():
            return {m.ns for array in self.arrays for m in array.markers if m.action == Marker.DELETE}

        self.play_until(lambda: "target" in deleted(), NOTHING, "the target is taken away")
        last = self.arrays[-1].markers
        self.assertIn("searching", next(marker.text for marker in last if marker.ns == "state"))

        def gone():
            return {marker.ns for marker in list(self.single) if marker.action == Marker.DELETE}

        self.wait_until(lambda: gone() == {"pillar_in_odom", "pillar_in_laser"}, "both are taken away")

    def test_6_the_path_of_a_robot_that_was_put_elsewhere_begins_there(self):
        self.drive()
        for step in range(3):
            self.stand_at(-5.0 + 0.2 * step, 3.0)
            self.answer(self.look())
        moment = Player.moment
        self.wait_until(lambda: self.at(moment), "the last scan is shown")
        (path,) = [marker for marker in self.at(moment) if marker.ns == "path"]
        self.assertEqual(next((round(point.x, 2), point.y) for point in path.points), (-5.0, 3.0))

    def test_7_who_comes_late_is_shown_the_last_scan(self):
        self.drive()
        topics = {
            f"{NODE}/visualization_marker": "pillar_in_odom",
            f"{NODE}/visualization_marker_array": "path",
        }
        for topic, namespace in topics.items():
            count = "2" if namespace == "pillar_in_odom" else "1"
            shown = subprocess.check_output(["rostopic", "echo", "-n", count, topic], timeout=WALL_LIMIT)
            self.assertIn(f'ns: "{namespace}"', shown.decode())
