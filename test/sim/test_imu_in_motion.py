"""The IMU on the simulated Husky: gravity, driving, crashes, rates, repetition."""

from dataclasses import replace
from math import cos, inf, radians, sin

import numpy as np
import pytest
from stage import BLIND, GROUND, HUSKY, body, drive

from husky_highlevel_controller.controller.crash_detection import CrashConfig, CrashDetector
from husky_highlevel_controller.datatypes import (
    Box,
    Cylinder,
    HuskyError,
    Plane,
    Pose2D,
    World,
)
from husky_highlevel_controller.geometry import rotate
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import simulator_config

QUIET = replace(
    simulator_config(), imu=replace(simulator_config().imu, acceleration_noise=0.0, rate_noise=0.0)
)


@pytest.fixture
def simulate():
    """Makes simulations and closes them."""
    made = []

    def make(*bodies, robot=BLIND, config=QUIET, seed=0):
        made.append(Simulation(World("w", bodies), robot, config, Pose2D(), seed))
        return made[-1]

    yield make
    for simulation in made:
        simulation.close()


def samples(*args, **kwargs):
    return [snapshot.imu for snapshot in drive(*args, **kwargs) if snapshot.imu is not None]


def forces(*args, **kwargs):
    return np.array([sample.specific_force for sample in samples(*args, **kwargs)])


def mean_force(*args, **kwargs):
    return forces(*args, **kwargs).mean(axis=0)


# ---------------------------------------------------------------------------- what it feels


@pytest.mark.parametrize("heading", [0.0, 90.0, 37.0])
def test_parked_on_a_ramp_it_feels_9_8_upwards(heading, simulate):
    slope = radians(5.0)
    tilt = (slope * sin(radians(heading)), slope * cos(radians(heading)), 0.0)
    simulation = simulate(body("ramp", Plane((0.0, 0.0, 1.0), (9.0, 9.0)), rpy=tilt))
    drive(simulation, 3.0)
    for sample in samples(simulation, 1.0):
        assert rotate(sample.quat_xyzw, sample.specific_force) == pytest.approx((0.0, 0.0, 9.8), abs=0.01)
        assert sample.specific_force[2] == pytest.approx(9.8 * cos(slope), rel=0.01)


def test_falling_it_feels_nothing(simulate):
    assert forces(simulate(), 1.0) == pytest.approx(np.zeros((50, 3)), abs=0.02)


def test_speeding_up_and_braking_are_felt_forwards_and_backwards(simulate):
    simulation = simulate(GROUND)
    drive(simulation, 1.0)
    assert mean_force(simulation, 0.3, 1.0) == pytest.approx((3.0, 0.0, 9.8), abs=0.1)
    drive(simulation, 1.0, 1.0)
    assert mean_force(simulation, 1.0, 1.0) == pytest.approx((0.0, 0.0, 9.8), abs=0.01)
    assert mean_force(simulation, 0.3, 0.0) == pytest.approx((-3.0, 0.0, 9.8), abs=0.1)


@pytest.mark.parametrize("angular", [0.5, -0.5])
def test_a_curve_is_felt_as_rate_and_sideways_push(angular, simulate):
    simulation = simulate(GROUND)
    drive(simulation, 2.0, 1.0, angular)
    curve = samples(simulation, 2.0, 1.0, angular)
    rates = np.mean([sample.angular_velocity for sample in curve], axis=0)
    assert rates == pytest.approx((0.0, 0.0, angular), abs=0.03)
    assert np.mean([sample.specific_force[1] for sample in curve]) == pytest.approx(angular, abs=0.05)


# ---------------------------------------------------------------------------- crashes


def hardest(simulation, *args, detector=None, **kwargs):
    """The largest loss of speed felt as a crash [m/s]; 0 without one."""
    detector, worst = detector or CrashDetector(CrashConfig()), 0.0
    for snapshot in drive(simulation, *args, **kwargs):
        if snapshot.odometry is not None:
            detector.add_odometry(snapshot.stamp, snapshot.odometry.filtered.twist_in_base)
        if snapshot.imu is not None:
            worst = max(worst, detector.add_sample(snapshot.imu) or 0.0)
    return worst


def test_no_driving_is_a_crash(simulate):
    simulation = simulate(GROUND, config=simulator_config())
    rng, detector = np.random.default_rng(0), CrashDetector(CrashConfig())
    for _ in range(100):
        commands = rng.choice([-1.0, 0.0, 1.0]), rng.choice([-2.0, 0.0, 2.0])
        assert hardest(simulation, float(rng.choice([0.1, 0.3, 0.7])), *commands, detector=detector) == 0.0


@pytest.mark.parametrize("obstacle", [Cylinder(0.2, 2.0), Box((0.2, 4.0, 2.0))])
@pytest.mark.parametrize("speed", [0.2, 0.5, 1.0])
def test_driving_into_what_stands_fast_is_a_crash(speed, obstacle, simulate):
    simulation = simulate(GROUND, body("obstacle", obstacle, x=1.5, z=1.0), config=simulator_config())
    drive(simulation, 1.0)
    assert hardest(simulation, 1.3 / speed, speed) == pytest.approx(speed, rel=0.2)


def test_what_gives_way_is_not_felt(simulate):
    """The course's pillar weighs 1 kg, the Husky 58."""
    simulation = simulate(GROUND, body("pillar", Cylinder(0.2, 2.0), x=2.0, z=1.0, mass=1.0))
    touched = {name for snapshot in drive(simulation, 3.0, 1.0) for name in snapshot.contacts}
    assert touched == {"pillar"}
    assert hardest(simulation, 1.0, 1.0) == 0.0


# ---------------------------------------------------------------------------- rates and repetition


@pytest.mark.parametrize("rate", [50, 100, 200])
def test_samples_come_at_their_rate(rate, simulate):
    simulation = simulate(GROUND, config=replace(QUIET, imu_rate=rate))
    snapshots = [snapshot for snapshot in drive(simulation, 1.0) if snapshot.imu is not None]
    assert [snapshot.imu.stamp for snapshot in snapshots] == [snapshot.stamp for snapshot in snapshots]
    assert [snapshot.stamp for snapshot in snapshots] == pytest.approx(np.arange(1, rate + 1) / rate)


def test_a_rate_that_does_not_divide_the_physics_rate_is_refused(simulate):
    with pytest.raises(HuskyError, match="imu_rate = 60 Hz does not divide physics_rate = 200 Hz"):
        simulate(GROUND, config=replace(QUIET, imu_rate=60))


def noisy(seed):
    return {"config": simulator_config(), "seed": seed}


def test_the_same_seed_gives_the_same_samples_also_after_a_reset(simulate):
    simulation = simulate(GROUND, **noisy(5))
    first = samples(simulation, 1.0, 0.5, 0.3)
    assert samples(simulate(GROUND, **noisy(5)), 1.0, 0.5, 0.3) == first
    assert samples(simulate(GROUND, **noisy(6)), 1.0, 0.5, 0.3) != first
    stamp = simulation.stamp
    simulation.reset(seed=5)
    again = samples(simulation, 1.0, 0.5, 0.3)
    assert [sample._replace(stamp=0.0) for sample in again] == [
        sample._replace(stamp=0.0) for sample in first
    ]
    assert again[0].stamp == pytest.approx(stamp + 0.02)


def test_the_imu_s_noise_does_not_change_the_lidar_s(simulate):
    wall = body("wall", Box((0.2, 40.0, 2.0)), x=5.1, z=1.0)
    seen = []
    for rate in (50, 200):
        simulation = simulate(GROUND, wall, robot=HUSKY, config=replace(simulator_config(), imu_rate=rate))
        seen.append([s.scan.ranges.tolist() for s in drive(simulation, 0.2) if s.scan is not None])
    assert seen[0] == seen[1]
    assert len({scan[360] for scan in seen[0]} - {inf}) == len(seen[0]), "there is noise"
