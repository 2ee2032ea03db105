"""Rotations, poses and arcs agree with SciPy's, and with the conventions users rely on."""

from math import cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from husky_highlevel_controller.datatypes import Pose, Pose2D, Twist2D
from husky_highlevel_controller.geometry import (
    advance,
    compose,
    inverse,
    matrix_from_quat,
    pose_from_2d,
    pose_to_2d,
    quat_between,
    quat_from_rpy,
    rotate,
    rpy_from_quat,
    transform_point,
    wrap_angle,
    yaw_from_quat,
)

angles = st.floats(-10.0, 10.0)
lengths = st.floats(-20.0, 20.0)
vectors = st.tuples(lengths, lengths, lengths)
quats = st.builds(quat_from_rpy, angles, angles, angles)
poses = st.builds(Pose, vectors, quats)
poses_2d = st.builds(Pose2D, lengths, lengths, angles)
twists = st.builds(Twist2D, st.floats(-1.0, 1.0), st.floats(-2.0, 2.0))


def near(expected, tolerance=1e-9):
    return pytest.approx(expected, abs=tolerance)


def transform(pose):
    """The homogeneous matrix (4, 4) of a pose, by SciPy."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(pose.quat_xyzw).as_matrix()
    matrix[:3, 3] = pose.position
    return matrix


@given(st.floats(-1e4, 1e4))
@example(pi)  # straight behind is plus pi from either side
@example(-pi)
@example(-3.0 * pi)
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap_angle(angle)
    assert -pi < wrapped <= pi
    assert (cos(wrapped), sin(wrapped)) == near((cos(angle), sin(angle)))
    assert wrap_angle(wrapped) == near(wrapped, 1e-12)


@given(angles, angles, angles, vectors)
def test_rpy_turns_about_fixed_axes_x_then_y_then_z(roll, pitch, yaw, vector):
    expected = Rotation.from_euler("xyz", (roll, pitch, yaw))
    quat = quat_from_rpy(roll, pitch, yaw)
    assert rotate(quat, vector) == near(expected.apply(vector))
    assert matrix_from_quat(quat) == near(expected.as_matrix())
    for attitude in (quat, quat_from_rpy(roll, pi / 2.0, yaw), quat_from_rpy(roll, -pi / 2.0, yaw)):
        again = quat_from_rpy(*rpy_from_quat(attitude))
        assert matrix_from_quat(again) == near(matrix_from_quat(attitude))


@given(quats)
def test_yaw_is_where_the_nose_points_seen_from_above(quat):
    x, y, _ = rotate(quat, (1.0, 0.0, 0.0))
    heading = hypot(x, y)  # 0 when it points straight up: no heading then
    yaw = yaw_from_quat(quat)
    assert (heading * cos(yaw), heading * sin(yaw)) == near((x, y), 1e-7)


@given(poses, poses, vectors)
def test_poses_are_composed_inverted_and_move_points_as_homogeneous_matrices(a, b, point):
    assert transform(compose(a, b)) == near(transform(a) @ transform(b))
    assert transform(inverse(a)) == near(np.linalg.inv(transform(a)))
    assert (*transform_point(a, point), 1.0) == near(transform(a) @ (*point, 1.0))


@given(poses_2d, lengths, twists, st.floats(0.0, 3.0))
@example(
    Pose2D(), 0.0, Twist2D(1.0, 2e-7), 1.0
)  # nearly straight, either side of where the series takes over
@example(Pose2D(), 0.0, Twist2D(1.0, 9e-5), 1.0)
@example(Pose2D(), 0.0, Twist2D(1.0, -5e-3), 1.0)
def test_an_arc_is_the_exponential_of_its_twist_with_the_heading_wrapped(start, z, twist, duration):
    generator = np.zeros((4, 4))
    generator[0, 3], generator[1, 0], generator[0, 1] = twist.linear, twist.angular, -twist.angular
    expected = transform(pose_from_2d(start, z)) @ expm(duration * generator)
    end = advance(start, twist, duration)
    assert transform(pose_from_2d(end, z)) == near(expected, 1e-11)
    assert -pi < end.yaw <= pi
    assert pose_from_2d(end, z).position[2] == z
    assert pose_to_2d(pose_from_2d(end, z)) == near(end)


@pytest.mark.parametrize("start", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize(
    "end", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (-0.6, 0.0, 0.8), (0.0, 0.6, 0.8)]
)
def test_the_rotation_between_two_directions_turns_one_to_the_other(start, end):
    quat = quat_between(start, end)
    assert rotate(quat, start) == pytest.approx(end, abs=1e-9)
    assert np.linalg.norm(quat) == pytest.approx(1.0)
