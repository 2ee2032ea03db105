"""Rotations, quaternions and poses in 2D and 3D.

In: numbers. Out: numbers.
Quaternions are xyzw; roll-pitch-yaw is the URDF/SDF convention (fixed axes x, y, z: R = Rz Ry Rx).
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin, sqrt
from typing import Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import Pose, Pose2D, Quaternion, Twist2D, Vector3

Axes = Tuple[Vector3, Vector3, Vector3]  # unit vectors along a body's x, y and z, in the world


def dot(a: Vector3, b: Vector3) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def minus(a: Vector3, b: Vector3, factor: float = 1.0) -> Vector3:
    """A - factor * b."""
    return a[0] - factor * b[0], a[1] - factor * b[1], a[2] - factor * b[2]


def unit(vector: Vector3) -> Optional[Vector3]:
    """Return the vector at length 1, or None if it is shorter than 1e-6."""
    length = sqrt(dot(vector, vector))
    return (vector[0] / length, vector[1] / length, vector[2] / length) if length > 1e-6 else None


def along_axes(axes: Sequence[Vector3], vector: Vector3) -> Vector3:
    """Components of a vector along three unit vectors: the vector in their frame."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes
    x, y, z = vector
    return (ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z)


def wrap_angle(angle: float) -> float:
    """Angle of the same direction in (-pi, pi] [rad]."""
    wrapped = (angle + pi) % (2.0 * pi) - pi
    return pi if wrapped == -pi else wrapped


def quat_from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Quaternion of fixed-axis roll, pitch, yaw [rad]."""
    cr, sr = cos(roll / 2), sin(roll / 2)
    cp, sp = cos(pitch / 2), sin(pitch / 2)
    cy, sy = cos(yaw / 2), sin(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def quat_multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation `b` followed by `a` (a * b)."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def quat_inverse(quat: Quaternion) -> Quaternion:
    """Inverse of a unit quaternion."""
    x, y, z, w = quat
    return (-x, -y, -z, w)


def quat_between(start: Vector3, end: Vector3) -> Quaternion:
    """The shortest rotation from one unit vector to another."""
    along = dot(start, end)
    # the vectors point in opposite directions, so the rotation is half a turn about any axis perpendicular to
    # them
    if along < -1.0 + 1e-9:
        axis = unit(cross(start, (1.0, 0.0, 0.0))) or (0.0, 0.0, 1.0)
        return (*axis, 0.0)
    (x, y, z), length = cross(start, end), sqrt(2.0 + 2.0 * along)
    return (x / length, y / length, z / length, length / 2.0)


def rotate(quat: Quaternion, vector: Sequence[float]) -> Vector3:
    """Return a vector turned by a unit quaternion (x, y, z, w), as q v q*."""
    qx, qy, qz, qw = quat
    vx, vy, vz = vector
    # with u = (qx, qy, qz) and the vector product t = 2 u x v, the turned vector is v + qw t + u x t
    tx = 2.0 * (qy * vz - qz * vy)
    ty = 2.0 * (qz * vx - qx * vz)
    tz = 2.0 * (qx * vy - qy * vx)
    return (
        vx + qw * tx + qy * tz - qz * ty,
        vy + qw * ty + qz * tx - qx * tz,
        vz + qw * tz + qx * ty - qy * tx,
    )


def axes_from_quat(quat: Quaternion) -> Axes:
    """The turned x, y and z axes of a unit quaternion."""
    x, y, z, w = quat
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def matrix_from_quat(quat: Quaternion) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion; its columns are the turned axes."""
    return np.array(tuple(zip(*axes_from_quat(quat))))


def yaw_from_quat(quat: Quaternion) -> float:
    """Heading of the turned x axis on the ground plane [rad]."""
    x, y, z, w = quat
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def rpy_from_quat(quat: Quaternion) -> Vector3:
    """Fixed-axis roll, pitch, yaw of a unit quaternion, the inverse of `quat_from_rpy` [rad].

    If x points straight up or down, roll and yaw turn about the same axis, so the yaw is 0.
    """
    (xx, xy, xz), (_, yy, yz), (_, zy, zz) = axes_from_quat(quat)
    level = hypot(xx, xy)
    roll, yaw = (atan2(yz, zz), atan2(xy, xx)) if level > 1e-9 else (atan2(-zy, yy), 0.0)
    return roll, atan2(-xz, level), yaw


def compose(pose_b_in_a: Pose, pose_c_in_b: Pose) -> Pose:
    """pose_c_in_a."""
    moved = rotate(pose_b_in_a.quat_xyzw, pose_c_in_b.position)
    x, y, z = pose_b_in_a.position
    return Pose(
        (x + moved[0], y + moved[1], z + moved[2]),
        quat_multiply(pose_b_in_a.quat_xyzw, pose_c_in_b.quat_xyzw),
    )


def inverse(pose_b_in_a: Pose) -> Pose:
    """pose_a_in_b."""
    back = quat_inverse(pose_b_in_a.quat_xyzw)
    x, y, z = rotate(back, pose_b_in_a.position)
    return Pose((-x, -y, -z), back)


def transform_point(pose_b_in_a: Pose, point_in_b: Sequence[float]) -> Vector3:
    """point_in_a."""
    dx, dy, dz = rotate(pose_b_in_a.quat_xyzw, point_in_b)
    x, y, z = pose_b_in_a.position
    return (x + dx, y + dy, z + dz)


def transform_points(pose_b_in_a: Pose, points_in_b: np.ndarray) -> np.ndarray:
    """points_in_a, (N, 3)."""
    points: np.ndarray = points_in_b @ matrix_from_quat(pose_b_in_a.quat_xyzw).T + pose_b_in_a.position
    return points


def pose_from_2d(pose: Pose2D, z: float = 0.0) -> Pose:
    """The pose in space of a pose on the ground, `z` m above it."""
    half = pose.yaw / 2.0
    return Pose((pose.x, pose.y, z), (0.0, 0.0, sin(half), cos(half)))


def pose_to_2d(pose: Pose) -> Pose2D:
    """A pose in space seen from above."""
    return Pose2D(pose.position[0], pose.position[1], yaw_from_quat(pose.quat_xyzw))


def world_in_odom(base_in_world: Pose, base_in_odom: Pose2D) -> Pose:
    """Return the pose of the world in odom, from base_link's true pose and its pose by odometry.

    Odometry is planar, so base_link stays at z = 0 in odom, also on a ramp or a deck. So odom is level, and
    always as high in the world as base_link. Only then are an object and the lidar's echoes from it drawn at
    one height.
    """
    level_base_in_world = pose_from_2d(pose_to_2d(base_in_world), base_in_world.position[2])
    return compose(pose_from_2d(base_in_odom), inverse(level_base_in_world))


def advance(pose: Pose2D, twist_in_base: Twist2D, duration: float) -> Pose2D:
    """Pose after a constant twist for `duration` s: exactly along the arc."""
    turn = twist_in_base.angular * duration
    # sin(a)/a and (1-cos(a))/a of the angle a; for small angles, their series have smaller rounding errors
    if abs(turn) < 1e-4:
        along, across = 1.0 - turn * turn / 6.0, turn / 2.0
    else:
        along, across = sin(turn) / turn, (1.0 - cos(turn)) / turn
    length = twist_in_base.linear * duration
    dx, dy = length * along, length * across
    c, s = cos(pose.yaw), sin(pose.yaw)
    return Pose2D(pose.x + c * dx - s * dy, pose.y + s * dx + c * dy, wrap_angle(pose.yaw + turn))
