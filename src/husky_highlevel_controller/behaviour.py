"""Decides, scan by scan, what the robot does about the pillar.

In: all that is known at one scan, and a memory. Out: the next memory, and a decision with its reason.
Must not know: ROS, PyBullet, clocks: time is the scan's stamp.

It follows the pillar it sees (tracking.py), drives to it (control.py), and looks for it when it is nowhere to
be seen (searching.py).
"""

from __future__ import annotations

from enum import Enum
from math import inf, nan
from typing import List, NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.control import (
    ControlConfig,
    Target,
    heading_twist,
    steer,
    target_at,
    to_be_touched,
    to_go,
)
from husky_highlevel_controller.datatypes import STOP, Pillar, Pose, Pose2D, Scan, Twist2D
from husky_highlevel_controller.geometry import compose, inverse, pose_from_2d, transform_point
from husky_highlevel_controller.pillar import PillarConfig, find_pillars
from husky_highlevel_controller.searching import (
    LOOK_AHEAD,
    SEARCH_SPEED,
    Search,
    free_bearing,
    near_points,
    search_on,
)
from husky_highlevel_controller.tracking import Estimate, Sight, Track, aged, follow

RESUME_ERROR = 0.10  # [m], further than this from where it should stand an arrived robot drives again
CLOSE = 0.003  # [m], a gap that noise may make of a touch; from here on it creeps for PRESSING
PRESSING = 0.2  # [s], at control.TOUCH_LEAST_SPEED: 8 mm, so that it does touch, and hardly pushes


class Phase(Enum):
    """What the robot is doing."""

    WAITING = "waiting"  # it cannot judge, or must not search
    SEARCHING = "searching"
    DRIVING = "driving"
    ARRIVED = "arrived"
    STOPPED = "stopped"  # told to stand still


class View(NamedTuple):
    """All that is known at one scan."""

    scan: Scan
    laser_in_base: Optional[Pose]  # None where TF does not know
    base_in_odom: Optional[Pose2D]  # at the scan's stamp; None where TF does not know


class Memory(NamedTuple):
    """Whatever is needed from scan to scan."""

    phase: Phase = Phase.WAITING
    track: Track = Track()
    search: Optional[Search] = None  # while searching
    at_pillar: bool = False  # it has arrived, and not left since
    close_at: Optional[float] = None  # [s], since when it has been close to what it is going to touch
    started_at: Optional[float] = None  # [s], stamp of the first scan, or the first after a stop
    updated_at: float = -inf  # [s], stamp of the last scan

    @property
    def estimate(self) -> Optional[Estimate]:
        """The pillar, as far as it is remembered."""
        return self.track.estimate


class Decision(NamedTuple):
    """What to do now, and why."""

    phase: Phase
    at_pillar: bool  # it has arrived, and not left since: also while it is told to stand still there
    twist: Twist2D
    pillar: Optional[Pillar]  # that is followed and seen in this scan, in the laser's frame
    estimate: Optional[Estimate]  # what is remembered, in odom
    target_in_base: Optional[Tuple[float, float]]  # [m], the pillar's centre, seen or else remembered
    distance_error: float  # [m], still to go; nan without a target
    bearing_error: float  # [rad], of the target in base_link; nan without one
    reason: str  # a sentence for the log; the same one as long as the situation is the same


def decide(
    memory: Memory, view: View, enabled: bool, control: ControlConfig, looks: PillarConfig
) -> Tuple[Memory, Decision]:
    """Decide on one scan.

    Args:
        memory: what the last call returned, Memory() at first.
        view: the scan, and where its lidar was.
        enabled: whether the robot may move; perception goes on without it.
        control: gains and limits.
        looks: what counts as a pillar.

    Returns:
        The memory for the next call, and the decision. A scan older than the last one means that the
        simulator was started again, so that odom is another: everything is forgotten.
    """
    stamp = view.scan.stamp
    if stamp < memory.updated_at:
        memory = Memory()
    track, pillar, sight = _look(memory, view, find_pillars(view.scan, looks))
    target = _target(track.estimate, view, pillar)
    memory = memory._replace(
        track=track,
        close_at=_close_at(memory, target, stamp, control),
        started_at=stamp if enabled and memory.started_at is None else memory.started_at,
        updated_at=stamp,
    )
    phase, twist, reason, search = _act(memory, view, target, pillar is not None, sight, enabled, control)
    left = to_go(target, control) if target else nan
    memory = memory._replace(
        phase=phase,
        at_pillar=phase is Phase.ARRIVED or (memory.at_pillar and left <= RESUME_ERROR),
        search=search,
        started_at=memory.started_at if enabled else None,
    )
    decision = Decision(
        phase,
        memory.at_pillar,
        twist,
        pillar,
        aged(memory.estimate, stamp) if memory.estimate else None,
        (target.x, target.y) if target else None,
        left,
        target.bearing if target else nan,
        reason,
    )
    return memory, decision


def _look(memory: Memory, view: View, pillars: List[Pillar]) -> Tuple[Track, Optional[Pillar], Sight]:
    """Follow the pillar; without a place in odom, whichever is nearest in this scan."""
    if view.laser_in_base is None or view.base_in_odom is None:
        return memory.track, (pillars[0] if pillars else None), Sight.UNKNOWN
    laser_in_odom = compose(pose_from_2d(view.base_in_odom), view.laser_in_base)
    patient = memory.phase is Phase.ARRIVED
    return follow(memory.track, pillars, view.scan, laser_in_odom, patient)


def _target(estimate: Optional[Estimate], view: View, pillar: Optional[Pillar]) -> Optional[Target]:
    """The pillar as it is seen, or else as it is remembered."""
    if view.laser_in_base is None:
        return None
    if pillar is not None:
        x, y, _ = transform_point(view.laser_in_base, (pillar.x, pillar.y, 0.0))
        return target_at((x, y), pillar.radius, view.laser_in_base)
    if estimate is None or view.base_in_odom is None:
        return None
    place_in_odom = (estimate.x, estimate.y, 0.0)
    x, y, _ = transform_point(inverse(pose_from_2d(view.base_in_odom)), place_in_odom)
    return target_at((x, y), estimate.radius, view.laser_in_base)


def _close_at(
    memory: Memory, target: Optional[Target], stamp: float, control: ControlConfig
) -> Optional[float]:
    """Since when the robot has been close to a pillar that it is going to touch [s]; None if it is not."""
    if target is None or not to_be_touched(target, control):
        return None
    near = RESUME_ERROR if memory.close_at is not None else CLOSE
    return (stamp if memory.close_at is None else memory.close_at) if target.gap <= near else None


_Act = Tuple[Phase, Twist2D, str, Optional[Search]]


def _act(
    memory: Memory,
    view: View,
    target: Optional[Target],
    pillar_seen: bool,
    sight: Sight,
    enabled: bool,
    control: ControlConfig,
) -> _Act:
    """What to do, given what is known of the pillar."""
    if not enabled:
        return Phase.STOPPED, STOP, "told to stand still", None
    if view.laser_in_base is None:
        missing = f"no transform from '{view.scan.frame}' to base_link"
        return Phase.WAITING, STOP, f"{missing}: standing still; is robot_state_publisher running?", None
    measured = pillar_seen or view.scan.valid.any()
    if not measured and not (view.scan.ranges == inf).any():  # no beam, or NaN or too close for all
        reason = "no pillar in the scan (it has no valid range): standing still; is the lidar covered?"
        return Phase.WAITING, STOP, reason, None
    points = near_points(view.scan, view.laser_in_base, target if pillar_seen else None)
    if target is not None and (pillar_seen or control.search):
        return (*_drive(memory, target, pillar_seen, sight, points, control), None)
    nothing = "none of its returns looks like one" if measured else "it has no valid range"
    nothing = f"no pillar in the scan ({nothing})"
    if not control.search:
        return Phase.WAITING, STOP, f"{nothing}: standing still; set ~search to true, or turn the robot", None
    if view.base_in_odom is None:
        reason = f"{nothing}, and no transform to odom to search by: standing still; is odometry running?"
        return Phase.WAITING, STOP, reason, None
    search, twist = search_on(memory.search or Search(), view.base_in_odom, points, control)
    how = "turning to look around" if search.to_turn > 0.0 else "driving a widening search"
    return Phase.SEARCHING, twist, f"{nothing}: {how}", search


def _drive(
    memory: Memory,
    target: Target,
    seen: bool,
    sight: Sight,
    points_in_base: np.ndarray,
    control: ControlConfig,
) -> Tuple[Phase, Twist2D, str]:
    """Drive to the pillar, round what is in the way, and stop there."""
    left, arrived = to_go(target, control), memory.phase is Phase.ARRIVED
    if to_be_touched(target, control):
        near_enough, where = CLOSE, "touching the pillar"
        there = memory.close_at is not None and memory.updated_at - memory.close_at > PRESSING
    else:
        near_enough, where = control.arrival_tolerance, "at the stop distance"
        there = left <= near_enough
    if (seen and there) or (arrived and left <= RESUME_ERROR):
        return Phase.ARRIVED, STOP, f"arrived: {where}"
    if not seen and left <= near_enough:
        return Phase.DRIVING, heading_twist(target.bearing, 0.0, control), "looking where the pillar was"
    why = "driving to the pillar" if seen else f"the pillar is {sight.value}: driving to where it was"
    bearing = free_bearing(points_in_base, target.bearing, min(LOOK_AHEAD, left))
    if bearing is None:
        return Phase.DRIVING, Twist2D(0.0, control.search_rate), "no free way ahead: turning to find one"
    if bearing != target.bearing:
        twist = heading_twist(bearing, min(SEARCH_SPEED, control.max_linear), control)
        return Phase.DRIVING, twist, "something is in the way: driving round it"
    return Phase.DRIVING, steer(target, control), why
