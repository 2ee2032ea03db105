"""What the IMU measures of a motion: specific force, not acceleration, and along the robot's axes."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.datatypes import Pose, RobotState
from husky_highlevel_controller.geometry import quat_from_rpy, quat_inverse, rotate
from husky_highlevel_controller.simulator.profile import HARD, SOFT
from husky_highlevel_controller.simulator.sensors.imu import Imu
from husky_highlevel_controller.simulator.sensors.vibration import VibratingImu
from husky_highlevel_controller.simulator.simulator_config import simulator_config

LAW = settings(derandomize=True, deadline=None, max_examples=60)
QUIET = replace(simulator_config().imu, acceleration_noise=0.0, rate_noise=0.0)
GRAVITY = (0.0, 0.0, -9.8)
LEVEL = (0.0, 0.0, 0.0, 1.0)
PERIOD = 0.02  # [s]

attitudes = st.builds(quat_from_rpy, *[st.floats(-pi, pi)] * 3)


def moving(velocity_in_world=(0.0, 0.0, 0.0), quat=LEVEL, spin=(0.0, 0.0, 0.0)):
    return RobotState(Pose((1.0, 2.0, 3.0), quat), rotate(quat_inverse(quat), velocity_in_world), spin)


def make_imu(config=QUIET, seed=0):
    imu = Imu(config, PERIOD, GRAVITY)
    imu.reset(np.random.default_rng(seed))
    return imu


def felt(before, now):
    """The second of two samples one period apart."""
    imu = make_imu()
    imu.sample(before, 1.5 - PERIOD)
    return imu.sample(now, 1.5)


@LAW
@given(attitudes, st.tuples(*[st.floats(-0.2, 0.2)] * 3))
@example((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, -9.8 * PERIOD))
def test_in_any_attitude_it_feels_the_change_of_its_velocity_and_the_ground_s_push(quat, change):
    """At rest 9.8 m/s^2 upwards in the world, in free fall nothing; turning rates are those of now."""
    before = np.array((1.0, -0.5, 0.2))
    sample = felt(moving(before, quat), moving(before + change, quat, spin=(0.1, -0.2, 0.3)))
    expected = np.array(change) / PERIOD + (0.0, 0.0, 9.8)
    assert rotate(quat, sample.specific_force) == pytest.approx(expected, abs=1e-9)
    assert (sample.quat_xyzw, sample.angular_velocity, sample.stamp) == (quat, (0.1, -0.2, 0.3), 1.5)


@pytest.mark.parametrize(("force", "rate"), [(0.005, 0.005), (0.1, 0.3)])  # the first are the Husky's
def test_noise_is_as_asked_for_on_each_axis_and_the_axes_have_their_own(force, rate):
    default = simulator_config().imu
    config = default if force == 0.005 else replace(default, acceleration_noise=force, rate_noise=rate)
    imu = make_imu(config, seed=4)
    samples = [imu.sample(moving(), 0.0) for _ in range(3000)]
    numbers = np.array([(*sample.specific_force, *sample.angular_velocity) for sample in samples])
    assert numbers.std(axis=0) == pytest.approx([force] * 3 + [rate] * 3, rel=0.05)
    assert np.abs(numbers.mean(axis=0) - (0, 0, 9.8, 0, 0, 0)) == pytest.approx([0.0] * 6, abs=0.02)
    assert np.abs(np.corrcoef(numbers.T) - np.eye(6)).max() < 0.07


# ---------------------------------------------------------------------------- vibration of a real robot's


TRACK = 1.07


def shaken(ground, linear=0.0, angular=0.0, count=4000):
    imu = VibratingImu(Imu(QUIET, PERIOD, GRAVITY), ground.vibration, TRACK)
    imu.reset(np.random.default_rng(0))
    state = RobotState(Pose(), (linear, 0.0, 0.0), (0.0, 0.0, angular))
    taken = [imu.sample(state, 0.02 * i) for i in range(count + 1)][1:]
    return np.array([sample.specific_force + sample.angular_velocity for sample in taken])


def test_standing_nothing_shakes():
    assert shaken(HARD, count=10).std(axis=0) == pytest.approx(np.zeros(6), abs=1e-9)


@pytest.mark.parametrize(
    ("ground", "speed", "low", "high"),
    [
        (HARD, 0.28, (0.75, 0.75, 0.33, 0.012), (1.05, 1.05, 0.45, 0.025)),  # flooring, asphalt
        (HARD, 0.57, (1.4, 1.6, 0.5, 0.025), (2.0, 1.9, 0.8, 0.04)),  # asphalt
        (SOFT, 0.3, (1.2, 1.2, 0.4, 0.03), (1.7, 1.7, 0.7, 0.06)),  # loam
    ],
)
def test_it_shakes_as_measured_and_more_the_faster_the_wheels_roll(ground, speed, low, high):
    std = shaken(ground, speed).std(axis=0)[[0, 1, 2, 5]]
    assert (std > low).all()
    assert (std < high).all()
    turning = shaken(ground, 0.0, speed / (TRACK / 2.0)).std(axis=0)[[0, 1, 2, 5]]
    assert turning == pytest.approx(std, rel=0.05), "in place the wheels roll as fast"


@pytest.mark.parametrize(("ground", "fastest"), [(HARD, 0.6), (SOFT, 0.3)])
def test_faster_than_measured_it_shakes_no_more(ground, fastest):
    assert shaken(ground, 1.0).std(axis=0) == pytest.approx(shaken(ground, fastest).std(axis=0), rel=0.05)


def test_neighbouring_samples_are_correlated_as_measured_and_peaks_are_high():
    ahead = shaken(HARD, 0.3)[:, 0]
    correlations = [np.corrcoef(ahead[lag:], ahead[:-lag])[0, 1] for lag in (1, 2)]
    assert correlations == pytest.approx([0.15, -0.4], abs=0.06)
    assert np.abs(ahead).max() > 4.5 * ahead.std(), "a Gaussian's would be 3.7"
    assert abs(np.cumsum(ahead)[-1] * 0.02) < 1.5, "no speed comes of it"
