"""Both odometries on a drive: how far they are from the truth."""

from math import dist

import pytest
from stage import HUSKY, drive

from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.geometry import compose, inverse, pose_from_2d, wrap_angle, yaw_from_quat

START = Pose2D(3.0, -2.0, 1.0)


def errors(snapshot, believed):
    """Distance [m] and angle [rad] between where the robot is and where an odometry believes it is."""
    moved = compose(inverse(pose_from_2d(START)), snapshot.robot.pose_in_world)
    pose = believed.pose_base_in_odom
    away = dist((pose.x, pose.y), moved.position[:2])
    return away, abs(wrap_angle(pose.yaw - yaw_from_quat(moved.quat_xyzw)))


def test_both_odometries_keep_to_the_truth_straight_on_and_the_wheels_lose_it_where_they_skid(simulate):
    simulation = simulate(robot=HUSKY, start=START, seed=3)
    straight = drive(simulation, 20.0, 1.0)[-1]
    for believed in (straight.odometry.from_wheels, straight.odometry.filtered):
        away, turned = errors(straight, believed)
        assert away < 0.1
        assert 1e-5 < turned < 0.01, "gyro and wheels have noise"
    curve = drive(simulation, 20.0, 0.5, 0.5)[-1]
    assert errors(curve, curve.odometry.from_wheels)[1] > 0.05
    assert errors(curve, curve.odometry.filtered)[1] < 0.02
    for believed in (curve.odometry.from_wheels, curve.odometry.filtered):
        assert believed.twist_in_base == (pytest.approx(0.5, abs=0.02), pytest.approx(0.5, abs=0.03))
