"""The controller alone, with parameters that it was given before its start; the test plays the robot."""

import os
import signal
from dataclasses import fields
from math import nan
from xmlrpc.client import ServerProxy

import rosgraph
import rosnode
import rospy
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import Twist
from player import BEAMS, NODE, NOTHING, Player, pillar_ahead
from rosgraph_msgs.msg import Log
from std_srvs.srv import SetBool
from visualization_msgs.msg import Marker

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig


class StartAndStopService(Player):
    """The service named by a parameter starts and stops the robot, at once and as often as one likes."""

    def test_true_drives_false_stops_at_once_and_telling_it_twice_is_no_mistake(self):
        pillar = pillar_ahead(3.0)
        rospy.wait_for_service("let_it_drive", 30.0)
        service = rospy.ServiceProxy("let_it_drive", SetBool)
        for _ in range(5):
            self.assertEqual(self.answer(pillar), Twist(), "start_enabled is false: it waits to be told")
        for _ in range(3):
            answer = service(True)
            self.assertTrue(answer.success)
            self.assertIn("driving", answer.message)
            self.assertGreater(self.answer(pillar).linear.x, 0.5)

            told = len(self.commands)
            answer = service(False)
            self.assertTrue(answer.success)
            self.assertIn("standing still", answer.message)
            self.wait_until(lambda told=told: len(self.commands) > told, "it stops without a scan")
            self.assertEqual(self.commands[-1], Twist())
            for _ in range(5):
                self.assertEqual(self.answer(pillar), Twist(), "it stays where it is")
        answer = service(False)
        self.assertTrue(answer.success)
        self.assertIn("already", answer.message)


class ParametersBeforeStart(Player):
    """Parameters set before the start, or changed, are those that it drives with and tools show."""

    def test_it_drives_with_them(self):
        rospy.ServiceProxy("let_it_drive", SetBool)(True)
        self.assertEqual(self.answer(NOTHING), Twist(), "search is off")
        self.assertAlmostEqual(self.answer(pillar_ahead(3.0)).linear.x, 0.3 * 2.0, delta=0.01)
        self.stand_at(1.995)
        self.answer(pillar_ahead(1.005))
        self.assertEqual(self.commands[-1], Twist(), "stop_distance is 1 m")

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
        rospy.ServiceProxy("let_it_drive", SetBool)(True)
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
        self.wait_until(lambda: warned("max_angular = nan"), "it says that nan is no number")
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
            self.stand_at(2.0)
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


PILLAR = pillar_ahead(3.0)


class StopsWithoutPillar(Player):
    """With search off the robot stands where a scan has no pillar, the markers go, and the log says why."""

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

    def test_without_a_range_and_at_a_wall_it_stops_and_goes_on_when_the_pillar_is_back(self):
        self.assert_stops_at([], "no valid range")
        self.assert_stops_at([2.0] * BEAMS, "none of its")

    def test_zzz_its_last_word_is_stop(self):
        self.assertGreater(self.answer(PILLAR).linear.x, 0.5)
        rosnode.kill_nodes([NODE])
        self.wait_until(lambda: self.commands[-1] == Twist(), "a zero Twist ends its work")
