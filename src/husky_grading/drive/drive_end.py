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
# A run also ends if the robot leaves the pillar for good. The robot is then PAST [m] farther from the pillar
# than at its nearest point, and for LEAVING [s] it has driven away in a straight line, so its heading has
# changed by less than STRAIGHT [rad]. A robot that turns so slowly would need 80 s to turn round.
PAST, LEAVING, STRAIGHT = 10.0, 5.0, 0.2
NODES_ENDED = Note(Kind.NODES_ENDED, f"its nodes had ended, and it stood still for {ABANDONED:g} s")
NO_COMMAND = Note(Kind.NODES_ENDED, "its nodes had ended without a command")


class DriveEnd:
    """Follows one run of exercise 3 by its true states, and decides when it is over."""

    def __init__(self, pillar: Tuple[float, float], robot: str) -> None:
        self._pillar = pillar  # x and y of the pillar in the world [m]
        self._robot = robot  # name of the robot, one of ROBOTS
        # [s] simulated times of these states
        self._now = 0.0  # latest state
        self._drove_at = 0.0  # last state in which the robot drove
        self._moved_at = 0.0  # last state in which the robot drove or turned on the spot
        self._first_moved = inf  # first state in which the robot drove or turned; inf if there is none
        self._reached_at = inf  # arrival at the pillar; inf if the robot is not there
        self._touched_at = inf  # first touch of the pillar; inf if there is none
        # [m] gap between the robot's footprint and the pillar: now, and the smallest gap so far
        self._gap, self._nearest = 0.0, inf
        # straight path away from the pillar: heading in the world [rad] and simulated time [s] at its begin
        self._heading = 0.0
        self._leaving_since = 0.0

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
        if gap <= self._gap or abs(wrap_angle(pose.yaw - self._heading)) > STRAIGHT:
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
        has_passed = self._gap > self._nearest + PAST
        drives_away = self._now >= self._leaving_since + LEAVING
        if has_passed and drives_away:
            far, near = f"{self._gap:.0f} m", f"{self._nearest:.0f} m"
            return Note(Kind.LEAVES, f"it was {far} from the pillar, {near} at its nearest, and drove on")
        if self._first_moved < inf and still >= STILL:
            return Note(Kind.STOOD_STILL, f"it stood still for {STILL:g} s")
        return None
