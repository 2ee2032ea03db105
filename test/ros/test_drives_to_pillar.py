"""The Husky arrives at the pillar, touches nothing, and marks the pillar where it is."""

from math import asin, hypot

from geometry_msgs.msg import Twist
from harness import RosTest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from visualization_msgs.msg import Marker

PILLAR, RADIUS, STOP_DISTANCE = (20.0, 5.0), 0.2, 0.4


class DrivesToPillar(RosTest):
    def test_arrives_in_front_of_the_pillar(self):
        truth = self.remember("ground_truth/odom", Odometry)
        scans = self.remember("front/scan", LaserScan)
        markers = self.remember("husky_highlevel_controller/visualization_marker", Marker)
        commands = self.remember("cmd_vel", Twist)
        filtered = self.remember("odometry/filtered", Odometry)
        arrived = self.remember("husky_highlevel_controller/arrived", Bool)

        self.resume()
        self.wait_until(lambda: arrived and arrived[-1].data, "it has arrived", 60.0)
        self.wait(1.0)

        self.assertEqual(commands[-1], Twist(), "it stands still once it has arrived")
        self.assertLess(abs(truth[-1].twist.twist.linear.x), 1e-3)
        nearest = min(r for r in scans[-1].ranges if r > 0.0)
        self.assertAlmostEqual(nearest, STOP_DISTANCE, delta=0.05)

        closest = min(hypot(m.pose.pose.position.x - 20.0, m.pose.pose.position.y - 5.0) for m in truth)
        self.assertGreater(closest, 0.4937 + RADIUS, "no part of the robot is where the pillar is")

        true, believed = truth[-1].pose.pose, filtered[-1].pose.pose
        away = hypot(true.position.x - believed.position.x, true.position.y - believed.position.y)
        self.assertLess(away, 0.10, "odometry/filtered knows where it is")
        turned = 2.0 * (asin(true.orientation.z) - asin(believed.orientation.z))
        self.assertLess(abs(turned), 0.02)

        in_odom = [m for m in markers if m.header.frame_id == "odom" and m.action == Marker.ADD]
        self.assertGreater(len(in_odom), 500, "the pillar is marked all the way")
        for marker in in_odom:
            at = marker.pose.position
            self.assertLess(hypot(at.x - PILLAR[0], at.y - PILLAR[1]), RADIUS, "odom drifts a little")
            self.assertEqual(marker.pose.orientation.w, 1.0)
        in_laser = [m for m in markers if m.header.frame_id == "front_laser" and m.action == Marker.ADD]
        self.assertGreater(len(in_laser), 500)
        self.assertNotEqual({m.ns for m in in_odom}, {m.ns for m in in_laser})
