"""End of a run of exercise 3, decided by the robot's motion and its distance from the pillar."""

from __future__ import annotations

from math import inf
from typing import Optional, Tuple

import numpy as np

from husky_grading.notes import Kind, Note
from husky_grading.recording import hull_gaps
from husky_highlevel_controller.course import REACHED, STANDS, TOUCH
from husky_highlevel_controller.datatypes import TrueState
from husky_highlevel_controller.geometry import pose_to_2d, wrap_angle

# a run ends as soon as one of the following conditions has held for its simulated time
AT_PILLAR = 3.0  # [s] the robot has been at the pillar for this time
ABANDONED = 3.0  # [s] no node of the submission runs any more, and the robot has stood for this time
STILL = 15.0  # [s] the robot has moved, and then has stood for this time
# [s] the robot has not moved for this time since the start; some controllers first sleep for 10 s
NEVER = 12.0
# a run also ends if the robot leaves the pillar and will not come back: the conditions of PAST and LEAVING
# are both true
PAST = 10.0  # [m] the gap between robot and pillar is larger by this than the smallest gap so far
LEAVING = 5.0  # [s] the robot has driven away from the pillar in a straight line for this simulated time
# [rad] A robot whose heading changes by more than this has left the straight line. A robot that turns more
# slowly, so less than this in LEAVING, would need 80 s for half a turn, so it does not come back in time.
STRAIGHT = 0.2
NODES_ENDED = Note(Kind.NODES_ENDED, f"its nodes had ended, and it stood still for {ABANDONED:g} s")
NO_COMMAND = Note(Kind.NODES_ENDED, "its nodes had ended without a command")


class DriveEnd:
    """Follows one run of exercise 3 by its true states, and decides when it is over."""

    def __init__(self, pillar: Tuple[float, float], robot: str) -> None:
        self._pillar = pillar  # x and y of the pillar in the world [m]
        self._robot = robot  # name of the robot, one of ROBOTS
        self._now = 0.0  # [s] simulated time of the latest state
        self._drove_at = 0.0  # [s] time of the last state in which the robot drove
        self._moved_at = 0.0  # [s] time of the last state in which the robot drove or turned on the spot
        # [s] time of the first state in which the robot drove or turned; inf if there is none
        self._first_moved = inf
        self._reached_at = inf  # [s] time of the arrival at the pillar; inf if the robot is not there
        self._touched_at = inf  # [s] time of the first touch of the pillar; inf if there is none
        # [m] gap between the robot's footprint and the pillar: now, and the smallest gap so far
        self._gap, self._nearest = 0.0, inf
        # [s] time at which the robot began to drive straight away from the pillar; set again to the present
        # time whenever the robot turns or comes nearer
        self._leaving_since = 0.0
        self._heading = 0.0  # [rad] heading in the world at the time `_leaving_since`

    def update(self, state: TrueState) -> None:
        """Take the robot's next true state, and keep the times and gaps from which `reason` decides."""
        self._now = now = state.stamp
        if abs(state.speed) > STANDS:
            self._drove_at = now
        if abs(state.speed) > STANDS or abs(state.yaw_rate) > STANDS:
            self._moved_at = now
            self._first_moved = min(self._first_moved, now)  # `min` keeps the first time
        pose = pose_to_2d(state.pose_in_world)
        # [m] gap between the robot's footprint and the pillar
        gap = float(hull_gaps(np.array([pose]), self._pillar, self._robot)[0])
        # a robot that comes nearer or turns does not leave, so a straight path away can begin only now
        comes_nearer = gap <= self._gap
        has_turned = abs(wrap_angle(pose.yaw - self._heading)) > STRAIGHT
        if comes_nearer or has_turned:
            self._heading, self._leaving_since = pose.yaw, now
        self._gap, self._nearest = gap, min(self._nearest, gap)
        # the time of arrival is forgotten if the robot leaves the pillar again; the time of a touch is kept
        if gap <= REACHED:
            self._reached_at = min(self._reached_at, now)
        else:
            self._reached_at = inf
        if gap <= TOUCH:
            self._touched_at = min(self._touched_at, now)

    def reason(self, abandoned: bool = False) -> Optional[Note]:
        """Return why the run is over, or None if it goes on.

        `abandoned` is true if no node of the submission runs any more.
        """
        still = self._now - self._moved_at  # [s] time for which the robot has been at rest
        # never true without a touch, because `_touched_at` is inf then
        if self._now >= self._touched_at + AT_PILLAR:
            return Note(Kind.TOUCHES, "it reached the pillar and touched it")
        # the robot may turn on the spot at the pillar, but it must not drive
        has_not_driven = self._now - self._drove_at >= AT_PILLAR
        is_at_pillar = self._now - self._reached_at >= AT_PILLAR
        if has_not_driven and is_at_pillar and self._first_moved < inf:
            return Note(Kind.AT_PILLAR, "it stands at the pillar")
        if abandoned and still >= ABANDONED:
            return NODES_ENDED
        if self._first_moved == inf and self._now >= NEVER:
            return Note(Kind.NEVER_MOVED, f"it did not move for {NEVER:g} s")
        # the robot leaves the pillar, and will not come back before the deadline
        is_far_past = self._gap > self._nearest + PAST
        has_driven_away = self._now >= self._leaving_since + LEAVING
        if is_far_past and has_driven_away:
            far, near = f"{self._gap:.0f} m", f"{self._nearest:.0f} m"
            return Note(Kind.LEAVES, f"it was {far} from the pillar, {near} at its nearest, and drove on")
        if self._first_moved < inf and still >= STILL:
            return Note(Kind.STOOD_STILL, f"it stood still for {STILL:g} s")
        return None
