"""Vibration that a driving Husky's IMU measures: accelerations and rates that grow with the wheels' speed.

In: an IMU, the robot's true motion, a random generator. Out: an `ImuSample`.

The values were measured on a Husky A200 (BorealTC, LaRocque et al. 2024, arXiv 2403.16877) at 100 Hz, and
averaged in pairs to 50 Hz. For a ground and a mean wheel speed v, this table has the standard deviations of
ax, ay and az [m/s^2], and of the rates [rad/s]. Each is a median: the standard deviation was computed for
each second of steady driving.

    flooring 0.11 m/s: 0.5 0.5 0.2, 0.01      ice 0.30 m/s: 0.9 0.6 0.3, 0.01
    flooring 0.28 m/s: 0.9 0.8 0.4, 0.02      ice 0.60 m/s: 1.1 1.3 0.45, 0.02
    asphalt 0.27 m/s: 0.9 1.0 0.35, 0.02      loam 0.30 m/s: 1.45 1.3 0.5, 0.05
    asphalt 0.57 m/s: 2.0 1.8 0.7, 0.03       snow 0.12 m/s: 2.1 2.0 1.0, 0.03
                                              snow 0.28 m/s: 1.1 0.7 0.3, 0.03

On hard ground, the vibration is about proportional to v up to 0.6 m/s, the fastest measured speed. On soft
ground, the vibration does not grow above 0.3 m/s. Nothing is known about faster robots, so here the vibration
stays constant above these speeds. The measured samples have the correlation 0.15 after one period of 50 Hz
and -0.4 after two periods. An autoregressive process of second order gives such noise. The measured peaks, 6
to 8 standard deviations, fit Student's distribution with 7 degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import List

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import ImuSample, RobotState
from husky_highlevel_controller.simulator.sensors.imu import Imu

# correlation between two samples that are one period and two periods apart, at 50 Hz
CORRELATION_1, CORRELATION_2 = 0.15, -0.40
# parameter of Student's distribution; with 7, a sample reaches 8 standard deviations once in 5 minutes
DEGREES_OF_FREEDOM = 7
# The noise is x[n] = LAST x[n-1] + BEFORE_LAST x[n-2] + RANDOM draw[n]. With these factors, the noise has the
# correlations above and the variance 1 (Yule-Walker equations). A draw from Student's distribution has the
# variance DEGREES_OF_FREEDOM / (DEGREES_OF_FREEDOM - 2).
LAST = CORRELATION_1 * (1.0 - CORRELATION_2) / (1.0 - CORRELATION_1**2)
BEFORE_LAST = (CORRELATION_2 - CORRELATION_1**2) / (1.0 - CORRELATION_1**2)
RANDOM = sqrt(
    (1.0 - LAST * CORRELATION_1 - BEFORE_LAST * CORRELATION_2) * (DEGREES_OF_FREEDOM - 2) / DEGREES_OF_FREEDOM
)


@dataclass(frozen=True)
class VibrationConfig:
    """Roughness of the ground."""

    horizontal: float = number(0.0, 50.0, "std of ax, ay per speed [(m/s^2)/(m/s)]")
    vertical: float = number(0.0, 50.0, "std of az per speed [(m/s^2)/(m/s)]")
    rate: float = number(0.0, 5.0, "std of the rates per speed [(rad/s)/(m/s)]")
    saturation: float = number(0.0, 10.0, "speed above which the vibration stays constant [m/s]")


class VibratingImu:
    """An IMU on a robot that shakes because of its ground."""

    def __init__(self, imu: Imu, config: VibrationConfig, track: float) -> None:
        """`track`: distance between the wheels, which gives their speeds when the robot turns [m]."""
        self._imu, self._track = imu, track
        self._saturation_speed = config.saturation
        # standard deviations of ax, ay, az and the three rates, per speed of the wheels
        self._noise_per_speed = [config.horizontal] * 2 + [config.vertical] + [config.rate] * 3

    def reset(self, rng: np.random.Generator) -> None:
        """Restart on a robot at rest, with noise from `rng`."""
        self._rng = rng
        self._imu.reset(rng)
        self.restart()

    def restart(self) -> None:
        """Begin again with a robot at rest: forget the last samples."""
        self._imu.restart()
        self.yaw_rate = 0.0  # [rad/s] yaw rate of the last sample
        self._last_noise: List[float] = [0.0] * 6
        self._noise_before_last: List[float] = [0.0] * 6

    def sample(self, state: RobotState, stamp: float) -> ImuSample:
        """Return the sample at `stamp` [s], one period after the last sample."""
        sample = self._imu.sample(state, stamp)
        # noise of variance 1 for each value of a sample (three accelerations, three rates), from its last two
        # values and a random number (autoregressive)
        draws = self._rng.standard_t(DEGREES_OF_FREEDOM, 6).tolist()
        noise = [
            LAST * last + BEFORE_LAST * before + RANDOM * draw
            for last, before, draw in zip(self._last_noise, self._noise_before_last, draws)
        ]
        self._last_noise, self._noise_before_last = noise, self._last_noise
        # The speed of the left wheels is linear - turning, and that of the right wheels linear + turning. The
        # vibration grows with the mean of their absolute values, which is the larger of |linear| and
        # |turning|.
        linear, turning = state.velocity_in_base[0], state.angular_velocity_in_base[2] * self._track / 2.0
        mean_wheel_speed = max(abs(linear), abs(turning))
        speed = min(mean_wheel_speed, self._saturation_speed)
        dfx, dfy, dfz, dwx, dwy, dwz = (
            speed * scale * value for scale, value in zip(self._noise_per_speed, noise)
        )
        (fx, fy, fz), (wx, wy, wz) = sample.specific_force, sample.angular_velocity
        self.yaw_rate = wz + dwz  # used by the filtered odometry
        return sample._replace(
            specific_force=(fx + dfx, fy + dfy, fz + dfz),
            angular_velocity=(wx + dwx, wy + dwy, self.yaw_rate),
        )
