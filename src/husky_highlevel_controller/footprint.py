"""Footprint of the Husky: its outline from above, and clearances from it.

In: points in base_link. Out: their distances from the outline. Must not know: ROS, the caller.

Numbers: husky_description 0.6.10, husky.urdf.xacro and wheel.urdf.xacro; a test holds them to the URDF.
"""

from __future__ import annotations

from math import hypot

import numpy as np

# Half length and half width of the two rectangles, centred on base_link, that make the outline [m].
HULL = (0.9874 / 2.0, 0.5709 / 2.0)  # base_x_size, base_y_size
WHEELS = (0.5120 / 2.0 + 0.1651, (0.5708 + 0.1143) / 2.0)  # wheelbase, wheel_radius; track, wheel_length
HALF_LENGTH, HALF_WIDTH = HULL[0], WHEELS[1]  # of the rectangle about both [m]


def clearance(points_in_base: np.ndarray) -> np.ndarray:
    """Distance from the outline to each point, (N,) [m]; 0 inside.

    Args:
        points_in_base: (N, 2) [m].
    """
    across = np.abs(points_in_base)
    to_hull, to_wheels = (np.maximum(across - half, 0.0) for half in (HULL, WHEELS))
    nearest: np.ndarray = np.minimum(
        np.hypot(to_hull[:, 0], to_hull[:, 1]), np.hypot(to_wheels[:, 0], to_wheels[:, 1])
    )
    return nearest


def clearance_at(x: float, y: float) -> float:
    """Distance from the outline to one point in base_link [m]; 0 inside."""
    return min(hypot(max(abs(x) - length, 0.0), max(abs(y) - width, 0.0)) for length, width in (HULL, WHEELS))


def gaps(poses: np.ndarray, centers: np.ndarray, radius: float) -> np.ndarray:
    """Gaps between the outline at each pose and a pillar's surface, (N,) [m]; negative: inside.

    Args:
        poses: (N, 3) [m, m, rad], x, y and yaw of base_link in the world.
        centers: of the pillar in the world, (N, 2) or (2,) [m].
        radius: of the pillar [m].
    """
    dx, dy = (np.asarray(centers) - poses[:, :2]).T
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return clearance(np.stack([c * dx + s * dy, c * dy - s * dx], axis=-1)) - radius
