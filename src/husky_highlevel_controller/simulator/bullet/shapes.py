"""Collision shapes of several geometries: their compound for PyBullet, and its centre of mass.

In: geometries. Out: Bullet's number of the shape, the centre of mass.
"""

from __future__ import annotations

import os
import tempfile
from typing import Any, Dict, Sequence, Tuple

import numpy as np
import pybullet

from husky_highlevel_controller.datatypes import Box, Cylinder, Geometry, Sphere, TriangleMesh, Vector3
from husky_highlevel_controller.geometry import transform_point
from husky_highlevel_controller.meshes import volume_of

# [m^3] volume that replaces the volume 0 of a flat mesh, so that a body of this mesh has a centre of mass
_FLATTEST = 1e-9


def volume_and_center(geometries: Sequence[Geometry]) -> Tuple[float, Vector3]:
    """Volume [m^3] of solid geometries of one density, and their centre of mass in their body's frame [m]."""
    solids = [_volume_and_center(geometry) for geometry in geometries]
    volumes = np.array([volume for volume, _ in solids])
    x, y, z = (volumes / volumes.sum() @ np.array([center for _, center in solids])).tolist()
    return float(volumes.sum()), (x, y, z)


def _volume_and_center(geometry: Geometry) -> Tuple[float, Vector3]:
    """Volume [m^3] of a solid geometry, and its centre of mass in its body's frame [m]."""
    shape, position = geometry.shape, geometry.pose_in_body.position
    if isinstance(shape, TriangleMesh):
        volume, centroid = volume_of(shape)
        # a flat mesh has no volume, but a body of volume 0 would have no centre of mass
        return max(volume, _FLATTEST), transform_point(geometry.pose_in_body, centroid)
    if isinstance(shape, Box):
        return float(np.prod(shape.size)), position
    if isinstance(shape, Cylinder):
        return np.pi * shape.radius**2 * shape.length, position
    if isinstance(shape, Sphere):
        return 4.0 / 3.0 * np.pi * shape.radius**3, position
    raise TypeError(f"{shape} has no volume")


MAX_SHAPES = 16  # PyBullet leaves out further shapes of a compound, without an error


def compound_shape(geometries: Sequence[Geometry], is_movable: bool, engine: Any) -> int:
    """Make the compound collision shape of several geometries, and return its number in Bullet.

    Cylinders are exact, not hulls of polygons. A mesh collides by its triangles, but a movable mesh by its
    convex hull, because Bullet cannot move triangles.

    Args:
        geometries: at most MAX_SHAPES shapes with their poses in the body.
        is_movable: whether the body can move.
        engine: PyBullet's client, which makes the shape.
    """
    kinds = {
        Box: pybullet.GEOM_BOX,
        Cylinder: pybullet.GEOM_CYLINDER,
        Sphere: pybullet.GEOM_SPHERE,
        TriangleMesh: pybullet.GEOM_MESH,
    }
    shapes = [geometry.shape for geometry in geometries]
    # Bullet takes one list for each property; each list has an entry for every shape, even for a shape
    # without the property
    arguments: Dict[str, Any] = {}  # arguments that only meshes need
    # a new folder gives each mesh file a new path, because Bullet would not read a path a second time
    with tempfile.TemporaryDirectory() as folder:
        if any(isinstance(shape, TriangleMesh) for shape in shapes):
            names = [os.path.join(folder, f"{number}.obj") for number in range(len(shapes))]
            # with flag 0, Bullet uses the convex hull of the mesh
            flag = 0 if is_movable else pybullet.GEOM_FORCE_CONCAVE_TRIMESH
            arguments["fileNames"] = [
                _write_obj(shape, name) if isinstance(shape, TriangleMesh) else ""
                for shape, name in zip(shapes, names)
            ]
            arguments["meshScales"] = [(1.0, 1.0, 1.0)] * len(shapes)
            arguments["flags"] = [flag if isinstance(shape, TriangleMesh) else 0 for shape in shapes]
        shape: int = engine.createCollisionShapeArray(
            shapeTypes=[kinds[type(shape)] for shape in shapes],
            radii=[getattr(shape, "radius", 0.0) for shape in shapes],
            lengths=[getattr(shape, "length", 0.0) for shape in shapes],
            # Bullet uses these values only for boxes; the `size` of another shape is the box around it
            halfExtents=[[edge / 2.0 for edge in shape.size] for shape in shapes],
            collisionFramePositions=[geometry.pose_in_body.position for geometry in geometries],
            collisionFrameOrientations=[geometry.pose_in_body.quat_xyzw for geometry in geometries],
            **arguments,
        )
    return shape


def _write_obj(mesh: TriangleMesh, path: str) -> str:
    """Write a mesh to a file for Bullet, because on some systems Bullet takes only short arrays."""
    with open(path, "w") as file:
        file.writelines("v {:.9g} {:.9g} {:.9g}\n".format(*vertex) for vertex in mesh.vertices.tolist())
        file.writelines("f {} {} {}\n".format(*face) for face in (mesh.faces + 1).tolist())
    return path
