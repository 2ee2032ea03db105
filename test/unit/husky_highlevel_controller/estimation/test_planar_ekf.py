"""The planar filter: what a Kalman filter has to be, whatever is measured."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_highlevel_controller.estimation import planar_ekf
from husky_highlevel_controller.estimation.planar_ekf import (
    VX,
    VY,
    YAW,
    YAW_RATE,
    Measurement,
    PlanarEkf,
    X,
    Y,
)
from husky_highlevel_controller.geometry import wrap_angle

STATE = st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=8).map(np.array)


def measured(stamp, values, variance=1e-4):
    """A measurement of states by their values."""
    return Measurement(stamp, tuple(values), np.array(list(values.values())), variance * np.eye(len(values)))


@given(STATE, st.floats(0.001, 0.5))
def test_the_jacobian_is_that_of_the_transition(state, step):
    jacobian, delta = planar_ekf.transition_jacobian(state, step), 1e-6
    for i, column in enumerate(jacobian.T):
        ahead, back = (planar_ekf.transition(state + sign * delta * np.eye(8)[i], step) for sign in (1, -1))
        difference = ahead - back
        difference[YAW] = wrap_angle(difference[YAW])
        assert difference / (2.0 * delta) == pytest.approx(column, abs=1e-7)


@given(
    st.lists(st.tuples(st.sampled_from([(X, Y), (YAW,), (VX, VY, YAW_RATE)]), st.floats(0, 0.3)), max_size=30)
)
def test_the_covariance_stays_symmetrical_and_positive(readings):
    ekf, stamp = PlanarEkf(), 0.0
    for number, (states, pause) in enumerate(readings):
        stamp += pause
        ekf.process(measured(stamp, {state: number % 5 - 2.0 for state in states}, variance=0.0))
        covariance = ekf.estimate.covariance
        assert covariance == pytest.approx(covariance.T, abs=1e-12)
        assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_a_heading_measured_beyond_pi_turns_the_short_way():
    ekf = PlanarEkf()
    ekf.process(measured(0.0, {YAW: pi - 0.01}))
    ekf.process(measured(0.1, {YAW: -pi + 0.01}))
    assert abs(ekf.estimate.state[YAW]) == pytest.approx(pi, abs=0.02)


def test_without_measurements_it_goes_straight_on_and_knows_less():
    ekf = PlanarEkf()
    ekf.process(measured(0.0, {YAW: pi / 2, VX: 1.0}))
    later = ekf.predicted(2.0)
    assert later.state[:3] == pytest.approx((0.0, 2.0, pi / 2))
    assert (later.covariance.diagonal() > ekf.estimate.covariance.diagonal()).all()
    assert ekf.predicted(-5.0) is ekf.estimate


def test_a_jump_of_the_clock_is_no_drive():
    ekf = PlanarEkf()
    ekf.process(measured(0.0, {VX: 1.0}))
    assert ekf.predicted(1.7e9).state[X] == pytest.approx(0.01)


def test_a_set_pose_is_where_it_stands():
    ekf = PlanarEkf()
    ekf.process(measured(0.0, {VX: 1.0}))
    ekf.set_pose(5.0, np.array([1.0, 2.0, 0.5]), 0.01 * np.eye(3))
    assert ekf.predicted(6.0).state[:4] == pytest.approx((1.0, 2.0, 0.5, 0.0))


@pytest.mark.parametrize("variance", [0.0, -1e-4])
def test_a_measurement_without_a_variance_can_come_twice(variance):
    ekf = PlanarEkf()
    ekf.process(measured(1.0, {VX: 0.5}))
    for _ in range(5):
        ekf.process(measured(1.0, {VX: 0.5}, variance))
    assert ekf.estimate.state[VX] == pytest.approx(0.5)
    assert ekf.estimate.covariance[VX, VX] > 0.0
