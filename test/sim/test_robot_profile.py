"""profile:=robot, held to what was measured on real Huskies (docs/truth.md)."""

from dataclasses import replace

import numpy as np
import pytest
from stage import drive

from husky_evaluation.rollout import model_of
from husky_highlevel_controller.datatypes import HuskyError, Pose
from husky_highlevel_controller.simulator.profile import RobotProfile
from husky_highlevel_controller.simulator.simulator_config import simulator_config

TRACK, RADIUS = 0.5708, 0.1651
GAZEBO = simulator_config()
HARD, SOFT = (replace(GAZEBO, real=RobotProfile().on(ground)) for ground in ("hard", "soft"))


@pytest.fixture
def simulate(simulate):
    return lambda config: simulate(
        config=config, robot=model_of(config.robot, "robot" if config.real else "gazebo")
    )


def steady(simulation, *twist):
    """Snapshots of the second half of 4 s."""
    return drive(simulation, 4.0, *twist)[400:]


def with_friction(friction):
    ground = replace(HARD.real.ground, friction=friction)
    return replace(HARD, real=replace(HARD.real, hard=ground))


def effective_track(snapshots):
    """Difference of the sides' speeds over the true yaw rate, over the wheel separation."""
    speeds = np.array([s.odometry.wheels.angles for s in snapshots if s.odometry])
    turned = (speeds[-1] - speeds[0]) * RADIUS
    yaw = sum(s.robot.angular_velocity_in_base[2] for s in snapshots) / 200.0
    return (turned[[1, 3]].mean() - turned[[0, 2]].mean()) / yaw / TRACK


def currents(snapshots):
    return np.mean([sum(s.power.currents) for s in snapshots if s.power])


TURNS = [(0.0, 0.2), (0.0, 0.5), (0.24, 0.25), (0.5, 0.5), (0.5, -0.5)]


@pytest.mark.parametrize("twist", TURNS)
@pytest.mark.parametrize(
    ("config", "low", "high"), [(HARD, 1.70, 1.85), (SOFT, 1.9, 2.4)], ids=["hard ground", "soft ground"]
)
def test_the_effective_track_is_as_measured(config, low, high, twist, simulate):
    assert low <= effective_track(steady(simulate(config), *twist)) <= high


def test_on_hard_ground_the_track_hardly_depends_on_friction(simulate):
    tracks = [effective_track(steady(simulate(with_friction(mu)), 0.0, 0.5)) for mu in (0.3, 0.6, 1.0)]
    assert max(tracks) - min(tracks) < 0.02


@pytest.mark.parametrize(
    ("config", "twist", "measured", "within"),
    [
        (HARD, (0.3, 0.0), 3.9, 0.1),  # flooring
        (HARD, (1.0, 0.0), 3.8, 0.1),  # asphalt
        (HARD, (0.0, 0.5), 18.0, 0.1),  # flooring; the one figure that torque_per_ampere is fitted to
        (SOFT, (0.3, 0.0), 7.5, 0.1),  # loam
        (SOFT, (0.0, 0.5), 23.0, 0.1),  # loam
        (with_friction(0.25), (0.0, 0.5), 7.2, 0.15),  # ice
    ],
)
def test_the_motors_draw_the_measured_currents(simulate, config, twist, measured, within):
    assert currents(steady(simulate(config), *twist)) == pytest.approx(measured, rel=within)


@pytest.mark.parametrize(
    ("config", "twist", "speed", "within"),
    [
        (HARD, (1.0, 1.0), 0.65, 0.02),  # scaled as the real base does
        *[(HARD, (0.5, side), 0.5, 0.025) for side in (1.0, -1.0)],  # its mass is in the middle
        (GAZEBO, (0.5, 1.0), 0.591, 0.0177),  # the published mass
        (GAZEBO, (0.5, -1.0), 0.436, 0.0131),
    ],
)
def test_turns_change_the_speed_as_measured(config, twist, speed, within, simulate):
    speeds = [snapshot.robot.velocity_in_base[0] for snapshot in steady(simulate(config), *twist)]
    assert np.mean(speeds) == pytest.approx(speed, abs=within)


def test_rates_are_the_real_drivers(simulate):
    snapshots = drive(simulate(HARD), 2.0, 0.5, 0.2)
    wheels = [s.odometry.wheels for s in snapshots if s.odometry]
    readings = 1 + sum(now is not before for before, now in zip(wheels, wheels[1:]))
    assert readings == pytest.approx(20, abs=1), "wheels are read at 10 Hz"
    assert len(wheels) == sum(s.scan is not None for s in snapshots) == 100
    assert sum(s.power is not None for s in snapshots) == 20
    assert sum(s.mag is not None for s in snapshots) == sum(s.imu is not None for s in snapshots) == 100
    assert all(s.mag is None and s.power is None for s in drive(simulate(GAZEBO), 0.2))


@pytest.mark.parametrize("steps", [0, 2, 10])
@pytest.mark.parametrize("config", [HARD, GAZEBO], ids=["robot", "gazebo"])
def test_odom_stays_when_a_robot_that_drives_is_put_elsewhere(config, steps, simulate):
    simulation = simulate(config)
    drive(simulation, 2.06, 1.0)
    before = simulation.pose_world_in_odom
    drive(simulation, steps * simulation.dt, 1.0)
    simulation.move("husky", Pose((0.0, 3.0, 0.0)))
    drive(simulation, 1.0)
    after = simulation.pose_world_in_odom
    assert after.position == pytest.approx(before.position, abs=0.01)


def peak(simulation, *twists):
    """Largest horizontal specific force [m/s^2] in the last of some seconds of driving."""
    drive(simulation, 1.0)
    for twist in twists[:-1]:
        drive(simulation, 1.0, *twist)
    return max(np.hypot(*s.imu.specific_force[:2]) for s in drive(simulation, 1.0, *twists[-1]) if s.imu)


QUIET = {"imu": replace(GAZEBO.imu, acceleration_noise=0.0, rate_noise=0.0)}


def test_more_than_the_limit_is_felt_where_a_turn_ends(simulate):
    """While the tyres slide sideways they hold less lengthwise, and make up for it when the turn ends."""
    quiet = replace(GAZEBO, **QUIET)
    assert peak(simulate(quiet), (1.0, 0.0)) == pytest.approx(3.0, abs=0.01)
    assert 3.5 < peak(simulate(quiet), (0.0, 1.0), (1.0, 0.0)) < 4.0
    assert peak(simulate(quiet), (0.5, 0.0), (1.0, 0.0)) == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize("rate", [100, 200])
def test_scans_faster_than_a_sweep_of_the_lidar_are_refused_by_name(simulate, rate):
    # the first stamp would be before time begins
    with pytest.raises(HuskyError, match=f"scan_rate = {rate} Hz is too fast, because a sweep.*15.0 ms"):
        simulate(replace(HARD, scan_rate=rate))
