"""The bare node of examples/, launched with naive:=true, gets to the pillar and marks it."""

from math import hypot

from geometry_msgs.msg import Twist
from harness import RosTest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import Marker

PILLAR = (20.0, 5.0)


class NaiveControllerArrives(RosTest):
    def test_it_stands_near_the_pillar_in_the_end(self):
        truth = self.remember("ground_truth/odom", Odometry)
        scans = self.remember("front/scan", LaserScan)
        commands = self.remember("cmd_vel", Twist)
        markers = self.remember("husky_highlevel_controller/visualization_marker", Marker)

        def nearest():
            return min(r for r in scans[-1].ranges if r > 0.0) if scans else 99.0

        self.resume()
        self.wait_until(lambda: nearest() < 0.45, "it is near", 90.0)
        self.wait(3.0)
        self.assertGreater(nearest(), 0.3, "it does not push the pillar")
        self.assertLess(commands[-1].linear.x, 0.05)
        self.assertLess(abs(truth[-1].twist.twist.linear.x), 0.05, "it stands")
        place = truth[-1].pose.pose.position
        self.assertLess(hypot(place.x - PILLAR[0], place.y - PILLAR[1]), 1.2)

        marker = markers[-1]
        self.assertEqual(marker.header.frame_id, "front_laser")
        self.assertAlmostEqual(hypot(marker.pose.position.x, marker.pose.position.y), nearest(), delta=0.02)
