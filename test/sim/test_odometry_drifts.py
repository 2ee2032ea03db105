"""Both odometries on a drive: how far they are from the truth."""

from math import cos, hypot, sin

import pytest
from stage import GROUND, HUSKY, drive

from husky_highlevel_controller.datatypes import Pose2D, World
from husky_highlevel_controller.geometry import wrap_angle, yaw_from_quat
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import simulator_config

START = Pose2D(3.0, -2.0, 1.0)


def errors(snapshot, believed):
    """Distance [m] and angle [rad] between where the robot is and where an odometry believes it is."""
    x, y, _ = snapshot.robot.pose_in_world.position
    dx, dy, turned = (
        x - START.x,
        y - START.y,
        yaw_from_quat(snapshot.robot.pose_in_world.quat_xyzw) - START.yaw,
    )
    c, s = cos(START.yaw), sin(START.yaw)
    pose = believed.pose_base_in_odom
    away = hypot(pose.x - (dx * c + dy * s), pose.y - (dy * c - dx * s))
    return away, abs(wrap_angle(pose.yaw - turned))


@pytest.fixture
def simulation():
    made = Simulation(World("w", (GROUND,)), HUSKY, simulator_config(), START, 3)
    yield made
    made.close()


def test_the_fused_odometry_keeps_to_the_truth_on_a_drive_as_long_as_to_the_pillar(simulation):
    drive(simulation, 1.0, 0.0, 0.25)
    snapshot = drive(simulation, 20.0, 1.0)[-1]
    away, turned = errors(snapshot, snapshot.odometry.filtered)
    assert away < 0.1
    assert 1e-5 < turned < 0.02, "the gyro has noise"


def test_the_wheels_alone_lose_their_way_where_they_skid(simulation):
    snapshot = drive(simulation, 20.0, 1.0, 0.5)[-1]
    _, by_wheels = errors(snapshot, snapshot.odometry.from_wheels)
    _, with_gyro = errors(snapshot, snapshot.odometry.filtered)
    assert by_wheels > 0.05
    assert with_gyro < 0.02


def test_straight_on_the_wheels_know_the_way(simulation):
    snapshot = drive(simulation, 5.0, 1.0)[-1]
    away, turned = errors(snapshot, snapshot.odometry.from_wheels)
    assert away < 0.05
    assert turned < 0.01


def test_both_tell_speeds_in_base_link(simulation):
    snapshot = drive(simulation, 4.0, 0.5, 0.5)[-1]
    for odometry in (snapshot.odometry.from_wheels, snapshot.odometry.filtered):
        assert odometry.twist_in_base.linear == pytest.approx(0.5, abs=0.02)
        assert odometry.twist_in_base.angular == pytest.approx(0.5, abs=0.03)
