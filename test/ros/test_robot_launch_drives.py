"""robot.launch waits for its start service, then drives a Husky with a real one's drivers to the pillar."""

from math import hypot

import rospy
from geometry_msgs.msg import Twist
from harness import RosTest
from husky_highlevel_controller.msg import HuskyStatus
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

CONTROLLER = "husky_highlevel_controller"


class RobotLaunchDrives(RosTest):
    def test_it_stands_until_it_is_started_and_then_arrives(self):
        self.assertFalse(rospy.get_param("/use_sim_time"), "on wall time")
        scans = self.remember("front/scan", LaserScan)
        status = self.remember("status", HuskyStatus)
        truth = self.remember("ground_truth/odom", Odometry)
        commands = self.remember("cmd_vel", Twist)
        arrived = self.remember(f"{CONTROLLER}/arrived", Bool)

        self.wait_until(lambda: len(scans) > 50 and len(commands) > 50 and status, "the robot is up")
        scan = scans[-1]
        self.assertEqual((len(scan.ranges), len(scan.intensities)), (541, 541))
        self.assertIn(0.0, scan.ranges, "misses read 0")
        self.assertAlmostEqual(scan.time_increment, 0.5 / 360 / 50, delta=1e-7)
        self.assertTrue(all(command == Twist() for command in commands), "it waits for its start service")
        self.assertLess(abs(truth[-1].pose.pose.position.x - 17.0), 0.01)

        start = rospy.ServiceProxy(f"{CONTROLLER}/start_stop", SetBool)
        self.assertTrue(start(True).success)
        self.wait_until(lambda: arrived and arrived[-1].data, "it has arrived", 60.0)
        self.wait(1.0)

        at = truth[-1].pose.pose.position
        surface = hypot(at.x + 0.337 - 20.0, at.y - 5.0) - 0.2
        self.assertAlmostEqual(surface, 0.4, delta=0.05)
        self.assertLessEqual(max(command.linear.x for command in commands), 0.5, "slow limits")
        self.assertGreater(max(message.left_driver_current for message in status), 1.0)
        self.assertFalse(status[-1].e_stop)
