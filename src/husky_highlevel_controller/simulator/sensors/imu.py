"""Simulated IMU: angular velocity and specific force along base_link's axes; a real Husky's magnetometer.

In: the true motion of base_link, gravity, a random generator. Out: an `ImuSample`, a `MagSample`.

Specific force is what an accelerometer measures: the acceleration minus gravity. At rest it is 9.8 m/s^2
upwards.

The Husky's plugin measures at base_link's origin, and its messages name that frame, although its imu_link is
0.19 m further ahead. The SMB's plugin measures at its imu_link, which is away from base_link's origin, so its
samples contain the centripetal acceleration of a turn.

The magnetic field is the field at 49.9 N 8.9 E, the place of the world (IGRF, rounded): 20.4 uT north, 1.3 uT
east, 44.7 uT down. The world's x points east, as for the satellite receiver. On a real robot, its steel and
its currents change the direction of the field by some degrees. This is left out, because the values are not
known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import ImuSample, MagSample, RobotState, Vector3
from husky_highlevel_controller.geometry import cross, minus, quat_inverse, rotate

FIELD_IN_WORLD = (1.3e-6, 20.4e-6, -44.7e-6)  # [T] magnetic field of the earth: components east, north, up
# [T] standard deviation of the noise on each axis; a typical value of such sensors, not measured
FIELD_NOISE = 0.3e-6


@dataclass(frozen=True)
class ImuConfig:
    """Noise of the IMU; config/robots/ holds the values."""

    acceleration_noise: float = number(0.0, 10.0, "standard deviation on each axis [m/s^2]")
    rate_noise: float = number(0.0, 10.0, "standard deviation on each axis [rad/s]")


class Imu:
    """An IMU on base_link, along base_link's axes.

    The specific force is the mean from the last sample to this sample, and comes from the change of the
    velocity. So even a knock of a millisecond has an effect, on exactly one sample.
    """

    def __init__(
        self,
        config: ImuConfig,
        period: float,
        gravity_in_world: Vector3,
        position_in_base: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Make an IMU.

        Args:
            config: noise.
            period: time from sample to sample [s].
            gravity_in_world: acceleration of gravity [m/s^2].
            position_in_base: place of the IMU in base_link [m].
        """
        self._config, self._period, self._gravity_in_world = config, period, gravity_in_world
        self._position_in_base = position_in_base

    def reset(self, rng: np.random.Generator) -> None:
        """Restart on a robot at rest, with noise from `rng`."""
        self._rng = rng
        self.restart()

    def restart(self) -> None:
        """Begin again with a robot at rest: forget the last sample."""
        self._last_velocity_in_world: Vector3 = (0.0, 0.0, 0.0)
        self.yaw_rate = 0.0  # [rad/s] yaw rate of the last sample

    def sample(self, state: RobotState, stamp: float) -> ImuSample:
        """Return the sample at `stamp` [s], one period after the last sample."""
        attitude, config = state.pose_in_world.quat_xyzw, self._config
        # velocity of the IMU: v + w x r; `minus` returns a - factor * b, so the factor -1 makes a sum
        velocity_by_turning = cross(state.angular_velocity_in_base, self._position_in_base)
        velocity_in_base = minus(state.velocity_in_base, velocity_by_turning, -1.0)
        velocity_in_world = rotate(attitude, velocity_in_base)
        # The specific force is computed along the axes of the world, because the axes of base_link may have
        # turned since the last sample.
        force_in_world = [
            (now - before) / self._period - gravity
            for before, now, gravity in zip(
                self._last_velocity_in_world, velocity_in_world, self._gravity_in_world
            )
        ]
        self._last_velocity_in_world = velocity_in_world
        force_in_base = rotate(quat_inverse(attitude), force_in_world)
        noise = self._rng.standard_normal(6).tolist()
        fx, fy, fz = (
            value + config.acceleration_noise * draw for value, draw in zip(force_in_base, noise[:3])
        )
        wx, wy, wz = (
            value + config.rate_noise * draw for value, draw in zip(state.angular_velocity_in_base, noise[3:])
        )
        self.yaw_rate = wz  # used by the filtered odometry
        return ImuSample(stamp, attitude, (wx, wy, wz), (fx, fy, fz))


class Magnetometer:
    """A magnetometer along base_link's axes."""

    def reset(self, rng: np.random.Generator) -> None:
        """Restart with noise from `rng`."""
        self._rng = rng

    def sample(self, state: RobotState, stamp: float) -> MagSample:
        """Return the reading at `stamp` [s]."""
        x, y, z = rotate(quat_inverse(state.pose_in_world.quat_xyzw), FIELD_IN_WORLD)
        a, b, c = (FIELD_NOISE * self._rng.standard_normal(3)).tolist()
        return MagSample(stamp, (x + a, y + b, z + c))
