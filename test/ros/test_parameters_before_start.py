"""Parameters set before the start, or changed, are those that it drives with and rqt_reconfigure shows."""

from dataclasses import fields
from math import nan

import rospy
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import Twist
from player import NODE, NOTHING, Player, pillar_ahead
from rosgraph_msgs.msg import Log
from std_srvs.srv import SetBool

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig


class ParametersBeforeStart(Player):
    def test_it_drives_with_them(self):
        rospy.ServiceProxy("let_it_drive", SetBool)(True)
        self.assertEqual(self.answer(NOTHING), Twist(), "search is off")
        self.assertAlmostEqual(self.answer(pillar_ahead(3.0)).linear.x, 0.3 * 2.0, delta=0.01)
        self.stand_at(1.995)
        self.answer(pillar_ahead(1.005))
        self.assertEqual(self.commands[-1], Twist(), "stop_distance is 1 m")

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

    def test_they_are_what_can_be_tuned_with_the_ranges_and_words_of_the_records(self):
        client = Client(NODE, timeout=30.0)
        self.addCleanup(client.close)
        now = client.get_configuration(timeout=30.0)
        about = {each["name"]: each for each in client.get_parameter_descriptions(timeout=30.0)}
        given = {"stop_distance": 1.0, "p_gain_vel": 0.3, "search": False}
        names = set()
        for record in (ControlConfig, PillarConfig):
            for item in fields(record):
                names.add(item.name)
                self.assertEqual(now[item.name], given.get(item.name, item.default), item.name)
                self.assertEqual(about[item.name]["default"], item.default, item.name)
                self.assertEqual(about[item.name]["description"], item.metadata["help"])
                self.assertEqual(type(now[item.name]), type(item.default), item.name)
                if "min" in item.metadata:
                    limits = (about[item.name]["min"], about[item.name]["max"])
                    self.assertEqual(limits, (item.metadata["min"], item.metadata["max"]), item.name)
        self.assertEqual(set(about), names, "and nothing else")
