"""Probable mistakes in the steering of a robot that moves, but misses the pillar."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from husky_grading.recording import Recording
from husky_grading.rubrics.causes import moves_nothing
from husky_highlevel_controller.course import STANDS

# The pillar is to the side of the robot if the absolute sine of its bearing is above ASIDE. The robot should
# then turn towards the pillar. The turns are right if more than the fraction MOSTLY of them lead towards the
# pillar. If at most the fraction 1 - MOSTLY of them do, angular.z has the wrong sign.
ASIDE, MOSTLY = 0.1, 0.6
# the robot turns to one side all the time if the fraction ONE_WAY of its turns goes to this side; turns
# slower than TURNS_ON [rad/s] do not count
TURNS_ON, ONE_WAY = 0.05, 0.9
# hints for the student
TURNS = "check the sign of angular.z: positive turns left, and the angle is in the lidar's own frame"
SWERVES = (
    "print the angle that you compute and angular.z, because these turns do not follow the pillar's angle"
)
NO_TURN = "set angular.z from the pillar's angle; a gain that is read into an int is cut to 0"
NO_SPEED = "set linear.x, too"
BACKWARDS = "check the sign of linear.x: positive drives ahead"


class Explanation(NamedTuple):
    """Probable mistake behind a loss of points."""

    ending: str  # end of the sentence in the report, such as "; it drives backwards"; may be empty
    hint: str
    has_turned_away: bool = False  # true if fast turns have led away from the pillar


def explain_steering(recording: Recording) -> Explanation:
    """Return the probable mistake of a robot that moves, but misses the pillar.

    A speed or a rate of turn may be always 0, or the speed negative. If neither is so, `_explain_turns`
    compares the directions of the turns with the side on which the pillar is.
    """
    if moves_nothing(recording.fastest):  # largest speed of all commands
        return Explanation(ending="; linear.x is 0 in all commands", hint=NO_SPEED)
    # speeds (M,) [m/s] and rates of turn (M,) [rad/s], positive to the left, while the robot moves
    speeds, turns = recording.speeds[recording.moving].T
    if float(np.median(speeds)) < -STANDS:
        return Explanation(ending="; it drives backwards", hint=BACKWARDS)
    if moves_nothing(recording.sharpest):  # largest rate of turn of all commands
        return Explanation(ending="; it never turns: angular.z is 0 in all commands", hint=NO_TURN)
    return _explain_turns(recording, speeds, turns)


def _explain_turns(recording: Recording, speeds: np.ndarray, turns: np.ndarray) -> Explanation:
    """Return the probable mistake of a robot that drives ahead and turns, but misses the pillar.

    Args:
        recording: recording of the run.
        speeds: (M,) [m/s] speeds while the robot moves.
        turns: (M,) [rad/s] rates of turn at the same moments, positive to the left.
    """
    sines = _sines_of_bearings(recording)  # (M,), positive while the pillar is to the left
    # only moments with the pillar to the side can show whether a turn leads towards the pillar
    is_aside = np.abs(sines) > ASIDE
    turns_aside = turns[is_aside]  # (K,) [rad/s]
    is_to_pillar = np.sign(turns_aside) == np.sign(sines[is_aside])  # (K,) true for turns towards the pillar
    # If the pillar is never to the side, this fraction is 0. So a robot that drives straight away from the
    # pillar gets the hint on a wrong sign.
    fraction_to_pillar = float(np.mean(is_to_pillar)) if len(is_to_pillar) else 0.0
    if fraction_to_pillar > MOSTLY:
        speed = float(np.median(np.abs(speeds[is_aside])))
        hint = f"it turns towards the pillar, but too slowly for {speed:.1f} m/s: a larger gain, or slower "
        return Explanation(ending="", hint=f"{hint}while the angle is large")
    if fraction_to_pillar > 1.0 - MOSTLY:
        # the robot turns sometimes towards the pillar and sometimes away from it
        return Explanation(_say_one_way(turns), hint=SWERVES)
    # most turns lead away from the pillar, so the sign of angular.z is probably wrong
    return Explanation("", hint=TURNS, has_turned_away=_has_turned_away(turns_aside, is_to_pillar))


def _sines_of_bearings(recording: Recording) -> np.ndarray:
    """Return the sine of the pillar's bearing at the moments at which the robot moves, (M,).

    The sine is positive while the pillar is to the left of the robot, and negative while it is to the right.
    """
    # (N,) [m] each, way from the robot to the pillar, in the world
    dx, dy = (np.array(recording.pillar) - recording.poses[:, :2]).T
    # (N,) [rad] direction of the pillar seen from the robot, positive to the left
    bearings = np.arctan2(dy, dx) - recording.poses[:, 2]
    return np.sin(bearings[recording.moving])


def _has_turned_away(turns: np.ndarray, is_to_pillar: np.ndarray) -> bool:
    """Return whether most of the fast turns lead away from the pillar.

    Slow turns prove nothing, because a robot that drives nearly straight on has slow turns, too.

    Args:
        turns: (K,) [rad/s] rates of turn while the pillar is to the side, positive to the left.
        is_to_pillar: (K,) true for turns towards the pillar.
    """
    fast_is_to_pillar = is_to_pillar[np.abs(turns) > TURNS_ON]
    return len(fast_is_to_pillar) > 0 and float(np.mean(fast_is_to_pillar)) <= 1.0 - MOSTLY


def _say_one_way(turns: np.ndarray) -> str:
    """Return the end of a sentence on a robot that turns to one side all the time; empty if it does not.

    `turns` has the rates of turn [rad/s], positive to the left.
    """
    fast_turns = turns[np.abs(turns) > TURNS_ON]
    if not len(fast_turns):
        return ""
    fraction_left = float(np.mean(fast_turns > 0.0))
    if fraction_left >= ONE_WAY:
        return "; it turns left all the time"
    if 1.0 - fraction_left >= ONE_WAY:
        return "; it turns right all the time"
    return ""
