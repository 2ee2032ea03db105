"""profile:=robot, held to what was measured on real Huskies (docs/truth.md)."""

from dataclasses import replace

import numpy as np
import pytest
from stage import GROUND

from husky_highlevel_controller.datatypes import HuskyError, Pose2D, Twist2D, World
from husky_highlevel_controller.evaluation.rollout import model_of
from husky_highlevel_controller.simulator.profile import RobotProfile
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import simulator_config

TRACK, RADIUS = 0.5708, 0.1651
GAZEBO = simulator_config()
HARD, SOFT = (replace(GAZEBO, real=RobotProfile().on(ground)) for ground in ("hard", "soft"))


@pytest.fixture
def simulate():
    """Makes simulations of an empty plane, and closes them."""
    made = []

    def make(config, robot=None):
        robot = robot or model_of(config.robot, "robot" if config.real else "gazebo")
        made.append(Simulation(World("w", (GROUND,)), robot, config, Pose2D(), 0))
        return made[-1]

    yield make
    for simulation in made:
        simulation.close()


def drive(simulation, seconds, *twist):
    snapshots = []
    for _ in range(round(seconds / simulation.dt)):
        simulation.command(Twist2D(*twist))
        snapshots.append(simulation.step())
    return snapshots


def steady(simulation, *twist):
    """Snapshots of the second half of 4 s."""
    return drive(simulation, 4.0, *twist)[400:]


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
def test_on_hard_ground_the_effective_track_is_as_measured(simulate, twist):
    assert 1.70 <= effective_track(steady(simulate(HARD), *twist)) <= 1.85


@pytest.mark.parametrize("twist", TURNS)
def test_on_soft_ground_the_effective_track_is_as_measured(simulate, twist):
    assert 1.9 <= effective_track(steady(simulate(SOFT), *twist)) <= 2.4


def test_on_hard_ground_the_track_hardly_depends_on_friction(simulate):
    def with_friction(mu):
        real = HARD.real
        return replace(HARD, real=replace(real, ground=replace(real.ground, friction=mu)))

    tracks = [effective_track(steady(simulate(with_friction(mu)), 0.0, 0.5)) for mu in (0.3, 0.6, 1.0)]
    assert max(tracks) - min(tracks) < 0.02


@pytest.mark.parametrize(
    ("config", "twist", "measured"),
    [
        (HARD, (0.3, 0.0), 3.9),  # flooring
        (HARD, (1.0, 0.0), 3.8),  # asphalt
        (HARD, (0.0, 0.5), 18.0),  # flooring; the one figure that torque_per_ampere is fitted to
        (SOFT, (0.3, 0.0), 7.5),  # loam
        (SOFT, (0.0, 0.5), 23.0),  # loam
    ],
)
def test_the_motors_draw_the_measured_currents(simulate, config, twist, measured):
    assert currents(steady(simulate(config), *twist)) == pytest.approx(measured, rel=0.1)


def test_on_ice_turning_draws_the_measured_current(simulate):
    ground = replace(HARD.real.ground, friction=0.25)
    ice = replace(HARD, real=replace(HARD.real, ground=ground))
    assert currents(steady(simulate(ice), 0.0, 0.5)) == pytest.approx(7.2, rel=0.15)


def test_a_fast_turn_is_scaled_as_the_real_base_does(simulate):
    speed = np.mean([s.robot.velocity_in_base[0] for s in steady(simulate(HARD), 1.0, 1.0)])
    assert speed == pytest.approx(0.65, abs=0.02), "commanded 1.0 m/s and 1.0 rad/s"


@pytest.mark.parametrize("angular", [1.0, -1.0])
def test_turning_does_not_change_the_speed_of_a_centred_mass(simulate, angular):
    real, gazebo = (
        np.mean([s.robot.velocity_in_base[0] for s in steady(simulate(config), 0.5, angular)])
        for config in (HARD, GAZEBO)
    )
    assert real == pytest.approx(0.5, rel=0.05)
    assert gazebo == pytest.approx(0.591 if angular > 0.0 else 0.436, rel=0.03), (
        "the published mass: Gazebo's"
    )


def test_rates_are_the_real_drivers(simulate):
    snapshots = drive(simulate(HARD), 2.0, 0.5, 0.2)
    wheels = [s.odometry.wheels for s in snapshots if s.odometry]
    readings = 1 + sum(now is not before for before, now in zip(wheels, wheels[1:]))
    assert readings == pytest.approx(20, abs=1), "wheels are read at 10 Hz"
    assert len(wheels) == sum(s.scan is not None for s in snapshots) == 100
    assert sum(s.power is not None for s in snapshots) == 20
    assert sum(s.mag is not None for s in snapshots) == sum(s.imu is not None for s in snapshots) == 100
    assert all(s.mag is None and s.power is None for s in drive(simulate(GAZEBO), 0.2))


def test_the_same_seed_repeats_a_run_to_the_bit_and_so_does_a_reset(simulate):
    def run(simulation):
        last = drive(simulation, 1.0, 0.5, 0.3)[-1]
        return last.robot, last.imu.specific_force, last.scan.ranges.tolist(), last.power, last.mag.field

    first, second = simulate(SOFT), simulate(SOFT)
    outcome = run(first)
    assert run(second) == outcome
    first.reset()
    assert run(first) == outcome


# ---------------------------------------------------------------------------- the IMU's 3.9 m/s^2


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
    with pytest.raises(HuskyError, match=f"scan_rate = {rate} Hz is faster than a sweep.*15.0 ms"):
        simulate(replace(HARD, scan_rate=rate))
