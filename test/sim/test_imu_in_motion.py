"""The IMU on the simulated Husky: gravity, driving, crashes, rates, repetition."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from stage import HUSKY, body, drive

from husky_highlevel_controller.controller.crash_detection import CrashConfig, CrashDetector
from husky_highlevel_controller.datatypes import Box, Cylinder
from husky_highlevel_controller.simulator.simulator_config import simulator_config

QUIET = replace(
    simulator_config(), imu=replace(simulator_config().imu, acceleration_noise=0.0, rate_noise=0.0)
)


def samples(*args, **kwargs):
    """(N, 6): specific forces [m/s^2] and turning rates [rad/s]."""
    taken = [snapshot.imu for snapshot in drive(*args, **kwargs) if snapshot.imu is not None]
    return np.array([sample.specific_force + sample.angular_velocity for sample in taken])


def mean_force(*args, **kwargs):
    return samples(*args, **kwargs)[:, :3].mean(axis=0)


def test_speeding_up_braking_and_curves_are_felt(simulate):
    simulation = simulate(config=QUIET)
    drive(simulation, 1.0)
    assert mean_force(simulation, 0.3, 1.0) == pytest.approx((3.0, 0.0, 9.8), abs=0.1)
    drive(simulation, 1.0, 1.0)
    assert mean_force(simulation, 1.0, 1.0) == pytest.approx((0.0, 0.0, 9.8), abs=0.01)
    for side in (0.5, -0.5):
        drive(simulation, 2.0, 1.0, side)
        _, left, _, *rates = samples(simulation, 2.0, 1.0, side).mean(axis=0)
        assert left == pytest.approx(side, abs=0.05)
        assert rates == pytest.approx((0.0, 0.0, side), abs=0.03)
    drive(simulation, 2.0, 1.0)
    assert mean_force(simulation, 0.3, 0.0) == pytest.approx((-3.0, 0.0, 9.8), abs=0.1)


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
    simulation = simulate()
    rng, detector = np.random.default_rng(0), CrashDetector(CrashConfig())
    for _ in range(100):
        commands = rng.choice([-1.0, 0.0, 1.0]), rng.choice([-2.0, 0.0, 2.0])
        assert hardest(simulation, float(rng.choice([0.1, 0.3, 0.7])), *commands, detector=detector) == 0.0


@pytest.mark.parametrize(
    ("speed", "obstacle"),
    [(0.2, Cylinder(0.2, 2.0)), (0.5, Box((0.2, 4.0, 2.0))), (1.0, Cylinder(0.2, 2.0))],
)
def test_driving_into_what_stands_fast_is_a_crash(speed, obstacle, simulate):
    simulation = simulate(body("obstacle", obstacle, x=1.5, z=1.0))
    drive(simulation, 1.0)
    assert hardest(simulation, 1.3 / speed, speed) == pytest.approx(speed, rel=0.2)


def test_what_gives_way_is_not_felt(simulate):
    """The course's pillar weighs 1 kg, the Husky 58."""
    simulation = simulate(body("pillar", Cylinder(0.2, 2.0), x=2.0, z=1.0, mass=1.0), config=QUIET)
    assert hardest(simulation, 3.0, 1.0) == 0.0
    assert simulation.step().contacts == ("pillar",)
    assert hardest(simulation, 1.0, 1.0) == 0.0


@pytest.mark.parametrize("rate", [50, 100, 200])
def test_samples_come_at_their_rate(rate, simulate):
    simulation = simulate(config=replace(QUIET, imu_rate=rate))
    snapshots = [snapshot for snapshot in drive(simulation, 1.0) if snapshot.imu is not None]
    assert [snapshot.imu.stamp for snapshot in snapshots] == [snapshot.stamp for snapshot in snapshots]
    assert [snapshot.stamp for snapshot in snapshots] == pytest.approx(np.arange(1, rate + 1) / rate)


def test_the_imu_s_noise_does_not_change_the_lidar_s(simulate):
    wall = body("wall", Box((0.2, 40.0, 2.0)), x=5.1, z=1.0)
    seen = []
    for rate in (50, 200):
        simulation = simulate(wall, robot=HUSKY, config=replace(simulator_config(), imu_rate=rate))
        seen.append([s.scan.ranges.tolist() for s in drive(simulation, 0.2) if s.scan is not None])
    assert seen[0] == seen[1]
    assert len({scan[360] for scan in seen[0]} - {inf}) == len(seen[0]), "there is noise"
