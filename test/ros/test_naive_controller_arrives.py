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

        newest = {marker.ns: marker for marker in markers}
        self.assertEqual(
            {name: marker.header.frame_id for name, marker in newest.items()},
            {"pillar_in_laser": "front_laser", "pillar_in_odom": "odom"},
        )
        in_laser, in_odom = newest["pillar_in_laser"].pose.position, newest["pillar_in_odom"].pose.position
        self.assertAlmostEqual(hypot(in_laser.x, in_laser.y), nearest(), delta=0.02)
        # its surface, 0.2 m from its axis; odom begins where the robot does
        self.assertLess(hypot(in_odom.x - PILLAR[0], in_odom.y - PILLAR[1]), 0.3)
        first = next(marker for marker in markers if marker.ns == "pillar_in_odom").pose.position
        self.assertLess(hypot(first.x - PILLAR[0], first.y - PILLAR[1]), 0.3, "while it turns, too")
