"""Mistakes in the steering, found in drives made of numbers."""

from dataclasses import replace

import numpy as np
import pytest
from drives import PERIOD, drive

from husky_grading.rubrics import steering
from husky_grading.rubrics.steering import explain_steering

LEFT, AHEAD, RIGHT = (10.0, 8.0), (10.0, 0.0), (10.0, -8.0)  # [m] places of the pillar
DRIVE = drive((3.0, 0.5))


def turning(rates, pillar=LEFT):
    """A drive along x, with these rates of turn [rad/s] one after the other."""
    turns = np.repeat(rates, len(DRIVE.times) // len(rates))
    speeds, poses = DRIVE.speeds.copy()[: len(turns)], DRIVE.poses.copy()[: len(turns)]
    speeds[:, 1] = turns
    poses[:, 2] = np.cumsum(turns) * PERIOD
    return replace(DRIVE, poses=poses, speeds=speeds, pillar=pillar)


@pytest.mark.parametrize(
    ("recording", "ending", "hint"),
    [
        (replace(DRIVE, fastest=0.0), "linear.x is 0 in all commands", steering.NO_SPEED),
        (drive((-3.0, -0.5)), "it drives backwards", steering.BACKWARDS),
        (replace(turning([0.0]), sharpest=0.0), "it never turns", steering.NO_TURN),
        (turning([-0.1]), "", steering.TURNS),
        (turning([0.1], RIGHT), "", steering.TURNS),
        (turning([0.05, -0.05] * 5), "", steering.SWERVES),
        # round and round, so that the pillar is to the left half of the time
        (turning([2.0 * np.pi]), "it turns left all the time", steering.SWERVES),
        (turning([-2.0 * np.pi]), "it turns right all the time", steering.SWERVES),
    ],
)
def test_the_mistake_is_named(recording, ending, hint):
    explanation = explain_steering(recording)
    assert ending in explanation.ending
    assert bool(ending) == bool(explanation.ending)
    assert explanation.hint == hint


def test_who_turns_to_the_pillar_is_told_that_the_turn_is_too_slow():
    assert "too slowly for 0.5 m/s" in explain_steering(turning([0.05])).hint


@pytest.mark.parametrize(("rate", "turns_away"), [(-0.1, True), (-0.01, False), (0.0, False), (0.05, False)])
def test_only_a_fast_turn_to_the_other_side_is_a_turn_away(rate, turns_away):
    assert explain_steering(turning([rate])).has_turned_away == turns_away
