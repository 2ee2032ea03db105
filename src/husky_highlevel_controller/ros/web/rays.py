"""Intersection of a ray of the mouse with a level plane.

In: numbers. Out: points.
"""

from __future__ import annotations

from typing import Optional, Sequence

from husky_highlevel_controller.datatypes import Vector3

FARTHEST = 200.0  # [m]; a click just below the horizon means no place


def point_on_level(origin: Sequence[float], direction: Sequence[float], z: float) -> Optional[Vector3]:
    """Intersection of a ray with the plane at height `z` [m]; None behind the camera or too far."""
    if abs(direction[2]) < 1e-9:
        return None
    distance = (z - origin[2]) / direction[2]
    if not 0.0 < distance < FARTHEST:
        return None
    return (origin[0] + distance * direction[0], origin[1] + distance * direction[1], z)
