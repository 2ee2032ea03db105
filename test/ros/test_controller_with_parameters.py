"""The controller alone, with parameters that it was given before its start; the test plays the robot."""

import os
import signal
from dataclasses import fields
from math import cos, inf, nan, pi, sin, sqrt
from xmlrpc.client import ServerProxy

import rosgraph
import rosnode
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import TransformStamped, Twist
from harness import RosTest, stamp
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig

BEAMS, HALF_VIEW = 720, 2.35619
LASER_X = 0.337  # [m], of the lidar in base_link
PERIOD = 0.1  # [s] between two scans
NODE = "husky_highlevel_controller"
NOTHING = [inf] * BEAMS


def pillar_ahead(distance, radius=0.2):
    """The ranges of a lidar that sees nothing but a pillar straight ahead, its surface at a distance [m]."""
    ranges, centre = [], distance + radius
    for beam in range(BEAMS):
        angle = -HALF_VIEW + beam * 2.0 * HALF_VIEW / (BEAMS - 1)
        inside = radius**2 - (centre * sin(angle)) ** 2
        is_hit = inside > 0.0 and abs(angle) < pi / 2.0
        ranges.append(centre * cos(angle) - sqrt(inside) if is_hit else inf)
    return ranges


def transform(parent, child, stamp, x):
    msg = TransformStamped(child_frame_id=child)
    msg.header.frame_id, msg.header.stamp = parent, stamp
    msg.transform.translation.x, msg.transform.rotation.w = x, 1.0
    return msg


class Player(RosTest):
    """A test case that is a robot; its scans are stamped by a clock of its own."""

    moment = 1000.0  # [s], of the last scan, in any test

    def setUp(self):
        self.commands = self.remember("cmd_vel", Twist)
        self.scans = self.publisher("front/scan", LaserScan)
        self.transforms = self.publisher("/tf", TFMessage)
        self.x = 0.0  # [m], where the robot stands
        rospy.wait_for_service("let_it_drive", 30.0)
        rospy.ServiceProxy("let_it_drive", SetBool)(True)

    def send(self, ranges):
        """A scan, and where the robot was."""
        Player.moment += PERIOD
        now = rospy.Time.from_sec(Player.moment)
        robot = transform("odom", "base_link", now, self.x)
        self.transforms.publish(TFMessage([robot, transform("base_link", "front_laser", now, LASER_X)]))
        msg = LaserScan(angle_min=-HALF_VIEW, angle_max=HALF_VIEW, range_min=0.1, range_max=30.0)
        msg.angle_increment = 2.0 * HALF_VIEW / (BEAMS - 1)
        msg.header.frame_id, msg.header.stamp = "front_laser", now
        msg.ranges = ranges
        self.scans.publish(msg)

    def answer(self, ranges):
        """The command that answers a scan."""
        seen = len(self.commands)
        self.send(ranges)
        self.wait_until(lambda: len(self.commands) > seen, "the scan is answered")
        return self.commands[-1]

    def play_until(self, condition, ranges, what):
        """Send the same scan until something is so."""

        def met():
            self.answer(ranges)
            return condition()

        self.wait_until(met, what)


class ParametersBeforeStart(Player):
    """Parameters set before the start, or changed, are those that it drives with and tools show."""

    def test_tools_show_every_parameter_with_the_value_that_it_drives_with(self):
        client = Client(NODE, timeout=30.0)
        self.addCleanup(client.close)
        shown = client.get_configuration(timeout=30.0)
        driven = {"stop_distance": 1.0, "p_gain_vel": 0.3, "search": False}
        for item in (*fields(ControlConfig), *fields(PillarConfig)):
            self.assertEqual(shown[item.name], driven.get(item.name, item.default), item.name)

    def test_a_gain_that_is_changed_counts_from_the_next_scan_and_what_cannot_be_is_explained(self):
        log = self.remember("rosout", Log)
        client = Client(NODE, timeout=30.0)
        self.addCleanup(client.close)
        before = client.get_configuration(timeout=30.0)
        self.addCleanup(lambda: client.update_configuration(before))
        self.assertAlmostEqual(self.answer(pillar_ahead(3.0)).linear.x, 0.3 * 2.0, delta=0.01)
        client.update_configuration({"p_gain_vel": 0.1})
        self.assertAlmostEqual(self.answer(pillar_ahead(3.0)).linear.x, 0.1 * 2.0, delta=0.01)

        def warned(*words):
            lines = [line.msg for line in list(log) if line.level == Log.WARN]
            return any(all(word in line for word in words) for line in lines)

        self.assertEqual(client.update_configuration({"p_gain_ang": 99.0})["p_gain_ang"], 10.0)
        self.wait_until(lambda: warned("p_gain_ang = 99.0", "0.0..10.0"), "it says that 99 is too much")
        now = client.update_configuration({"max_angular": nan})["max_angular"]
        self.assertEqual(now, before["max_angular"])
        self.wait_until(lambda: warned("max_angular = nan"), "the log says that nan is not a number")
        self.assertEqual(client.update_configuration({"p_gain_ang": 1.5})["p_gain_ang"], 1.5, "it lives on")


SCANS = 15  # few enough to lie in the sockets' buffers


class AnswersTheLatestScan(Player):
    """With a queue of 1 a controller that was busy answers the latest scan, not those that came meanwhile."""

    def test_those_that_came_while_it_was_busy_are_left_out(self):
        self.assertGreater(self.answer(pillar_ahead(3.0)).linear.x, 0.5)
        with ServerProxy(rosnode.get_api_uri(rosgraph.Master("/test"), f"/{NODE}")) as node:
            controller = node.getPid("/test")[2]
        answered, sent = len(self.commands), self.sent()
        os.kill(controller, signal.SIGSTOP)  # nothing is busier
        try:
            for _ in range(SCANS):
                self.send(pillar_ahead(3.0))
            self.x = 2.0
            self.send(pillar_ahead(1.0))  # where it is to stop
            self.wait_until(lambda: self.sent() > sent + SCANS, "all scans are on their way")
        finally:
            os.kill(controller, signal.SIGCONT)
        self.wait_until(lambda: self.commands[-1].linear.x == 0.0, "the last scan is answered")
        self.assertLess(len(self.commands) - answered, SCANS // 2)

    def sent(self):
        """Scans that have left for the controller."""
        with ServerProxy(rospy.get_node_uri()) as node:
            published = node.getBusStats("/test")[2][0]
        (connections,) = (each[2] for each in published if each[0] == self.scans.resolved_name)
        return sum(messages for _, _, messages, *_ in connections)


class DiagnosticsTell(Player):
    """/diagnostics reports once a second how the controller is: OK, WARN or ERROR, figures and a remedy."""

    def setUp(self):
        super().setUp()
        self.told = self.remember("/diagnostics", DiagnosticArray)

    def send(self, ranges):
        """A scan of the present: its age is told."""
        Player.moment = rospy.get_time() - PERIOD
        super().send(ranges)

    def last(self):
        return self.told[-1].status[0] if self.told else DiagnosticStatus(level=-1)

    def test_they_follow_what_happens(self):
        self.wait_until(lambda: "no scans" in self.last().message, "there are no scans")
        self.assertEqual((self.last().name, self.last().level), (NODE, DiagnosticStatus.ERROR))

        self.play_until(lambda: self.last().level == DiagnosticStatus.OK, pillar_ahead(3.0), "all is well")
        values = {item.key: item.value for item in self.last().values}
        self.assertEqual((values["state"], values["pillar"]), ("driving", "seen"))
        self.assertRegex(values["scan age"], r"^-?\d+\.\d+ s$")
        self.assertRegex(values["scan rate"], r"^\d+\.\d+ Hz$")
        self.assertRegex(values["TF age"], r"^-?\d+\.\d+ s$")

        self.play_until(lambda: self.last().level == DiagnosticStatus.WARN, NOTHING, "there is no pillar")
        self.assertIn("no pillar", self.last().message)

        # and the scans end
        self.wait_until(lambda: "no scans" in self.last().message, "scans are missed")
        self.assertEqual(self.last().level, DiagnosticStatus.ERROR)
        count = len(self.told)
        self.wait_until(lambda: len(self.told) > count + 1, "it is told again")
        # the first is for whoever has just come, and a change of the state is told at once
        told = [(stamp(array), array.status[0].message) for array in self.told][1:]
        gaps = [after[0] - before[0] for before, after in zip(told, told[1:]) if before[1] == after[1]]
        self.assertGreater(min(gaps), 0.5, "once a second")


class StopsAtItsEnd(Player):
    """A controller that is ended stops the robot."""

    def test_its_last_word_is_stop(self):
        self.play_until(lambda: self.commands[-1].linear.x > 0.5, pillar_ahead(3.0), "it drives")
        rosnode.kill_nodes([NODE])
        self.wait_until(lambda: self.commands[-1] == Twist(), "a zero Twist ends its work")
