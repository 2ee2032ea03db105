"""What the IMU measures of a motion: specific force, not acceleration, and along the robot's axes."""

from dataclasses import replace
from io import BytesIO
from math import cos, nan, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import Imu as ImuMsg

from husky_highlevel_controller.datatypes import ImuSample, Pose, RobotState
from husky_highlevel_controller.geometry import quat_from_rpy, quat_inverse, rotate
from husky_highlevel_controller.ros.conversions import imu_from_msg, imu_to_msg
from husky_highlevel_controller.simulator.sensors.imu import Imu
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
@given(attitudes)
def test_at_rest_it_feels_the_ground_push_upwards_with_9_8_in_any_attitude(quat):
    sample = felt(moving(quat=quat), moving(quat=quat))
    assert rotate(quat, sample.specific_force) == pytest.approx((0.0, 0.0, 9.8), abs=1e-9)
    assert sample.quat_xyzw == quat


@LAW
@given(attitudes)
def test_in_free_fall_it_feels_nothing(quat):
    sample = felt(moving((1.0, 0.0, -2.0), quat), moving((1.0, 0.0, -2.0 - 9.8 * PERIOD), quat))
    assert sample.specific_force == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("heading", [0.0, 1.0, pi, -2.0])
def test_speeding_up_is_felt_forwards_whichever_way_the_robot_looks(heading):
    quat, x, y = quat_from_rpy(0.0, 0.0, heading), cos(heading), sin(heading)
    faster = 0.5 + 3.0 * PERIOD
    force = felt(moving((0.5 * x, 0.5 * y, 0.0), quat), moving((faster * x, faster * y, 0.0), quat))
    assert force.specific_force == pytest.approx((3.0, 0.0, 9.8))


def test_a_knock_between_two_samples_is_felt_whole_and_turning_rates_are_those_of_now():
    sample = felt(moving((1.0, 0.0, 0.0)), moving(spin=(0.1, -0.2, 0.3)))
    assert sample.specific_force[0] == pytest.approx(-1.0 / PERIOD)
    assert (sample.angular_velocity, sample.stamp) == ((0.1, -0.2, 0.3), 1.5)


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


def over_the_wire(msg):
    """The message as another node gets it."""
    buffer = BytesIO()
    msg.serialize(buffer)
    return type(msg)().deserialize(buffer.getvalue())


@LAW
@given(attitudes)
def test_a_sample_survives_the_wire(quat):
    sample = ImuSample(2.5, quat, (0.1, 0.2, 0.3), (0.4, 0.5, 9.8))
    msg = over_the_wire(imu_to_msg(sample, "base_link"))
    assert (msg.header.frame_id, msg.header.stamp.to_sec()) == ("base_link", 2.5)
    got = imu_from_msg(msg)
    assert (got.stamp, got.angular_velocity, got.specific_force) == (2.5, (0.1, 0.2, 0.3), (0.4, 0.5, 9.8))
    assert got.quat_xyzw == pytest.approx(quat, abs=1e-12)


def test_covariances_are_as_the_husky_publishes_them():
    msg = imu_to_msg(ImuSample(0.0, LEVEL, (0.0, 0.0, 0.0), (0.0, 0.0, 9.8)), "base_link")
    expected = np.diag([(0.005 / 9.8) ** 2, (0.005 / 9.8) ** 2, 0.0])
    assert np.reshape(msg.orientation_covariance, (3, 3)) == pytest.approx(expected)
    assert set(msg.angular_velocity_covariance) == set(msg.linear_acceleration_covariance) == {0.0}


@pytest.mark.parametrize(
    ("quat", "first_covariance", "taken"),
    [
        ((0.0, 0.0, 0.0, 0.0), 0.0, LEVEL),  # it does not know how it stands
        ((nan, nan, nan, nan), 0.0, LEVEL),
        ((0.6, 0.0, 0.0, 0.8), -1.0, LEVEL),
        ((0.0, 0.0, 0.7, 0.7), 0.0, (0.0, 0.0, 0.5**0.5, 0.5**0.5)),  # not quite normed
    ],
)
def test_an_orientation_is_a_rotation_or_level(quat, first_covariance, taken):
    msg = ImuMsg()
    msg.orientation.x, msg.orientation.y, msg.orientation.z, msg.orientation.w = quat
    msg.orientation_covariance[0] = first_covariance
    assert imu_from_msg(msg).quat_xyzw == pytest.approx(taken)
