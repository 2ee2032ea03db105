"""Collision shapes of several geometries: their compound for PyBullet, and its centre of mass.

In: records of geometries. Out: Bullet's shape, a point.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import pybullet

from husky_highlevel_controller.datatypes import Box, Cylinder, Geometry, Sphere, Vector3


def center_of(geometries: Sequence[Geometry]) -> Vector3:
    """Centre of mass of solid geometries of one density, in their body's frame [m]."""
    volumes = np.array([_volume(geometry) for geometry in geometries])
    x, y, z = (
        volumes / volumes.sum() @ np.array([geometry.pose_in_body.position for geometry in geometries])
    ).tolist()
    return (x, y, z)


def _volume(geometry: Geometry) -> float:
    shape = geometry.shape
    if isinstance(shape, Box):
        return float(np.prod(shape.size))
    if isinstance(shape, Cylinder):
        return np.pi * shape.radius**2 * shape.length
    if isinstance(shape, Sphere):
        return 4.0 / 3.0 * np.pi * shape.radius**3
    raise TypeError(f"{shape} has no volume")


def compound_shape(geometries: Sequence[Geometry], engine: Any) -> int:
    """Compound collision shape of several geometries; cylinders are exact, not hulls of polygons."""
    kinds = {Box: pybullet.GEOM_BOX, Cylinder: pybullet.GEOM_CYLINDER, Sphere: pybullet.GEOM_SPHERE}
    shapes = [geometry.shape for geometry in geometries]
    shape: int = engine.createCollisionShapeArray(
        shapeTypes=[kinds[type(shape)] for shape in shapes],
        radii=[getattr(shape, "radius", 0.0) for shape in shapes],
        lengths=[getattr(shape, "length", 0.0) for shape in shapes],
        halfExtents=[[edge / 2.0 for edge in shape.size] for shape in shapes],  # only boxes need them
        collisionFramePositions=[geometry.pose_in_body.position for geometry in geometries],
        collisionFrameOrientations=[geometry.pose_in_body.quat_xyzw for geometry in geometries],
    )
    return shape
