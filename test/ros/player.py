"""Shared by rostest scripts that stand in for the robot: made-up scans and poses for the controller."""

from math import cos, inf, pi, sin, sqrt

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped, Twist
from harness import RosTest
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

BEAMS, HALF_VIEW = 720, 2.35619
LASER_X = 0.337  # [m], of the lidar in base_link
PERIOD = 0.1  # [s] between two scans
NODE = "husky_highlevel_controller"
NOTHING = [inf] * BEAMS


def bearings():
    return [-HALF_VIEW + i * 2.0 * HALF_VIEW / (BEAMS - 1) for i in range(BEAMS)]


def pillar_ahead(distance, radius=0.2):
    """The ranges of a lidar that sees nothing but a pillar straight ahead, its surface at a distance [m]."""
    ranges, centre = [], distance + radius
    for angle in bearings():
        inside = radius**2 - (centre * sin(angle)) ** 2
        is_hit = inside > 0.0 and abs(angle) < pi / 2.0
        ranges.append(centre * cos(angle) - sqrt(inside) if is_hit else inf)
    return ranges


def transform(parent, child, stamp, x=0.0, y=0.0, yaw=0.0):
    msg = TransformStamped(child_frame_id=child)
    msg.header.frame_id, msg.header.stamp = parent, stamp
    msg.transform.translation.x, msg.transform.translation.y = x, y
    msg.transform.rotation.z, msg.transform.rotation.w = sin(yaw / 2.0), cos(yaw / 2.0)
    return msg


class Player(RosTest):
    """A test case that is a robot; its scans are stamped by a clock of its own."""

    moment = 1000.0  # [s], of the last scan, in any test
    played_by = None  # the test case that the controller has seen last
    frame = "front_laser"  # of the scans

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.static = tf2_ros.StaticTransformBroadcaster()
        upside_down = transform("base_link", "front_laser", rospy.Time(), x=LASER_X)
        upside_down.transform.rotation.x, upside_down.transform.rotation.w = 1.0, 0.0
        cls.static.sendTransform([upside_down])

    def setUp(self):
        self.commands = self.remember("cmd_vel", Twist)
        self.scans = self.publisher("front/scan", LaserScan)
        self.transforms = self.publisher("/tf", TFMessage)
        self.stand_at()
        if Player.played_by not in (None, type(self)):
            self.make_it_forget()
        Player.played_by = type(self)

    def make_it_forget(self):
        """A scan that is older than the last makes the controller forget: another robot begins."""
        self.answer(NOTHING)
        Player.moment -= 2.0 * PERIOD
        self.answer(NOTHING)

    def stand_at(self, x=0.0, y=0.0, yaw=0.0):
        """Where the robot is from now on."""
        self.pose = (x, y, yaw)

    def tell_pose(self, moment):
        stamp = rospy.Time.from_sec(moment)
        self.transforms.publish(TFMessage([transform("odom", "base_link", stamp, *self.pose)]))

    def send(self, ranges):
        """A scan, and where the robot was."""
        Player.moment += PERIOD
        self.tell_pose(Player.moment)
        msg = LaserScan(angle_min=-HALF_VIEW, angle_max=HALF_VIEW, range_min=0.1, range_max=30.0)
        msg.angle_increment = 2.0 * HALF_VIEW / (BEAMS - 1)
        msg.header.frame_id = self.frame
        msg.header.stamp = rospy.Time.from_sec(Player.moment)
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
