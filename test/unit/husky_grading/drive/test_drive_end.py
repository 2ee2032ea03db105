"""End of a drive that leads away from the pillar; test_drive_parts.py has the other ends."""

from math import cos, hypot, pi, sin

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
