"""Extended Kalman filter of a robot on a plane, with constant acceleration along its axes.

In: measurements of some of the states, in the order of their stamps. Out: state and covariance.

Model and rules follow robot_localization's EKF with two_d_mode, without its seven states off the plane
(T. Moore, D. Stouch: A Generalized Extended Kalman Filter Implementation for the Robot Operating System,
IAS-13, 2014).
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.geometry import wrap_angle

STATES = 8
# indices of the state: pose in odom; velocity and acceleration in base_link
X, Y, YAW, VX, VY, YAW_RATE, AX, AY = range(STATES)
MIN_VARIANCE = 1e-9  # smallest variance of a measured value; the filter uses it instead of a smaller one
INITIAL_VARIANCE = 1e-9  # variance of each state before the first measurement, as in robot_localization
# [s] if the stamps of two readings differ by more than this, the clock was set between them
MAX_STEP = 1e5
# [s] If the clock was set between two readings, the true time between them is unknown. The filter then takes
# this time, as robot_localization does.
CLOCK_STEP = 0.01
# growth of the variance of x, y, yaw, vx, vy, yaw rate, ax, ay by noise [squared unit per second]; the values
# are the defaults of robot_localization
PROCESS_NOISE = (0.05, 0.05, 0.06, 0.025, 0.025, 0.02, 0.01, 0.01)


class Measurement(NamedTuple):
    """Measured values of some states."""

    stamp: float  # [s]
    states: Tuple[int, ...]  # indices of the measured states
    values: np.ndarray  # (k,), SI units
    covariance: np.ndarray  # (k, k)


class MotionEstimate(NamedTuple):
    """Estimated motion of base_link."""

    stamp: float  # [s]
    state: np.ndarray  # (8,) [m, rad, m/s, rad/s, m/s^2] state, with the indices X to AY
    covariance: np.ndarray  # (8, 8)


class PlanarEkf:
    """Filter that begins with the first measurement."""

    def __init__(self, noise: Optional[np.ndarray] = None, initial: Optional[np.ndarray] = None) -> None:
        """Make a filter at the origin; `noise` is the growth of its covariance per second, (8, 8).

        `initial` is the covariance before the first measurement, (8, 8). The first measurement replaces the
        covariance of the states that it measures.
        """
        self._process_noise = np.diag(PROCESS_NOISE) if noise is None else noise
        initial = INITIAL_VARIANCE * np.eye(STATES) if initial is None else initial
        self.estimate = MotionEstimate(0.0, np.zeros(STATES), initial)
        self.started = False

    def set_pose(self, stamp: float, pose: np.ndarray, covariance: np.ndarray) -> None:
        """Start again with a robot at rest at a pose, x, y [m], yaw [rad], with its covariance (3, 3).

        The variance of velocities and accelerations is 1e-6, as in robot_localization.
        """
        state, full_covariance = np.zeros(STATES), 1e-6 * np.eye(STATES)
        # the first three states are x, y and yaw
        state[:3] = pose
        full_covariance[:3, :3] = covariance
        self.estimate, self.started = MotionEstimate(stamp, state, full_covariance), True

    def process(self, measurement: Measurement) -> None:
        """Predict up to a measurement and correct by it; the first measurement starts the filter.

        A measurement that is older than the estimate corrects it without a prediction.
        """
        if not self.started:
            # the first measurement sets the states that it measures; the others keep their initial values
            state, covariance = self.estimate.state.copy(), self.estimate.covariance.copy()
            measured = list(measurement.states)
            state[measured] = measurement.values
            covariance[np.ix_(measured, measured)] = measurement.covariance
            self.estimate, self.started = MotionEstimate(measurement.stamp, state, covariance), True
            return
        self.estimate = correct(self.predicted(measurement.stamp), measurement)

    def predicted(self, stamp: float) -> MotionEstimate:
        """Return the estimate predicted to a time [s]; unchanged if the estimate is for a later time."""
        step = stamp - self.estimate.stamp
        if step <= 0.0:
            return self.estimate
        if step > MAX_STEP:
            step = CLOCK_STEP  # the clock was set, so the difference of the stamps is not the true time
        return predict(self.estimate, stamp, step, self._process_noise)


def predict(estimate: MotionEstimate, stamp: float, step: float, process_noise: np.ndarray) -> MotionEstimate:
    """Predict an estimate by `step` seconds, and give it a new stamp [s].

    The new stamp is not the old stamp plus `step` if a clock was set (see MAX_STEP).
    """
    state = estimate.state
    jacobian = transition_jacobian(state, step)
    covariance = jacobian @ estimate.covariance @ jacobian.T + step * process_noise
    return MotionEstimate(stamp, transition(state, step), covariance)


def transition(state: np.ndarray, step: float) -> np.ndarray:
    """Return the state `step` seconds later, (8,), by the model of constant acceleration and yaw rate."""
    moved = state.copy()
    c, s = cos(state[YAW]), sin(state[YAW])
    # distances that the robot moves along its axes [m]; its heading is taken as constant during the step
    ahead, left = state[[VX, VY]] * step + state[[AX, AY]] * (0.5 * step * step)
    moved[X] += c * ahead - s * left
    moved[Y] += s * ahead + c * left
    moved[YAW] = wrap_angle(state[YAW] + state[YAW_RATE] * step)
    moved[[VX, VY]] += state[[AX, AY]] * step
    return moved


def transition_jacobian(state: np.ndarray, step: float) -> np.ndarray:
    """Return the derivatives of `transition` by the state, (8, 8); row i is for element i of its result."""
    c, s, half = cos(state[YAW]), sin(state[YAW]), 0.5 * step * step
    ahead, left = state[[VX, VY]] * step + state[[AX, AY]] * half
    # rows X and Y: derivatives of the new x and y by the yaw, and by the velocities and accelerations
    jacobian = np.eye(STATES)
    jacobian[X, [YAW, VX, VY, AX, AY]] = -s * ahead - c * left, c * step, -s * step, c * half, -s * half
    jacobian[Y, [YAW, VX, VY, AX, AY]] = c * ahead - s * left, s * step, c * step, s * half, c * half
    jacobian[YAW, YAW_RATE] = jacobian[VX, AX] = jacobian[VY, AY] = step
    return jacobian


def correct(estimate: MotionEstimate, measurement: Measurement) -> MotionEstimate:
    """Correct an estimate by a measurement of the same time, as in a Kalman filter.

    The covariance is computed in Joseph's form, which stays positive definite in spite of rounding errors.
    """
    _, measured, values, noise = measurement
    stamp, state, covariance = estimate
    noise = noise.copy()
    # a variance of 0, which some sensors give, could make the matrix below singular
    np.fill_diagonal(noise, np.maximum(np.abs(noise.diagonal()), MIN_VARIANCE))
    selection = np.eye(STATES)[list(measured)]  # (k, 8) matrix that selects the measured states
    gain = covariance @ selection.T @ np.linalg.inv(selection @ covariance @ selection.T + noise)
    innovation = values - selection @ state  # difference between measured and estimated values
    if YAW in measured:
        # a difference of 359 degrees to the left is a difference of 1 degree to the right
        row = measured.index(YAW)
        innovation[row] = wrap_angle(innovation[row])
    state = state + gain @ innovation
    state[YAW] = wrap_angle(state[YAW])
    remainder = np.eye(STATES) - gain @ selection
    covariance = remainder @ covariance @ remainder.T + gain @ noise @ gain.T
    return MotionEstimate(stamp, state, covariance)
