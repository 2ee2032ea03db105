"""Parameters set before the node starts are those it drives with, and those that rqt_reconfigure shows."""

from dataclasses import fields

import rospy
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import Twist
from player import NODE, NOTHING, Player, pillar_ahead
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
