"""Simulated GPS: latitude, longitude and velocity of base_link.

In: the true motion of base_link. Out: a `GpsFix`.

As in husky_description 0.6.10, x of the world points east (reference heading 90 degrees), and the velocities
are along north, west and up. The error of the position is a Gauss-Markov process: a random walk that is
pulled back to 0, with a time constant of an hour (default of hector_gazebo_plugins). The radii of the earth
are from WGS 84.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, exp, radians, sin, sqrt

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import GpsFix, RobotState
from husky_highlevel_controller.geometry import rotate

EQUATORIAL_RADIUS, FLATTENING = 6378137.0, 1.0 / 298.257223563  # [m], WGS 84
DRIFT_TIME = 3600.0  # [s] time constant of the position's error


@dataclass(frozen=True)
class GpsConfig:
    """Place of the world on Earth, and noise of the receiver; config/robots/ holds the values."""

    latitude: float = number(-89.0, 89.0, "latitude of the origin of the world [deg]")
    longitude: float = number(-180.0, 180.0, "longitude of the origin of the world [deg]")
    drift: float = number(0.0, 100.0, "drift of the position on each axis [m]")


class Gps:
    """A GPS receiver; its position error is a Gauss-Markov process."""

    def __init__(self, config: GpsConfig, period: float) -> None:
        """Make a receiver; `period` is the time from sample to sample [s]."""
        self._config = config
        self._kept_fraction = exp(-period / DRIFT_TIME)  # part of the last error that stays in the next one
        # The earth is an ellipsoid, so motion to the north and motion to the east are on circles of different
        # radii [m]. `sample` computes latitude and longitude with these radii.
        latitude = radians(config.latitude)
        eccentricity_squared = FLATTENING * (2.0 - FLATTENING)
        term = 1.0 - eccentricity_squared * sin(latitude) ** 2  # a term of both formulas of WGS 84
        self._north_radius = EQUATORIAL_RADIUS * (1.0 - eccentricity_squared) / term**1.5
        self._east_radius = EQUATORIAL_RADIUS * cos(latitude) / sqrt(term)

    def reset(self, rng: np.random.Generator) -> None:
        """Restart with errors from `rng`."""
        self._rng = rng
        self._error = (self._config.drift * rng.standard_normal(3)).tolist()

    def sample(self, state: RobotState, stamp: float) -> GpsFix:
        """Return the fix at `stamp` [s], one period after the last fix."""
        # each new error is a fraction of the last error plus a random part, whose size is such that the
        # standard deviation of the error stays `drift`
        random_size = self._config.drift * sqrt(1.0 - self._kept_fraction**2)
        draws = self._rng.standard_normal(3).tolist()
        self._error = [
            self._kept_fraction * last + random_size * draw for last, draw in zip(self._error, draws)
        ]
        east, north, up = (true + error for true, error in zip(state.pose_in_world.position, self._error))
        vx, vy, vz = rotate(state.pose_in_world.quat_xyzw, state.velocity_in_base)
        return GpsFix(
            stamp,
            # the angle is the distance divided by the earth's radius for motion in this direction
            latitude=self._config.latitude + degrees(north / self._north_radius),
            longitude=self._config.longitude + degrees(east / self._east_radius),
            altitude=up,
            velocity=(vy, -vx, vz),  # components (north, west, up), because x of the world points east
        )
