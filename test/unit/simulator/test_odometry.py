"""Dead reckoning: forward speed from the wheels, heading from the gyro."""

from __future__ import annotations

from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.datatypes import Odometry, Pose2D, Twist2D
from husky_highlevel_controller.geometry import advance, wrap_angle
from husky_highlevel_controller.simulator.odometry import advance_odometry

ORIGIN = Pose2D()
LAW = settings(derandomize=True, deadline=None, max_examples=60)


def drive(twist, yaw_rate, duration, start=ORIGIN, steps=50):
    """The odometry of a robot whose wheels turn for `twist` while its gyro feels `yaw_rate`."""
    odometry = Odometry(start)
    for _ in range(steps):
        odometry = advance_odometry(odometry, Twist2D(twist.linear, yaw_rate), duration / steps)
    return odometry


def assert_pose(pose, x, y, yaw):
    assert (pose.x, pose.y) == pytest.approx((x, y), abs=1e-9)
    assert wrap_angle(pose.yaw - yaw) == pytest.approx(0.0, abs=1e-9)


@LAW
@given(
    st.builds(Pose2D, st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), st.floats(-3.0, 3.0)),
    st.floats(-1.0, 1.0),
    st.floats(-2.0, 2.0),
)
def test_a_robot_that_moves_as_its_wheels_say_is_where_its_twist_leads(start, linear, angular):
    twist = Twist2D(linear, angular)
    odometry = drive(twist, angular, 0.4, start, steps=8)
    expected = advance(start, twist, 0.4)
    assert_pose(odometry.pose_base_in_odom, expected.x, expected.y, expected.yaw)
    reported = odometry.twist_in_base
    assert (reported.linear, reported.angular) == pytest.approx((linear, angular), abs=1e-12)


@pytest.mark.parametrize(
    ("start", "twist", "yaw_rate", "seconds", "end"),
    [
        (ORIGIN, Twist2D(0.5, 0.0), 0.0, 2.0, (1.0, 0.0, 0.0)),
        (ORIGIN, Twist2D(0.0, 2.0), 0.5, pi, (0.0, 0.0, pi / 2.0)),
        (ORIGIN, Twist2D(), -1.0, 1.0, (0.0, 0.0, -1.0)),
        (Pose2D(1.1, -2.2, 0.3), Twist2D(), 0.0, 1.0, (1.1, -2.2, 0.3)),
    ],
    ids=["a straight metre", "wheels that skid do not turn it", "shoved around it turns", "at rest it stays"],
)
def test_wheels_tell_the_way_and_the_gyro_the_heading(start, twist, yaw_rate, seconds, end):
    odometry = drive(twist, yaw_rate, seconds, start)
    assert_pose(odometry.pose_base_in_odom, *end)
    assert odometry.twist_in_base.angular == yaw_rate
