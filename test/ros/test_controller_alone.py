"""The controller alone; the test plays the robot."""

import subprocess
from math import atan2, cos, hypot, pi, sin

import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, Twist, Vector3Stamped
from harness import WALL_LIMIT, stamp
from player import LASER_X, NODE, NOTHING, PERIOD, Player, pillar_ahead, pillar_at, transform
from rosgraph_msgs.msg import Log
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from visualization_msgs.msg import Marker, MarkerArray


class WaitsForTransforms(Player):
    """Without a transform from the lidar to base_link the robot stands, and the log says what it lacks."""

    def test_a_scan_is_placed_by_the_pose_of_its_own_moment(self):
        markers = self.remember(f"{NODE}/visualization_marker", Marker)
        Player.moment = 0.0  # a stamp of 0 is no sign of a pose that is fixed for good
        self.tell_pose(Player.moment)
        stood = [0.2 * scan for scan in range(1, 11)]
        for x in stood:
            self.stand_at(x)
            self.answer(pillar_ahead(3.0), pose_first=False)
        self.wait_until(lambda: len(places(markers)) == len(stood), "every scan is shown")
        for x, place in zip(stood, places(markers)):
            self.assertAlmostEqual(place, x + LASER_X + 3.2, delta=0.01)

    def test_it_stands_still_until_the_lidar_has_a_place(self):
        self.frame = "another_laser"
        log = self.remember("rosout", Log)

        def warned():
            return [line.msg for line in list(log) if line.level == Log.WARN and "transform" in line.msg]

        for _ in range(20):
            self.assertEqual(self.answer(pillar_ahead(3.0)), Twist())
        self.assertEqual(warned(), [], "TF may take a moment: that is no reason for a warning")
        self.play_until(warned, pillar_ahead(3.0), "it warns")
        self.assertEqual(self.commands[-1], Twist())
        self.assertIn("'another_laser' to 'base_link'", warned()[0])
        self.assertIn("robot_state_publisher", warned()[0], "it says what would help")

        broadcaster = tf2_ros.StaticTransformBroadcaster()
        broadcaster.sendTransform([transform("base_link", "another_laser", rospy.Time(), x=LASER_X)])
        self.play_until(lambda: self.commands[-1].linear.x > 0.5, pillar_ahead(3.0), "it drives")

        turned = transform("base_link", "another_laser", rospy.Time(), x=LASER_X, yaw=pi / 2.0)
        broadcaster.sendTransform([turned])
        self.play_until(lambda: self.commands[-1].angular.z > 0.5, pillar_ahead(3.0), "it turns to the left")


def places(markers):
    """Where each scan's pillar was shown in odom [m]; to whoever has just subscribed one is shown twice."""
    shown = {stamp(marker): marker for marker in list(markers) if marker.ns == "pillar_in_odom"}
    return [marker.pose.position.x for marker in shown.values()]


STEP = 0.5  # [rad] between two scans


class SaysHowItSearches(Player):
    """A search is a full turn, then a widening drive; the log tells of each once, at INFO level."""

    def test_each_stage_is_told_once(self):
        log = self.remember("rosout", Log)

        def said():
            return [m.msg for m in list(log) if m.name == f"/{NODE}" and m.level == Log.INFO]

        def last():
            return said()[-1] if said() else ""

        for step in range(12):
            self.stand_at(yaw=step * STEP)
            command = self.answer(NOTHING)
            self.assertEqual(command.linear.x, 0.0)
            self.assertGreater(command.angular.z, 0.0, "it turns to look around")
        self.wait_until(lambda: "turning to look around" in last(), "it says that it turns")

        for step in range(12, 16):
            self.stand_at(yaw=step * STEP)
            command = self.answer(NOTHING)
        self.assertGreater(command.linear.x, 0.0, "it drives on after a full turn")
        self.wait_until(lambda: "widening search" in last(), "it says that it drives")

        before = len(said())
        for step in range(40):  # a leg, and a turn
            self.stand_at(x=0.1 * min(step, 20), yaw=16 * STEP + STEP * max(step - 20, 0))
            self.answer(NOTHING)
        self.answer(pillar_ahead(3.0))
        self.wait_until(lambda: "driving to the pillar" in last(), "it has found the pillar")
        self.assertEqual(len(said()), before + 1, "and nothing was said in between")
        self.assertRegex(said()[-1], r"smallest range 3\.000 m, pillar at x 3\.\d+ m", "with what it sees")


class ArrivalIsAnnounced(Player):
    """Arriving is said once, in the log and on a latched topic; so is that the robot has left again."""

    def answer_at(self, distance):
        """Answer the scan of a robot so far from a pillar that stands [m]."""
        self.stand_at(x=2.0 - distance)
        self.answer(pillar_ahead(distance))

    def test_each_arrival_is_announced_once(self):
        arrived = self.remember(f"{NODE}/arrived", Bool)
        log = self.remember("rosout", Log)

        def announced():
            return [msg.data for msg in arrived]

        for distance in (1.0, 0.8, 0.6, 0.5, 0.45):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False], "it is on its way")
        for distance in (0.405, 0.404, 0.406, 0.405, 0.404):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True], "it has arrived")

        late = self.remember(f"{NODE}/arrived", Bool)
        self.wait_until(lambda: [msg.data for msg in late] == [True], "who joins late is told as well")

        for distance in (0.6, 0.8, 0.8):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True, False], "the robot has left")
        for distance in (0.6, 0.405, 0.405, 0.405):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True, False, True], "it has arrived again")

        self.wait_until(lambda: len(self.arrivals(log)) == 2, "the log has two arrivals")
        self.assertIn("(stop_distance 0.4 m)", self.arrivals(log)[0])
        self.assertRegex(self.arrivals(log)[0], r"after 0\.50 s of simulated time, 0\.40\d m from the pillar")

    def test_stop_and_start_at_the_pillar_are_no_arrival(self):
        arrived = self.remember(f"{NODE}/arrived", Bool)
        log = self.remember("rosout", Log)
        start = rospy.Time.now()
        for _ in range(3):
            self.answer_at(0.405)
        self.wait_until(lambda: arrived and arrived[-1].data, "it has arrived")
        told = len(arrived)
        service = rospy.ServiceProxy(f"{NODE}/start_stop", SetBool)
        for wanted in (False, True, False, True):
            service(wanted)
            for _ in range(3):
                self.answer_at(0.405)

        def said():
            return [line.msg for line in list(log) if line.header.stamp >= start and "already" in line.msg]

        self.wait_until(lambda: len(said()) == 2, "it says that it is there already")
        self.assertEqual(len(arrived), told, "it has not left")
        service(False)
        self.stand_at(x=2.0 - 0.8)
        self.play_until(lambda: not arrived[-1].data, pillar_ahead(0.8), "it was carried away")
        service(True)

    def arrivals(self, log):
        return [line.msg for line in list(log) if line.level == Log.INFO and "arrived after" in line.msg]


PILLAR = (4.0, 1.5)  # [m], centre, in odom
RADIUS, STOP_DISTANCE = 0.2, 0.4


def place(marker):
    return (marker.pose.position.x, marker.pose.position.y)


class MarkersShow(Player):
    """Markers and numbers show what the robot sees, remembers, wants and does, where it is, and each once."""

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

    def test_4_what_is_no_more_is_taken_away(self):
        self.drive()

        def deleted():
            return {m.ns for array in self.arrays for m in array.markers if m.action == Marker.DELETE}

        self.play_until(lambda: "target" in deleted(), NOTHING, "the target is taken away")
        last = self.arrays[-1].markers
        self.assertIn("searching", next(marker.text for marker in last if marker.ns == "state"))

        def gone():
            return {marker.ns for marker in list(self.single) if marker.action == Marker.DELETE}

        self.wait_until(lambda: gone() == {"pillar_in_odom", "pillar_in_laser"}, "both are taken away")

    def test_5_the_path_of_a_robot_that_was_put_elsewhere_begins_there(self):
        self.drive()
        for step in range(3):
            self.stand_at(-5.0 + 0.2 * step, 3.0)
            self.answer(self.look())
        moment = Player.moment
        self.wait_until(lambda: self.at(moment), "the last scan is shown")
        (path,) = [marker for marker in self.at(moment) if marker.ns == "path"]
        self.assertEqual(next((round(point.x, 2), point.y) for point in path.points), (-5.0, 3.0))

    def test_6_who_comes_late_is_shown_the_last_scan(self):
        self.drive()
        topics = {
            f"{NODE}/visualization_marker": "pillar_in_odom",
            f"{NODE}/visualization_marker_array": "path",
        }
        for topic, namespace in topics.items():
            count = "2" if namespace == "pillar_in_odom" else "1"
            shown = subprocess.check_output(["rostopic", "echo", "-n", count, topic], timeout=WALL_LIMIT)
            self.assertIn(f'ns: "{namespace}"', shown.decode())


class DiagnosticsTell(Player):
    """/diagnostics reports once a second how the controller is: OK, WARN or ERROR, figures and a remedy."""

    def setUp(self):
        super().setUp()
        self.told = self.remember("/diagnostics", DiagnosticArray)

    def last(self):
        return self.told[-1].status[0] if self.told else DiagnosticStatus(level=-1)

    def play_now(self, condition, ranges, what):
        """Scans of the present, for those who look at their age."""

        def met():
            Player.moment = rospy.get_time() - PERIOD
            self.answer(ranges)
            return condition()

        self.wait_until(met, what)

    def test_they_follow_what_happens(self):
        self.wait_until(lambda: "no scans" in self.last().message, "there are no scans yet")
        self.assertEqual((self.last().name, self.last().level), (NODE, DiagnosticStatus.ERROR))

        self.play_now(lambda: self.last().level == DiagnosticStatus.OK, pillar_ahead(3.0), "all is well")
        values = {item.key: item.value for item in self.last().values}
        self.assertEqual((values["state"], values["pillar"]), ("driving", "seen"))
        self.assertRegex(values["scan age"], r"^-?\d+\.\d+ s$")
        self.assertRegex(values["scan rate"], r"^\d+\.\d+ Hz$")
        self.assertRegex(values["TF age"], r"^-?\d+\.\d+ s$")

        self.play_now(lambda: self.last().level == DiagnosticStatus.WARN, NOTHING, "there is no pillar")
        self.assertIn("no pillar", self.last().message)

        # and the scans end
        self.wait_until(lambda: "no scans" in self.last().message, "scans are missed")
        self.assertEqual(self.last().level, DiagnosticStatus.ERROR)
        stamps = [stamp(array) for array in self.told][1:]  # the first is for whoever has just come
        self.assertGreater(min(b - a for a, b in zip(stamps, stamps[1:])), 0.5, "once a second")
