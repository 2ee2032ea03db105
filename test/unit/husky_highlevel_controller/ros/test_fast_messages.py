"""The fast messages: the same bytes as the classes that they extend."""

from io import BytesIO

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.ros.fast_messages import ArrayScan, MovingTree


def as_bytes(msg):
    buff = BytesIO()
    msg.serialize(buff)
    return buff.getvalue()


@pytest.mark.parametrize("frame", ["front_laser", "", "laser_ä"])
def test_a_scan_has_the_bytes_of_a_plain_laserscan(frame):
    ranges, intensities = [0.1, 29.999, float("inf"), 0.0, 1e-3], [0.0, 1.0, 2.5, 255.0, 3.0]
    fields = {
        "angle_min": -2.35619,
        "angle_max": 2.35619,
        "angle_increment": 0.0065,
        "time_increment": 1e-4,
        "scan_time": 0.02,
        "range_min": 0.1,
        "range_max": 30.0,
    }
    fast = ArrayScan(ranges=np.array(ranges), intensities=np.array(intensities), **fields)
    plain = LaserScan(ranges=ranges, intensities=intensities, **fields)
    for msg in (fast, plain):
        msg.header.seq, msg.header.stamp.secs, msg.header.stamp.nsecs = 7, 12, 340_000_000
        msg.header.frame_id = frame
    assert as_bytes(fast) == as_bytes(plain)


def test_a_tree_that_moves_has_the_bytes_of_a_new_tfmessage():
    branches = [("odom", "base_link"), ("base_link", "front_left_wheel_link")]
    tree = MovingTree(branches)
    for seconds, shift in ((1, 0.0), (2, 0.5)):
        poses = [Pose((shift, 1.0, 2.0), (0.0, 0.6, 0.0, 0.8)), Pose((0.25, -shift, 0.03))]
        tree.move(seconds, 20_000_000, poses)
        plain = TFMessage()
        for (parent, child), pose in zip(branches, poses):
            msg = TransformStamped(child_frame_id=child)
            msg.header.frame_id = parent
            msg.header.stamp.secs, msg.header.stamp.nsecs = seconds, 20_000_000
            msg.transform.translation = Vector3(*pose.position)
            msg.transform.rotation = Quaternion(*pose.quat_xyzw)
            plain.transforms.append(msg)
        assert as_bytes(tree) == as_bytes(plain)
