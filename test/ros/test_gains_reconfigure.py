"""A gain changed in mid-drive is seen in the drive; a value that cannot be is refused with a word."""

import subprocess
from math import nan

from dynamic_reconfigure.client import Client
from geometry_msgs.msg import Twist
from harness import RosTest, stamp
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log

NODE = "husky_highlevel_controller"
GAIN = 0.02  # [1/s], some 0.4 m/s at the pillar's 20 m


def dynparam(*arguments):
    command = ["rosrun", "dynamic_reconfigure", "dynparam", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=True).stdout


class GainsReconfigure(RosTest):
    def test_a_dynparam_mid_drive_slows_the_robot_down(self):
        truth = self.remember("ground_truth/odom", Odometry)
        commands = self.remember("cmd_vel", Twist)
        self.resume()
        self.wait_until(lambda: truth and truth[-1].twist.twist.linear.x > 0.9, "it drives fast")

        self.pause()  # on a busy machine dynparam takes seconds to start, in which the pillar comes near
        dynparam("set", f"/{NODE}", "p_gain_vel", str(GAIN))
        changed = len(commands)
        self.resume()
        self.wait_until(lambda: len(commands) > changed + 10, "the next scans are answered")
        self.assertLess(max(msg.linear.x for msg in commands[changed + 5 :]), 20.0 * GAIN)
        self.assertGreater(max(msg.linear.x for msg in commands[changed + 5 :]), 5.0 * GAIN)
        self.wait(1.0)  # to brake
        slow = stamp(truth[-1])
        self.wait(3.0)
        speeds = [m.twist.twist.linear.x for m in truth if stamp(m) > slow]
        self.assertLess(max(speeds), 20.0 * GAIN + 0.02, "the trajectory shows it")
        self.assertIn(f"'p_gain_vel': {GAIN}", dynparam("get", f"/{NODE}"))

    def test_what_cannot_be_is_explained(self):
        log = self.remember("rosout", Log)
        client = Client(NODE, timeout=30.0)
        self.addCleanup(client.close)
        before = client.get_configuration(timeout=30.0)

        def warned(*words):
            lines = [line.msg for line in list(log) if line.level == Log.WARN]
            return any(all(word in line for word in words) for line in lines)

        self.assertEqual(client.update_configuration({"p_gain_ang": 99.0})["p_gain_ang"], 10.0)
        self.wait_until(lambda: warned("p_gain_ang = 99.0", "0.0..10.0"), "it says that 99 is too much")
        self.assertEqual(
            client.update_configuration({"max_angular": nan})["max_angular"], before["max_angular"]
        )
        self.wait_until(lambda: warned("max_angular = nan"), "it says that nan is no number")
        self.assertEqual(client.update_configuration({"p_gain_ang": 1.5})["p_gain_ang"], 1.5, "it lives on")
