"""End of a drive: at the pillar, where the robot stands or drives away, and where its nodes have ended."""

from math import cos, hypot, inf, pi, sin

import pytest

from husky_grading.drive.drive_end import DriveEnd
from husky_grading.notes import Kind
from husky_highlevel_controller.datatypes import Pose, TrueState

PILLAR, PERIOD, DEADLINE = (10.0, 3.0), 0.1, 120.0


def drive(turn_rate, speed=1.0):
    """(moment [s], end, distance to the pillar then [m]) of a drive from the origin along x; None: no end."""
    end, x, y, yaw = DriveEnd(PILLAR, "husky"), 0.0, 0.0, 0.0
    for step in range(1, int(DEADLINE / PERIOD)):
        now = step * PERIOD
        rate = turn_rate(now)
        yaw, x, y = yaw + rate * PERIOD, x + speed * PERIOD * cos(yaw), y + speed * PERIOD * sin(yaw)
        pose = Pose((x, y, 0.1), (0.0, 0.0, sin(yaw / 2.0), cos(yaw / 2.0)))
        end.update(TrueState(now, pose, speed, rate))
        if end.reason():
            return now, end.reason(), hypot(x - PILLAR[0], y - PILLAR[1])
    return None


@pytest.mark.parametrize(
    ("turn_rate", "at"),
    [
        (lambda now: 0.0, 22.0),  # past the pillar after 10 s, 10 m past it some 12 s later
        (lambda now: 0.0 if now < 30.0 else 0.5, 22.0),  # too late
        (lambda now: pi / 2.0 if now < 2.0 else 0.0, 12.0),  # away from it at once
    ],
    ids=["straight on", "turns too late", "away from the start"],
)
def test_a_drive_ends_10_m_past_its_nearest_point_where_it_drives_straight_away(turn_rate, at):
    moment, end, distance = drive(turn_rate)
    assert end.kind is Kind.LEAVES
    assert moment == pytest.approx(at, abs=2.0)
    assert distance > 10.0
    assert end.text.endswith("and drove on")


@pytest.mark.parametrize("rate", [-0.05, 0.1, 0.3])
def test_a_robot_that_turns_however_slowly_may_come_back(rate):
    assert drive(lambda now: rate) is None


def test_a_robot_that_drives_away_first_and_turns_round_is_not_ended():
    """It drives away for 8 s, and then on a curve."""
    assert drive(lambda now: pi / 2.0 if now < 2.0 else 0.0 if now < 10.0 else 0.25) is None


def end_of(states, abandoned_at=inf):
    """The first moment at which a drive of (stamp, x, speed) is over, and why."""
    end = DriveEnd((10.0, 0.0), "husky")
    for stamp, x, speed in states:
        end.update(TrueState(stamp, Pose((x, 0.0, 0.1)), speed, 0.0))
        reason = end.reason(stamp >= abandoned_at)
        if reason:
            return stamp, reason.text
    return None, ""


def standing(x, start, seconds, speed=0.0):
    return [(start + 0.1 * n, x, speed) for n in range(int(10 * seconds))]


MOVES = (1.0, 5.0, 1.0)
ABANDONED = "its nodes had ended, and it stood still for 3 s"


@pytest.mark.parametrize(
    ("states", "abandoned_at", "ends_at", "why"),
    [
        ([MOVES, *standing(9.2, 2.0, 5.0)], inf, 5.0, "it stands at the pillar"),
        ([MOVES, *standing(9.4, 2.0, 5.0, speed=1.0)], inf, 5.0, "it reached the pillar and touched it"),
        (standing(0.0, 0.0, 30.0), inf, 12.0, "it did not move for 12 s"),  # of which it may sleep 10
        ([MOVES, *standing(5.0, 1.1, 30.0)], inf, 16.0, "it stood still for 15 s"),
        # its nodes have ended: it rolls out
        ([MOVES, (2.0, 5.5, 0.2), *standing(5.6, 2.1, 30.0)], 1.0, 5.0, ABANDONED),
        (standing(0.0, 0.0, 30.0), 0.0, 3.0, ABANDONED),
        ([(1.0, 9.2, 1.0), *standing(9.2, 1.1, 5.0)], 2.0, 4.1, "it stands at the pillar"),
    ],
)
def test_when_a_drive_is_over(states, abandoned_at, ends_at, why):
    stamp, said = end_of(states, abandoned_at)
    assert (stamp, said) == (pytest.approx(ends_at, abs=0.2), why)
