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

# a run ends when one of the following simulated times is over
AT_PILLAR = 3.0  # [s] time at the pillar
ABANDONED = 3.0  # [s] time at rest after the last node of the submission has ended
STILL = 15.0  # [s] time at rest after the robot has moved
NEVER = 12.0  # [s] time at rest from the start; some controllers sleep for 10 s first
# A robot counts as leaving for good if two conditions hold. Its distance from the pillar is larger than its
# smallest distance so far by the number PAST [m]. For the simulated time LEAVING [s] it has driven away from
# the pillar in a straight line, so its heading has changed by less than STRAIGHT [rad]. At this rate, the
# robot would need 80 s to turn round.
PAST, LEAVING, STRAIGHT = 10.0, 5.0, 0.2
NODES_ENDED = Note(Kind.NODES_ENDED, f"its nodes had ended, and it stood still for {ABANDONED:g} s")
NO_COMMAND = Note(Kind.NODES_ENDED, "its nodes had ended without a command")


class DriveEnd:
    """Follows one run of exercise 3, and decides when it is over."""

    def __init__(self, pillar: Tuple[float, float], robot: str) -> None:
        # [m] position of the pillar in the world; name of the robot, one of ROBOTS
        self._pillar, self._robot = pillar, robot
        # [s] time of the last state, time at which the robot last drove, time at which it last moved
        self._now = self._drove_at = self._moved_at = 0.0
        # [s] time at which the robot first moved, reached the pillar, touched the pillar; inf if never
        self._first_moved = self._reached_at = self._touched_at = inf
        # [m] gap between footprint and pillar: present gap, and smallest gap of the run
        self._gap, self._nearest = 0.0, inf
        # heading [rad] in the world in which the robot drives away from the pillar; time [s] since when it
        # drives away
        self._heading, self._left_at = (
            0.0,
            0.0,
        )

    def update(self, state: TrueState) -> None:
        """Follow the next true state."""
        self._now = now = state.stamp
        if abs(state.speed) > STANDS:
            self._drove_at = now
        if abs(state.speed) > STANDS or abs(state.yaw_rate) > STANDS:
            self._moved_at, self._first_moved = now, min(self._first_moved, now)
        pose = pose_to_2d(state.pose_in_world)
        # [m] gap between footprint and pillar
        gap = float(hull_gaps(np.array([pose]), self._pillar, self._robot)[0])
        # the robot comes nearer or turns, so it does not drive away in a straight line
        if gap <= self._gap or abs(wrap_angle(pose.yaw - self._heading)) > STRAIGHT:
            self._heading, self._left_at = pose.yaw, now
        self._gap, self._nearest = gap, min(self._nearest, gap)
        # a robot that leaves the pillar has not reached it any more, but a touch counts for the whole run
        self._reached_at = min(self._reached_at, now) if gap <= REACHED else inf
        if gap <= TOUCH:
            self._touched_at = min(self._touched_at, now)

    def reason(self, abandoned: bool = False) -> Optional[Note]:
        """Return why the run is over, or None if it goes on; `abandoned` if none of its nodes runs."""
        still = self._now - self._moved_at  # [s] time at rest
        if self._now >= self._touched_at + AT_PILLAR:
            return Note(Kind.TOUCHES, "it reached the pillar and touched it")
        # the robot has been near enough, and has not driven, for AT_PILLAR seconds; it may turn there
        at_pillar = min(self._now - self._drove_at, self._now - self._reached_at) >= AT_PILLAR
        if at_pillar and self._first_moved < inf:
            return Note(Kind.AT_PILLAR, "it stands at the pillar")
        if abandoned and still >= ABANDONED:
            return NODES_ENDED
        if self._first_moved == inf and self._now >= NEVER:
            return Note(Kind.NEVER_MOVED, f"it did not move for {NEVER:g} s")
        if self._gap > self._nearest + PAST and self._now >= self._left_at + LEAVING:
            far, near = f"{self._gap:.0f} m", f"{self._nearest:.0f} m"
            return Note(Kind.LEAVES, f"it was {far} from the pillar, {near} at its nearest, and drove on")
        if self._first_moved < inf and still >= STILL:
            return Note(Kind.STOOD_STILL, f"it stood still for {STILL:g} s")
        return None
