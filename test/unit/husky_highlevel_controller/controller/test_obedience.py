"""A robot that stands while the controller commands motion does not obey, and any other one does."""

import pytest

from husky_highlevel_controller.controller.obedience import Obedience
from husky_highlevel_controller.datatypes import STOP, Pose2D, Twist2D

FORWARD, TURN = Twist2D(0.5, 0.0), Twist2D(0.0, 0.3)


def obeys(poses, twist, rate=50.0):
    """Whether a robot obeys at the end, whose poses (one for each scan, None if unknown) are these."""
    memory = Obedience()
    for number, pose in enumerate(poses):
        memory = memory.after(number / rate, pose, twist)
    return memory.obeys


@pytest.mark.parametrize("twist", [FORWARD, TURN])
@pytest.mark.parametrize(("seconds", "expected"), [(1.9, True), (2.1, False)])
def test_a_robot_that_stands_for_two_seconds_against_its_commands_does_not_obey(twist, seconds, expected):
    assert obeys([Pose2D(1.0, 2.0, 0.3)] * int(50 * seconds + 1), twist) is expected


@pytest.mark.parametrize(
    ("poses", "twist"),
    [
        ([Pose2D(0.002 * n, 0.0, 0.0) for n in range(500)], FORWARD),
        ([Pose2D(0.0, 0.0, 0.002 * n) for n in range(500)], TURN),
        ([Pose2D(0.0, 0.0, 0.0)] * 500, STOP),
        ([Pose2D(0.0, 0.0, 0.0)] * 500, Twist2D(0.04, 0.0)),
        ([None] * 500, FORWARD),
    ],
)
def test_a_robot_that_moves_or_need_not_move_or_whose_pose_is_unknown_obeys(poses, twist):
    assert obeys(poses, twist)


def test_a_robot_that_moves_again_obeys_at_once():
    assert obeys([*[Pose2D(0.0, 0.0, 0.0)] * 200, Pose2D(0.03, 0.0, 0.0)], FORWARD)


def test_a_jump_of_the_clock_is_not_a_time_for_which_the_robot_stands():
    memory = Obedience()
    for number in range(100):  # the clock is set right after one second
        stamp = number / 50.0 + (10.0 if number > 50 else 0.0)
        memory = memory.after(stamp, Pose2D(0.01 * number, 0.0, 0.0), FORWARD)
        assert memory.obeys
    memory = Obedience().after(0.0, Pose2D(), FORWARD).after(1.8e9, Pose2D(), FORWARD)
    assert memory.obeys
