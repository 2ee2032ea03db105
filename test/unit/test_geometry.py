"""Rotations, poses and arcs: the laws they obey, and the conventions users rely on."""

from math import cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
    quat_inverse,
    quat_multiply,
    rotate,
    rpy_from_quat,
    transform_point,
    wrap_angle,
    yaw_from_quat,
)

LAW = settings(derandomize=True, deadline=None, max_examples=60)

angles = st.floats(-10.0, 10.0)
lengths = st.floats(-20.0, 20.0)
vectors = st.tuples(lengths, lengths, lengths)
quats = st.builds(quat_from_rpy, angles, angles, angles)
poses = st.builds(Pose, vectors, quats)
poses_2d = st.builds(Pose2D, lengths, lengths, angles)
twists = st.builds(Twist2D, st.floats(-1.0, 1.0), st.floats(-2.0, 2.0))


def near(expected, tolerance=1e-9):
    return pytest.approx(expected, abs=tolerance)


def assert_same_pose(a, b):
    assert a.position == near(b.position)
    # q and -q are the same rotation
    assert matrix_from_quat(a.quat_xyzw) == near(matrix_from_quat(b.quat_xyzw))


def assert_same_pose_2d(a, b, tolerance=1e-9):
    assert (a.x, a.y) == near((b.x, b.y), tolerance)
    assert wrap_angle(a.yaw - b.yaw) == near(0.0, tolerance)


@LAW
@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap_angle(angle)
    assert -pi < wrapped <= pi
    assert (cos(wrapped), sin(wrapped)) == near((cos(angle), sin(angle)))
    assert wrap_angle(wrapped) == near(wrapped, 1e-12)


@pytest.mark.parametrize("angle", [pi, -pi, 3.0 * pi, -3.0 * pi])
def test_straight_behind_is_plus_pi_from_either_side(angle):
    assert wrap_angle(angle) == pi


@LAW
@given(angles, angles, angles, vectors)
def test_rpy_turns_about_fixed_axes_x_then_y_then_z(roll, pitch, yaw, vector):
    about_x = [[1, 0, 0], [0, cos(roll), -sin(roll)], [0, sin(roll), cos(roll)]]
    about_y = [[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]]
    about_z = [[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]]
    expected = np.array(about_z) @ about_y @ about_x
    quat = quat_from_rpy(roll, pitch, yaw)
    assert rotate(quat, vector) == near(tuple(expected @ vector))
    assert matrix_from_quat(quat) == near(expected)
    for attitude in (quat, quat_from_rpy(roll, pi / 2.0, yaw), quat_from_rpy(roll, -pi / 2.0, yaw)):
        again = quat_from_rpy(*rpy_from_quat(attitude))
        assert matrix_from_quat(again) == near(matrix_from_quat(attitude))


@LAW
@given(quats, quats, vectors)
def test_a_product_of_quaternions_turns_by_the_right_one_first(a, b, vector):
    assert rotate(quat_multiply(a, b), vector) == near(rotate(a, rotate(b, vector)))


@LAW
@given(quats, vectors)
def test_the_inverse_turns_back(quat, vector):
    assert rotate(quat_inverse(quat), rotate(quat, vector)) == near(vector)


@LAW
@given(quats)
def test_yaw_is_where_the_nose_points_seen_from_above(quat):
    x, y, _ = rotate(quat, (1.0, 0.0, 0.0))
    heading = hypot(x, y)  # 0 when it points straight up: no heading then
    yaw = yaw_from_quat(quat)
    assert (heading * cos(yaw), heading * sin(yaw)) == near((x, y), 1e-7)


@LAW
@given(poses)
def test_a_pose_and_its_inverse_cancel(pose):
    assert_same_pose(compose(pose, inverse(pose)), Pose())
    assert_same_pose(compose(inverse(pose), pose), Pose())


@LAW
@given(poses, poses, poses)
def test_composing_poses_is_associative(a, b, c):
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)))


@LAW
@given(poses, poses, vectors)
def test_a_composed_pose_moves_points_like_its_parts_in_turn(a, b, point):
    assert transform_point(compose(a, b), point) == near(transform_point(a, transform_point(b, point)))


def test_a_point_ahead_of_a_robot_that_looks_left():
    looking_left = Pose((2.0, 1.0, 0.5), quat_from_rpy(0.0, 0.0, pi / 2.0))
    assert transform_point(looking_left, (3.0, 0.0, 0.0)) == near((2.0, 4.0, 0.5))


@LAW
@given(poses_2d, lengths)
def test_a_pose_on_the_ground_survives_the_way_into_space_and_back(pose, z):
    in_space = pose_from_2d(pose, z)
    assert in_space.position[2] == z
    assert_same_pose_2d(pose_to_2d(in_space), pose)


@LAW
@given(poses_2d, twists, st.floats(0.0, 3.0))
def test_two_half_steps_are_one_whole_step(start, twist, duration):
    half = advance(start, twist, duration / 2.0)
    assert_same_pose_2d(advance(half, twist, duration / 2.0), advance(start, twist, duration))


@pytest.mark.parametrize("angular", [9e-5, 1.1e-4, 1.9e-4, -1.5e-4])
def test_nearly_straight_arcs_keep_their_digits(angular):
    # either side of where the series takes over: a hundred short steps, one long one
    twist, pose = Twist2D(1.0, angular), Pose2D()
    for _ in range(100):
        pose = advance(pose, twist, 0.01)
    assert_same_pose_2d(pose, advance(Pose2D(), twist, 1.0), 1e-11)


@LAW
@given(poses_2d, twists, st.floats(0.0, 3.0))
def test_backing_up_returns_to_the_start(start, twist, duration):
    back = Twist2D(-twist.linear, -twist.angular)
    assert_same_pose_2d(advance(advance(start, twist, duration), back, duration), start)


@pytest.mark.parametrize(
    ("start", "twist", "seconds", "end"),
    [
        (Pose2D(1.0, 2.0, pi / 2.0), Twist2D(0.5, 0.0), 4.0, Pose2D(1.0, 4.0, pi / 2.0)),  # straight ahead
        (Pose2D(), Twist2D(1.0, 0.5), pi, Pose2D(2.0, 2.0, pi / 2.0)),  # a quarter circle to the left
        (Pose2D(1.0, -1.0, 3.0), Twist2D(0.0, 1.0), 1.0, Pose2D(1.0, -1.0, 4.0)),  # in place
    ],
)
def test_an_arc_ends_where_it_should_with_the_heading_wrapped(start, twist, seconds, end):
    found = advance(start, twist, seconds)
    assert_same_pose_2d(found, end)
    assert -pi < found.yaw <= pi


@pytest.mark.parametrize("start", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize(
    "end", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (-0.6, 0.0, 0.8), (0.0, 0.6, 0.8)]
)
def test_the_rotation_between_two_directions_turns_one_to_the_other(start, end):
    quat = quat_between(start, end)
    assert rotate(quat, start) == pytest.approx(end, abs=1e-9)
    assert np.linalg.norm(quat) == pytest.approx(1.0)
