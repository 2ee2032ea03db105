"""Passes a simulator's messages on, all good but those of one topic, which are spoilt as /fault says.

The simulator publishes its topics in /good, so nothing but what comes from here reaches the robot's nodes.
"""

from io import BytesIO
from math import inf, nan

import rospy
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

TOPICS = {
    "front/scan": LaserScan,
    "tf": TFMessage,
    "tf_static": TFMessage,
    "odometry/filtered": Odometry,
    "clock": Clock,
}


def fill(value):
    def spoil(scan):
        scan.ranges = [value] * len(scan.ranges)

    return spoil


def spoil_rotation(msg):
    for each in msg.transforms:
        each.transform.rotation = Quaternion(nan, nan, nan, nan)


def spoil_place(msg):
    for each in msg.transforms:
        each.transform.translation.x = inf


def spoil_velocity(msg):
    msg.twist.twist.linear.x = msg.twist.twist.angular.z = nan


def set_back(msg):
    msg.clock -= rospy.Duration(1.0)


FAULTS = {  # by name: a topic, and what is done to its messages
    "scans of NaN": ("front/scan", fill(nan)),
    "scans of inf": ("front/scan", fill(inf)),
    "scans of 0": ("front/scan", fill(0.0)),
    "no rotation": ("tf", spoil_rotation),
    "an infinite place": ("tf", spoil_place),
    "velocities of NaN": ("odometry/filtered", spoil_velocity),
    "a clock that is set back": ("clock", set_back),
    "an infinite lidar": ("tf_static", spoil_place),
}


class BadPeer:
    """Passes on and spoils."""

    def __init__(self):
        self._fault, self._fixed = "", None
        self._publishers = {
            topic: rospy.Publisher(f"/{topic}", kind, queue_size=100, latch=topic == "tf_static")
            for topic, kind in TOPICS.items()
        }
        for topic, kind in TOPICS.items():
            rospy.Subscriber(f"/good/{topic}", kind, self._pass_on, topic, queue_size=100, tcp_nodelay=True)
        rospy.Subscriber("/fault", String, self._on_fault)

    def _on_fault(self, msg):
        self._fault = msg.data
        if self._fixed is not None:  # it comes once only
            self._pass_on(TFMessage().deserialize(self._fixed), "tf_static")

    def _pass_on(self, msg, topic):
        if topic == "tf_static" and self._fixed is None:
            buffer = BytesIO()
            msg.serialize(buffer)
            self._fixed = buffer.getvalue()
        spoilt, spoil = FAULTS.get(self._fault, ("", None))
        if topic == spoilt:
            spoil(msg)
        self._publishers[topic].publish(msg)


if __name__ == "__main__":
    rospy.init_node("bad_peer", disable_rostime=True)
    peer = BadPeer()
    rospy.spin()
