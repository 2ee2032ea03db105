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

# [m^3] A mesh with a smaller volume counts with this volume. The centre of mass is a mean weighted by
# volumes, so it could not be computed for a flat mesh, whose volume is 0.
_LEAST_VOLUME = 1e-9


def volume_and_center(geometries: Sequence[Geometry]) -> Tuple[float, Vector3]:
    """Return the volume of all solid geometries together [m^3], and their centre of mass in the body [m].

    All geometries have the same density.
    """
    solids = [_volume_and_center(geometry) for geometry in geometries]
    volumes = np.array([volume for volume, _ in solids])
    centers = np.array([center for _, center in solids])  # (N, 3)
    weights = volumes / volumes.sum()
    x, y, z = (weights @ centers).tolist()
    return float(volumes.sum()), (x, y, z)


def _volume_and_center(geometry: Geometry) -> Tuple[float, Vector3]:
    """Volume [m^3] of a solid geometry, and its centre of mass in its body's frame [m]."""
    shape, position = geometry.shape, geometry.pose_in_body.position
    if isinstance(shape, TriangleMesh):
        volume, centroid = volume_of(shape)
        return max(volume, _LEAST_VOLUME), transform_point(geometry.pose_in_body, centroid)
    if isinstance(shape, Box):
        return float(np.prod(shape.size)), position
    if isinstance(shape, Cylinder):
        return np.pi * shape.radius**2 * shape.length, position
    if isinstance(shape, Sphere):
        return 4.0 / 3.0 * np.pi * shape.radius**3, position
    raise TypeError(f"{shape} has no volume")


MAX_SHAPES = 16  # PyBullet leaves out further shapes of a compound, without an error


def compound_shape(geometries: Sequence[Geometry], is_movable: bool, engine: Any) -> int:
    """Make one collision shape of several geometries in Bullet, and return Bullet's number of this shape.

    Cylinders are exactly round. A mesh that never moves collides by its triangles. A movable mesh collides by
    its convex hull, because Bullet cannot move triangles.

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
    # Bullet takes a list for each property, such as the radii. Each list needs an entry for every shape, even
    # for a shape that does not have the property, such as the radius of a box.
    mesh_arguments: Dict[str, Any] = {}
    # Bullet reads meshes from files, and does not read a file of the same name again. A new folder gives each
    # mesh a new name.
    with tempfile.TemporaryDirectory() as folder:
        if any(isinstance(shape, TriangleMesh) for shape in shapes):
            # with flag 0, Bullet uses the convex hull of the mesh
            mesh_flag = 0 if is_movable else pybullet.GEOM_FORCE_CONCAVE_TRIMESH
            file_names, flags = [""] * len(shapes), [0] * len(shapes)
            for index, shape in enumerate(shapes):
                if isinstance(shape, TriangleMesh):
                    file_names[index] = os.path.join(folder, f"{index}.obj")
                    flags[index] = mesh_flag
                    _write_obj(shape, file_names[index])
            scales = [(1.0, 1.0, 1.0)] * len(shapes)
            mesh_arguments = {"fileNames": file_names, "meshScales": scales, "flags": flags}
        shape_number: int = engine.createCollisionShapeArray(
            shapeTypes=[kinds[type(shape)] for shape in shapes],
            radii=[getattr(shape, "radius", 0.0) for shape in shapes],
            lengths=[getattr(shape, "length", 0.0) for shape in shapes],
            # Bullet uses these values only for boxes; the `size` of any other shape is that of the box around
            # the shape
            halfExtents=[[edge / 2.0 for edge in shape.size] for shape in shapes],
            collisionFramePositions=[geometry.pose_in_body.position for geometry in geometries],
            collisionFrameOrientations=[geometry.pose_in_body.quat_xyzw for geometry in geometries],
            **mesh_arguments,
        )
    return shape_number


def _write_obj(mesh: TriangleMesh, path: str) -> None:
    """Write a mesh to a Wavefront OBJ file for Bullet.

    Bullet also takes meshes as arrays, but on some systems only short arrays.
    """
    with open(path, "w") as file:
        file.writelines("v {:.9g} {:.9g} {:.9g}\n".format(*vertex) for vertex in mesh.vertices.tolist())
        # OBJ counts vertices from 1
        file.writelines("f {} {} {}\n".format(*face) for face in (mesh.faces + 1).tolist())
