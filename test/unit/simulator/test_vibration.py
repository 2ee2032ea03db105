"""Vibration of a driving IMU, held to what was measured."""

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import Pose, RobotState
from husky_highlevel_controller.simulator.profile import HARD, SOFT
from husky_highlevel_controller.simulator.sensors.imu import Imu, ImuConfig
from husky_highlevel_controller.simulator.sensors.vibration import VibratingImu

TRACK = 1.07


def samples(ground, linear=0.0, angular=0.0, count=4000):
    imu = VibratingImu(Imu(ImuConfig(0.0, 0.0), 0.02, (0.0, 0.0, -9.8)), ground.vibration, TRACK)
    imu.reset(np.random.default_rng(0))
    state = RobotState(Pose(), (linear, 0.0, 0.0), (0.0, 0.0, angular))
    taken = [imu.sample(state, 0.02 * i) for i in range(count + 1)][1:]
    return np.array([sample.specific_force + sample.angular_velocity for sample in taken])


def test_standing_nothing_shakes():
    assert samples(HARD, count=10).std(axis=0) == pytest.approx(np.zeros(6), abs=1e-9)


@pytest.mark.parametrize(
    ("ground", "speed", "low", "high"),
    [
        (HARD, 0.28, (0.75, 0.75, 0.33, 0.012), (1.05, 1.05, 0.45, 0.025)),  # flooring, asphalt
        (HARD, 0.57, (1.4, 1.6, 0.5, 0.025), (2.0, 1.9, 0.8, 0.04)),  # asphalt
        (SOFT, 0.3, (1.2, 1.2, 0.4, 0.03), (1.7, 1.7, 0.7, 0.06)),  # loam
    ],
)
def test_it_shakes_as_measured_and_more_the_faster_the_wheels_roll(ground, speed, low, high):
    std = samples(ground, speed).std(axis=0)[[0, 1, 2, 5]]
    assert (std > low).all()
    assert (std < high).all()
    turning = samples(ground, 0.0, speed / (TRACK / 2.0)).std(axis=0)[[0, 1, 2, 5]]
    assert turning == pytest.approx(std, rel=0.05), "in place the wheels roll as fast"


@pytest.mark.parametrize(("ground", "fastest"), [(HARD, 0.6), (SOFT, 0.3)])
def test_faster_than_measured_it_shakes_no_more(ground, fastest):
    assert samples(ground, 1.0).std(axis=0) == pytest.approx(samples(ground, fastest).std(axis=0), rel=0.05)


def test_neighbouring_samples_are_correlated_as_measured_and_peaks_are_high():
    shaken = samples(HARD, 0.3)[:, 0]
    correlations = [np.corrcoef(shaken[lag:], shaken[:-lag])[0, 1] for lag in (1, 2)]
    assert correlations == pytest.approx([0.15, -0.4], abs=0.06)
    assert np.abs(shaken).max() > 4.5 * shaken.std(), "a Gaussian's would be 3.7"
    assert abs(np.cumsum(shaken)[-1] * 0.02) < 1.5, "no speed comes of it"
