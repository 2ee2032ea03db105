"""Messages to readings, and estimates to messages."""

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion, Vector3
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from husky_highlevel_controller.estimation.planar_ekf import MotionEstimate
from husky_highlevel_controller.ros.estimation.node import estimate_to_msg, reading_from_msg


def test_a_part_that_an_imu_does_not_measure_is_none():
    msg = Imu(angular_velocity=Vector3(0.1, 0.2, 0.3), angular_velocity_covariance=np.arange(9.0).tolist())
    msg.orientation_covariance = msg.linear_acceleration_covariance = [-1.0] + [0.0] * 8
    msg.orientation.w = 1.0
    reading = reading_from_msg(msg)
    assert reading.pose is None
    assert reading.specific_force is None
    assert reading.velocity.tolist() == [0.0, 0.0, 0.0, 0.1, 0.2, 0.3]
    assert reading.velocity_covariance[3:, 3:].ravel().tolist() == np.arange(9.0).tolist()


@pytest.mark.parametrize(("quaternion", "expected"), [((0, 0, 0, 0), None), ((0, 0, 0, 2), (0, 0, 0, 1))])
def test_a_quaternion_of_zeros_is_no_attitude_and_a_long_one_is_shortened(quaternion, expected):
    pose = reading_from_msg(Imu(orientation=Quaternion(*quaternion))).pose
    assert (pose and pose.quat_xyzw) == expected


def test_an_estimate_says_where_how_fast_and_how_sure():
    msg = estimate_to_msg(MotionEstimate(1.5, np.arange(8.0), np.diag(np.arange(1.0, 9.0))), "odom", "base")
    assert (msg.header.stamp.to_sec(), msg.header.frame_id, msg.child_frame_id) == (1.5, "odom", "base")
    assert (msg.pose.pose.position.x, msg.pose.pose.position.y) == (0.0, 1.0)
    assert (msg.twist.twist.linear.x, msg.twist.twist.linear.y, msg.twist.twist.angular.z) == (3.0, 4.0, 5.0)
    assert np.diag(np.reshape(msg.pose.covariance, (6, 6))).tolist() == [1, 2, 1e-6, 1e-6, 1e-6, 3]
    assert np.diag(np.reshape(msg.twist.covariance, (6, 6))).tolist() == [4, 5, 1e-6, 1e-6, 1e-6, 6]
    assert reading_from_msg(Odometry(pose=msg.pose, twist=msg.twist)).velocity[5] == 5.0
