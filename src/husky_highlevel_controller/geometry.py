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
    """Return the vector a - factor * b."""
    return a[0] - factor * b[0], a[1] - factor * b[1], a[2] - factor * b[2]


def unit(vector: Vector3) -> Optional[Vector3]:
    """Return the vector of the same direction with length 1; None if the vector is shorter than 1e-6."""
    length = sqrt(dot(vector, vector))
    return (vector[0] / length, vector[1] / length, vector[2] / length) if length > 1e-6 else None


def along_axes(axes: Sequence[Vector3], vector: Vector3) -> Vector3:
    """Return the components of a vector along three axes, which is the vector in the frame of the axes."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes
    x, y, z = vector
    return (ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z)


def wrap_angle(angle: float) -> float:
    """Return the angle of the same direction in (-pi, pi] [rad], by adding whole turns."""
    wrapped = (angle + pi) % (2.0 * pi) - pi
    return pi if wrapped == -pi else wrapped


def quat_from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the quaternion of roll, pitch and yaw [rad] about fixed axes: first x, then y, then z."""
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
    """Return the product a * b, which is the rotation `b` followed by the rotation `a`."""
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
    """Return the shortest rotation that turns one unit vector into another."""
    along = dot(start, end)  # cosine of the angle between them
    # the vectors point in opposite directions, so the rotation is half a turn about any axis perpendicular to
    # them
    if along < -1.0 + 1e-9:
        axis = unit(cross(start, (1.0, 0.0, 0.0))) or (0.0, 0.0, 1.0)
        return (*axis, 0.0)
    # With the angle a between the vectors, their product (x, y, z) has the length sin(a), and `length` is
    # 2 cos(a/2). Divided by it, the product has the length sin(a/2), as a quaternion needs; w is cos(a/2).
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
    """Return the x, y and z axes after they were turned by a unit quaternion."""
    x, y, z, w = quat
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def matrix_from_quat(quat: Quaternion) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion; its columns are the turned axes."""
    return np.array(tuple(zip(*axes_from_quat(quat))))  # `zip` makes rows of the three axes into columns


def yaw_from_quat(quat: Quaternion) -> float:
    """Return the yaw of a quaternion: the direction of the turned x axis, seen from above [rad]."""
    x, y, z, w = quat
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def rpy_from_quat(quat: Quaternion) -> Vector3:
    """Return roll, pitch and yaw about fixed axes of a unit quaternion [rad], as for `quat_from_rpy`.

    If x points straight up or down, roll and yaw turn about the same axis, so the yaw is 0.
    """
    # `xz` is the z of the turned x axis, and so on
    (xx, xy, xz), (_, yy, yz), (_, zy, zz) = axes_from_quat(quat)
    level = hypot(xx, xy)  # length of the turned x axis on the ground plane
    pitch = atan2(-xz, level)
    if level > 1e-9:
        return atan2(yz, zz), pitch, atan2(xy, xx)
    return atan2(-zy, yy), pitch, 0.0


def compose(pose_b_in_a: Pose, pose_c_in_b: Pose) -> Pose:
    """Return pose_c_in_a: the pose of c in b, seen from a."""
    moved = rotate(pose_b_in_a.quat_xyzw, pose_c_in_b.position)
    x, y, z = pose_b_in_a.position
    return Pose(
        (x + moved[0], y + moved[1], z + moved[2]),
        quat_multiply(pose_b_in_a.quat_xyzw, pose_c_in_b.quat_xyzw),
    )


def inverse(pose_b_in_a: Pose) -> Pose:
    """Return pose_a_in_b, the inverse of pose_b_in_a."""
    back = quat_inverse(pose_b_in_a.quat_xyzw)
    x, y, z = rotate(back, pose_b_in_a.position)
    return Pose((-x, -y, -z), back)


def transform_point(pose_b_in_a: Pose, point_in_b: Sequence[float]) -> Vector3:
    """Return point_in_a: the same point, in the frame a."""
    dx, dy, dz = rotate(pose_b_in_a.quat_xyzw, point_in_b)
    x, y, z = pose_b_in_a.position
    return (x + dx, y + dy, z + dz)


def transform_points(pose_b_in_a: Pose, points_in_b: np.ndarray) -> np.ndarray:
    """Return points_in_a, (N, 3): the same points, in the frame a."""
    points: np.ndarray = points_in_b @ matrix_from_quat(pose_b_in_a.quat_xyzw).T + pose_b_in_a.position
    return points


def pose_from_2d(pose: Pose2D, z: float = 0.0) -> Pose:
    """Return the pose in space of a pose on the ground plane, at the height `z` [m] and level."""
    half = pose.yaw / 2.0
    return Pose((pose.x, pose.y, z), (0.0, 0.0, sin(half), cos(half)))


def pose_to_2d(pose: Pose) -> Pose2D:
    """Return the pose on the ground plane of a pose in space, without its height, roll and pitch."""
    return Pose2D(pose.position[0], pose.position[1], yaw_from_quat(pose.quat_xyzw))


def world_in_odom(base_in_world: Pose, base_in_odom: Pose2D) -> Pose:
    """Return the pose of the world in odom, from base_link's true pose and its pose by odometry.

    It is needed to draw the objects of the world in odom. Odometry is planar, so base_link stays
    at z = 0 in odom, also on a ramp. So odom counts as level and as high in the world as base_link. Then an
    object and the lidar's echoes from it are drawn at one height.
    """
    level_base_in_world = pose_from_2d(pose_to_2d(base_in_world), base_in_world.position[2])
    return compose(pose_from_2d(base_in_odom), inverse(level_base_in_world))


def advance(pose: Pose2D, twist_in_base: Twist2D, duration: float) -> Pose2D:
    """Return the pose after a constant twist for `duration` [s], exactly on the arc that the robot drives."""
    turn = twist_in_base.angular * duration
    # The robot moves ahead by sin(a)/a and to the left by (1-cos(a))/a of the length of its way, where a is
    # the angle of its turn. For small angles, the series of these terms have smaller rounding errors.
    if abs(turn) < 1e-4:
        along, across = 1.0 - turn * turn / 6.0, turn / 2.0
    else:
        along, across = sin(turn) / turn, (1.0 - cos(turn)) / turn
    length = twist_in_base.linear * duration
    dx, dy = length * along, length * across
    c, s = cos(pose.yaw), sin(pose.yaw)
    return Pose2D(pose.x + c * dx - s * dy, pose.y + s * dx + c * dy, wrap_angle(pose.yaw + turn))
