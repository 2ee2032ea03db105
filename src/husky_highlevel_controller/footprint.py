"""Footprint of a robot: its outline from above, and clearances from it.

In: points in base_link. Out: their distances from the outline.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Tuple

import numpy as np


@dataclass(frozen=True)
class Footprint:
    """Outline: a rectangle centred on base_link, and a strip along the wheels of either side."""

    hull: Tuple[float, float]  # [m] half the length and half the width of the body without wheels
    # [m] strip along the left or right wheels: half its length, and the distances of its inner and its outer
    # edge from the robot's middle line
    wheels: Tuple[float, float, float]

    @property
    def half_length(self) -> float:
        """Half the length of the rectangle about hull and wheels [m]."""
        return max(self.hull[0], self.wheels[0])

    @property
    def half_width(self) -> float:
        """Half the width of the rectangle about hull and wheels [m]."""
        return max(self.hull[1], self.wheels[2])

    def clearance(self, points_in_base: np.ndarray) -> np.ndarray:
        """Return the distance from the outline to each point in base_link [m]; 0 for a point inside.

        The points have the shape (N, 2) or (2,), and the distances have the shape (N,) or ().
        """
        x, y = np.abs(points_in_base).T
        # the outline is symmetric, so one quarter of it is enough for |x| and |y|; the nearer of the hull and
        # the strip of wheels counts
        (half_length, half_width), (half_strip, inner, outer) = self.hull, self.wheels
        from_hull = np.hypot(np.maximum(x - half_length, 0.0), np.maximum(y - half_width, 0.0))
        beside_wheels = np.maximum(np.maximum(y - outer, inner - y), 0.0)
        from_wheels = np.hypot(np.maximum(x - half_strip, 0.0), beside_wheels)
        nearest: np.ndarray = np.minimum(from_hull, from_wheels)
        return nearest

    def clearance_at(self, x: float, y: float) -> float:
        """Return the distance from the outline to the point (x, y) in base_link [m]; 0 inside.

        It is the `clearance` of one point, but takes only a tenth of the time, because it needs no arrays.
        """
        x, y = abs(x), abs(y)
        (half_length, half_width), (half_strip, inner, outer) = self.hull, self.wheels
        from_hull = hypot(max(x - half_length, 0.0), max(y - half_width, 0.0))
        from_wheels = hypot(max(x - half_strip, 0.0), max(y - outer, inner - y, 0.0))
        return min(from_hull, from_wheels)

    def gaps(self, poses: np.ndarray, centers: np.ndarray, radius: float) -> np.ndarray:
        """Return the gap between the outline and a pillar's surface at each pose of the robot, (N,) [m].

        A gap is negative if a part of the pillar is inside the outline.

        Args:
            poses: poses of base_link in the world, (N, 3) [m, m, rad].
            centers: pillar's centre in the world, at each pose (N, 2) or for all poses (2,) [m].
            radius: radius of the pillar [m].
        """
        # the pillar's centre in base_link: the way from the robot to the centre, turned back by the yaw
        dx, dy = (np.asarray(centers) - poses[:, :2]).T
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        return self.clearance(np.stack([c * dx + s * dy, c * dy - s * dx], axis=-1)) - radius
