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


@pytest.fixture
def simulation(simulate):
    return simulate(robot=HUSKY, start=START, seed=3)


def test_the_fused_odometry_keeps_to_the_truth_on_a_drive_as_long_as_to_the_pillar(simulation):
    drive(simulation, 1.0, 0.0, 0.25)
    snapshot = drive(simulation, 20.0, 1.0)[-1]
    away, turned = errors(snapshot, snapshot.odometry.filtered)
    assert away < 0.1
    assert 1e-5 < turned < 0.02, "the gyro has noise"


def test_the_wheels_alone_lose_their_way_where_they_skid(simulation):
    odometry = (snapshot := drive(simulation, 20.0, 1.0, 0.5)[-1]).odometry
    assert errors(snapshot, odometry.from_wheels)[1] > 0.05
    assert errors(snapshot, odometry.filtered)[1] < 0.02


def test_both_tell_speeds_in_base_link(simulation):
    odometry = drive(simulation, 4.0, 0.5, 0.5)[-1].odometry
    for told in (odometry.from_wheels, odometry.filtered):
        assert told.twist_in_base == (pytest.approx(0.5, abs=0.02), pytest.approx(0.5, abs=0.03))


def test_straight_on_the_wheels_know_the_way(simulation):
    snapshot = drive(simulation, 5.0, 1.0)[-1]
    away, turned = errors(snapshot, snapshot.odometry.from_wheels)
    assert away < 0.05
    assert turned < 0.01
