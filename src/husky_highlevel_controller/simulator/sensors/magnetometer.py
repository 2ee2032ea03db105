"""Simulated magnetometer of a real Husky's IMU: the Earth's magnetic field in base_link.

In: the true attitude of base_link, a random generator. Out: a `MagSample`.

The field is that of 49.9 N 8.9 E, where the world lies (IGRF, rounded): 20.4 uT north, 1.3 uT east, 44.7 uT
down; the world's x points east, as for the satellite receiver. The robot's own steel and currents, which bend
a real reading by some degrees, are not known and left out.
"""

from __future__ import annotations

import numpy as np

from husky_highlevel_controller.datatypes import MagSample, RobotState
from husky_highlevel_controller.geometry import quat_inverse, rotate

FIELD_IN_WORLD = (1.3e-6, 20.4e-6, -44.7e-6)  # [T], east, north, up
NOISE = 0.3e-6  # [T], standard deviation on each axis; typical of such sensors, not measured


class Magnetometer:
    """A magnetometer along base_link's axes."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin anew, with noise from `rng`."""
        self._rng = rng

    def sample(self, state: RobotState, stamp: float) -> MagSample:
        """The reading at one instant."""
        x, y, z = rotate(quat_inverse(state.pose_in_world.quat_xyzw), FIELD_IN_WORLD)
        a, b, c = (NOISE * self._rng.standard_normal(3)).tolist()
        return MagSample(stamp, (x + a, y + b, z + c))
