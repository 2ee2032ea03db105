"""The controller alone; the test plays the robot."""

import subprocess
from math import pi

import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist
from harness import WALL_LIMIT, stamp
from player import LASER_X, NODE, NOTHING, PERIOD, Player, pillar_ahead, transform
from rosgraph_msgs.msg import Log
from std_msgs.msg import Bool
from std_srvs.srv import SetBool


class WaitsForTransforms(Player):
    """Without a transform from the lidar to base_link the robot stands, and the log says what it lacks."""

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
        for array, namespace in (("", "pillar_in_laser"), ("_array", "path")):
            topic = f"{NODE}/visualization_marker{array}"
            shown = subprocess.check_output(["rostopic", "echo", "-n", "1", topic], timeout=WALL_LIMIT)
            self.assertIn(f'ns: "{namespace}"', shown.decode())

        for distance in (0.6, 0.8, 0.8):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True, False], "the robot has left")
        for distance in (0.6, 0.405, 0.405, 0.405):
            self.answer_at(distance)
        self.wait_until(lambda: announced() == [False, True, False, True], "it has arrived again")

        self.wait_until(lambda: len(self.arrivals(log)) == 2, "the log has two arrivals")
        self.assertIn("(stop_distance 0.4 m)", self.arrivals(log)[0])
        self.assertRegex(self.arrivals(log)[0], r"after 0\.50 s of simulated time, 0\.40\d m from the pillar")

        service = rospy.ServiceProxy(f"{NODE}/start_stop", SetBool)
        for wanted in (False, True, False, True):
            service(wanted)
            for _ in range(3):
                self.answer_at(0.405)

        def said():
            return [line.msg for line in list(log) if "at the pillar already" in line.msg]

        self.wait_until(lambda: len(said()) == 2, "it says that it is there already")
        self.assertEqual(announced(), [False, True, False, True], "it has not left, nor arrived once more")
        service(False)
        self.stand_at(x=2.0 - 0.8)
        self.play_until(lambda: not arrived[-1].data, pillar_ahead(0.8), "it was carried away")
        service(True)

    def arrivals(self, log):
        return [line.msg for line in list(log) if line.level == Log.INFO and "arrived after" in line.msg]


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
