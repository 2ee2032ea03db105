"""Without a transform from the lidar to base_link the robot stands still, and the log says what it lacks."""

from math import pi

import rospy
import tf2_ros
from geometry_msgs.msg import Twist
from harness import stamp
from player import LASER_X, NODE, Player, pillar_ahead, transform
from rosgraph_msgs.msg import Log
from visualization_msgs.msg import Marker


class WaitsForTransforms(Player):
    def test_a_scan_is_placed_by_the_pose_of_its_own_moment(self):
        markers = self.remember(f"{NODE}/visualization_marker", Marker)
        Player.moment = 0.0  # a stamp of 0 is no sign of a pose that is fixed for good
        self.tell_pose(Player.moment)
        stood = [0.2 * scan for scan in range(1, 11)]
        for x in stood:
            self.stand_at(x)
            self.answer(pillar_ahead(3.0), pose_first=False)
        self.wait_until(lambda: len(places(markers)) == len(stood), "every scan is shown")
        for x, place in zip(stood, places(markers)):
            self.assertAlmostEqual(place, x + LASER_X + 3.2, delta=0.01)

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


def places(markers):
    """Where each scan's pillar was shown in odom [m]; to whoever has just subscribed one is shown twice."""
    shown = {stamp(marker): marker for marker in list(markers) if marker.ns == "pillar_in_odom"}
    return [marker.pose.position.x for marker in shown.values()]
