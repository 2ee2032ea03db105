"""Spawn requests: a requested object becomes a body, or is refused with the reason.

In: a name, a shape's name, its size, a mass, a pose. Out: a `Body`.
"""

from __future__ import annotations

from math import hypot, isfinite
from typing import Sequence

from husky_highlevel_controller.datatypes import (
    Body,
    Box,
    Cylinder,
    Geometry,
    HuskyError,
    Plane,
    Pose,
    Shape,
    Sphere,
    TriangleMesh,
    Vector3,
)

SIZES = (0.001, 1000.0)  # [m] limits of the edges of a shape
MASSES = (0.001, 1e5)  # [kg] limits of the mass of a movable body
FARTHEST = 1e4  # [m] a position with a larger coordinate is refused
ROUNDING = 1e-3  # a quaternion is refused if its length differs from 1 by more than this margin for rounding


class ObjectError(HuskyError):
    """A request for an object that cannot be made; the text names the parameter and its value."""


def make_object(name: str, shape: str, size: Vector3, mass: float, pose_in_world: Pose) -> Body:
    """Return a body of one solid shape.

    Args:
        name: letters, digits, and any of _ - . :
        shape: box, cylinder or sphere.
        size: edges of the box around the shape [m]; for a cylinder (diameter, diameter, length).
        mass: mass [kg]; 0 for a body that never moves.
        pose_in_world: pose of the shape's centre.

    Raises:
        ObjectError: an argument is not valid.
    """
    geometry = Geometry(_shape(shape, size))
    return checked(Body(name, pose_in_world, (geometry,), (geometry,), mass))


def checked(body: Body) -> Body:
    """Return the same body. Raises ObjectError if its name, mass, size or pose is not valid."""
    check_name(body.name)
    check_bounds(body)
    return body


def check_name(name: str) -> None:
    """Raise ObjectError if a name is not valid for an object."""
    if not name or not all(letter.isalnum() or letter in "_-.:" for letter in name):
        raise ObjectError(f"model_name '{name}' is not a name (letters, digits and _ - . :)")


def check_bounds(body: Body) -> None:
    """Raise ObjectError if a body's mass, size or pose is not valid."""
    if body.mass != 0.0:
        _within(body.mass, MASSES, "mass", "kg; 0 is for a body that never moves")
    for geometry in body.collisions:
        if isinstance(geometry.shape, TriangleMesh):
            # only the largest edge is checked, because a flat mesh has the size 0 along its normal
            _within(max(geometry.shape.size), SIZES, "size", "m")
        elif not isinstance(geometry.shape, Plane):  # a plane is endless
            for value in geometry.shape.size:
                _within(value, SIZES, "size", "m")
    for geometry in (*body.collisions, *body.visuals):
        for value in geometry.pose_in_body.position:
            _within(value, (-FARTHEST, FARTHEST), "position of a shape in it", "m")
    checked_pose(body.pose_in_world)


def checked_pose(pose: Pose) -> Pose:
    """Return the pose with a quaternion of length 1. Raises ObjectError if the pose is not valid."""
    for value in pose.position:
        _within(value, (-FARTHEST, FARTHEST), "position", "m")
    length = hypot(*pose.quat_xyzw)
    if not abs(length - 1.0) <= ROUNDING:  # NaN fails this comparison too
        raise ObjectError(
            f"orientation {pose.quat_xyzw} is not a unit quaternion (x, y, z, w); no rotation is 0, 0, 0, 1"
        )
    x, y, z, w = (value / length for value in pose.quat_xyzw)
    return Pose(pose.position, (x, y, z, w))


def _shape(shape: str, size: Vector3) -> Shape:
    """Return a box, cylinder or sphere from the edges of the box around it [m]. Raises ObjectError."""
    x, y, z = (_within(value, SIZES, "size", "m") for value in size)
    if shape == "box":
        return Box((x, y, z))
    if shape == "cylinder" and x == y:
        return Cylinder(x / 2.0, z)
    if shape == "sphere" and x == y == z:
        return Sphere(x / 2.0)
    if shape in ("cylinder", "sphere"):
        raise ObjectError(f"size {size} is not valid for a {shape}, whose diameters must be equal")
    raise ObjectError(f"shape '{shape}' is not one of box, cylinder, sphere")


def _within(value: float, limits: Sequence[float], name: str, unit: str) -> float:
    """Return the value if it is within limits. Raises ObjectError with name and unit if it is not."""
    low, high = limits
    if not (isfinite(value) and low <= value <= high):
        raise ObjectError(f"{name} {value} is not within {low}..{high} {unit}")
    return value
