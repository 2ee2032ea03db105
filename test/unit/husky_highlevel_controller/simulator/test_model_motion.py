"""Motions of models go from frame to frame as in Gazebo, and numbers that cannot be are refused."""

from math import inf, nan, pi

import pytest

from husky_highlevel_controller.datatypes import ModelMotion, Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.simulator.model_motion import (
    MAX_SPEED,
    checked_motion,
    in_world,
    seen_from,
    velocity_at,
)
from husky_highlevel_controller.simulator.spawn_request import ObjectError

# at (1, 2), facing y, driving along y at 0.5 m/s and turning at 0.1 rad/s
FRAME = ModelMotion(
    Pose((1.0, 2.0, 0.0), quat_from_rpy(0.0, 0.0, pi / 2.0)), (0.0, 0.5, 0.0), (0.0, 0.0, 0.1)
)


def close(left, right):
    for mine, others in zip(left, right):
        assert mine == pytest.approx(others, abs=1e-12)


def test_a_pose_and_a_velocity_in_a_frame_are_turned_into_the_world():
    motion = in_world(ModelMotion(Pose((3.0, 0.0, 0.5)), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), FRAME)
    assert motion.pose.position == pytest.approx((1.0, 5.0, 0.5))
    assert motion.pose.quat_xyzw == pytest.approx(FRAME.pose.quat_xyzw)
    close(motion[1:], ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)))


def test_a_motion_is_seen_from_a_frame_that_moves():
    seen = seen_from(ModelMotion(Pose((1.0, 5.0, 0.0)), (0.0, 1.5, 0.0), (0.0, 0.0, 0.3)), FRAME)
    assert seen.pose.position == pytest.approx((3.0, 0.0, 0.0))
    close(seen[1:], ((1.0, 0.0, 0.0), (0.0, 0.0, 0.2)))


def test_what_stands_still_in_a_frame_that_stands_still_is_the_same_there_and_back():
    at_rest = ModelMotion(FRAME.pose)
    motion = ModelMotion(Pose((0.3, -2.0, 1.0), quat_from_rpy(0.1, 0.2, 0.3)), (1.0, 2.0, 3.0))
    back = seen_from(in_world(motion, at_rest), at_rest)
    close((*back.pose, *back[1:]), (*motion.pose, *motion[1:]))


def test_a_point_of_a_body_that_turns_moves_around_its_origin():
    spinning = ModelMotion(Pose((1.0, 0.0, 0.0)), (0.0, 0.0, 0.2), (0.0, 0.0, 2.0))
    assert velocity_at(spinning, (2.0, 0.0, 0.0)) == pytest.approx((0.0, 2.0, 0.2))


def test_an_orientation_of_zeros_is_no_rotation_and_a_long_one_is_shortened():
    for quat in ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 2.5)):
        assert checked_motion(ModelMotion(Pose((1.0, 0.0, 0.0), quat))).pose == Pose((1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (ModelMotion(Pose((nan, 0.0, 0.0))), "position nan"),
        (ModelMotion(Pose((1e5, 0.0, 0.0))), "position 100000.0"),
        (ModelMotion(Pose(quat_xyzw=(nan, 0.0, 0.0, 1.0))), "orientation"),
        (ModelMotion(Pose(quat_xyzw=(inf, 0.0, 0.0, 1.0))), "orientation"),
        (ModelMotion(Pose(), (0.0, 2.0 * MAX_SPEED, 0.0)), "twist 200 is not within -100..100"),
        (ModelMotion(Pose(), (0.0, 0.0, 0.0), (nan, 0.0, 0.0)), "twist nan"),
    ],
)
def test_numbers_that_cannot_be_are_refused_with_their_name(motion, words):
    with pytest.raises(ObjectError, match=words):
        checked_motion(motion)
