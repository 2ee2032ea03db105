"""State machine of the pillar controller: one scan in, one velocity command and its reason out.

In: an `Observation`, a `ControllerState`. Out: the next `ControllerState`, a `ControlOutput`.

It follows the visible pillar (tracking.py), drives to it (control.py), and searches for it if it is out of
sight (search.py).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from math import hypot, inf, nan
from typing import List, NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.controller.control import (
    ControlConfig,
    Target,
    heading_twist,
    limited,
    remaining_distance,
    steer,
    target_at,
    to_be_touched,
)
from husky_highlevel_controller.controller.pillar_detection import Pillar, PillarConfig, find_pillars
from husky_highlevel_controller.controller.search import (
    LOOK_AHEAD,
    SEARCH_SPEED,
    Search,
    free_bearing,
    near_points,
    search_on,
)
from husky_highlevel_controller.controller.sensor_faults import MAX_OFFSET, frame_sentence
from husky_highlevel_controller.controller.tracking import Estimate, Track, Visibility, aged, follow
from husky_highlevel_controller.datatypes import STOP, Pose, Pose2D, Scan, Twist2D, Vector3
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.geometry import compose, inverse, pose_from_2d, transform_point
from husky_highlevel_controller.robot import load_robot

# [m], [m/s] a robot that moves farther than TELEPORT_DISTANCE + TOP_SPEED * time between two scans has not
# driven there, so somebody has put it elsewhere, or odom was reset
TELEPORT_DISTANCE, TOP_SPEED = 0.3, 2.0
# [m] A robot that has arrived drives on only if the distance that it still has to drive is larger than this.
# A smaller distance may be an error of the measurement.
RESUME_DISTANCE = 0.10
ODOM_TIMEOUT = 0.5  # [s] odometry counts as lost if the last known pose in odom is older than this
ROOM_FRACTION = 0.05  # walls stand around the robot if more than this fraction of the beams has a return
# [m] If the measured gap to the pillar is at most this, the robot may already touch the pillar. But the
# measured gap has an error, so the robot creeps forwards for TOUCH_CREEP_TIME more.
TOUCH_GAP = 0.003
# [s] the robot creeps 8 mm in this time at control.MIN_TOUCH_SPEED, so that it touches the pillar but hardly
# pushes it
TOUCH_CREEP_TIME = 0.2


class State(Enum):
    """State of the controller."""

    WAITING = "waiting"  # the robot stands, because information is missing or the search is disabled
    SEARCHING = "searching"
    DRIVING = "driving"
    ARRIVED = "arrived"
    STOPPED = "stopped"  # the service `start_stop` has stopped the controller


@dataclass(frozen=True, eq=False)
class Observation:
    """Scan, and the poses of its stamp."""

    scan: Scan
    laser_in_base: Optional[Pose]  # pose of the lidar in base_link; None if unknown to TF
    base_in_odom: Optional[Pose2D]  # pose of base_link in odom at the scan's stamp; None if unknown to TF
    outline: Footprint = field(default_factory=lambda: load_robot().footprint)  # footprint of the robot
    ahead_of_odometry: float = 0.0  # [s] time by which the scan's clock is ahead of odometry's clock

    @cached_property
    def laser_in_odom(self) -> Optional[Pose]:
        """Pose of the lidar at the scan's stamp; None if it is unknown to TF."""
        if self.laser_in_base is None or self.base_in_odom is None:
            return None
        return compose(pose_from_2d(self.base_in_odom), self.laser_in_base)


class ControllerState(NamedTuple):
    """Memory of the controller from scan to scan."""

    state: State = State.WAITING
    track: Track = Track()
    search: Optional[Search] = None  # progress of the search; None if the robot does not search
    at_pillar: bool = False  # true if the robot has arrived at the pillar and has not left it since
    # [s] time at which the robot came close enough to a pillar to touch it (TOUCH_GAP); None if it is not
    # close
    close_at: Optional[float] = None
    # [s] stamp of the scan at which this drive to the pillar began; None if the controller is stopped
    started_at: Optional[float] = None
    base_in_odom: Optional[Pose2D] = None  # pose of base_link in odom at the last scan; None if unknown to TF
    updated_at: float = -inf  # [s], stamp of the last scan
    # [s] Stamp of the last scan for which TF knew the robot's pose in odom. It is inf until TF knows a pose,
    # because odometry that has not come yet does not count as lost (see ODOM_TIMEOUT).
    odom_at: float = inf
    # true if an earlier scan showed walls around the robot; then a scan without any return shows that the
    # lidar is covered or broken
    in_room: bool = False

    @property
    def estimate(self) -> Optional[Estimate]:
        """Remembered pillar, or None."""
        return self.track.estimate


class ControlOutput(NamedTuple):
    """Velocity command of one scan, with its reason and its basis."""

    state: State
    # true from the arrival until the robot leaves the pillar, also while the controller is stopped
    at_pillar: bool
    twist: Twist2D
    # tracked pillar in the laser's frame; None if this scan does not show the pillar
    pillar: Optional[Pillar]
    pillar_in_odom: Optional[Vector3]  # [m] centre of `pillar`; None without a transform to odom
    estimate: Optional[Estimate]  # remembered pillar in odom; None if no pillar is remembered
    # [m] (x, y) of the pillar's centre in base_link; if this scan does not show the pillar, its remembered
    # position counts; None if no position is known
    target_in_base: Optional[Tuple[float, float]]
    distance_error: float  # [m] distance that the robot still has to drive; nan if no pillar is known
    bearing_error: float  # [rad] direction of the pillar in base_link; nan if no pillar is known
    reason: str  # reason of the state, as a sentence for the log
    moved: bool = False  # true if the robot was put elsewhere since the last scan, or odom was reset


def decide(
    controller_state: ControllerState,
    observation: Observation,
    enabled: bool,
    control: ControlConfig,
    detector_config: PillarConfig,
) -> Tuple[ControllerState, ControlOutput]:
    """Choose the velocity command that answers one scan, and update the memory of the controller.

    Args:
        controller_state: state from the previous call, ControllerState() at first.
        observation: the scan, and the poses at its stamp.
        enabled: whether the robot may move; perception continues if not.
        control: gains and limits.
        detector_config: parameters of the pillar detection.

    Returns:
        The state for the next call, and the output.
    """
    # a scan older than the last scan means that the simulator was started again; odom is then another frame,
    # so all remembered positions are wrong
    stamp = observation.scan.stamp
    was_restarted = stamp < controller_state.updated_at
    if was_restarted:
        controller_state = ControllerState()
    moved = was_restarted or _moved(controller_state, observation)
    if moved:
        controller_state = _put_elsewhere(controller_state)

    # perception
    look = _look(controller_state, observation, find_pillars(observation.scan, detector_config))
    estimate = look.track.estimate
    target = _target(estimate, observation, look.pillar)
    controller_state = _with_perception(controller_state, observation, look.track, target, control)

    # decision
    action = _act(controller_state, observation, target, look, enabled, control)

    # memory for the next scan
    remaining = remaining_distance(target, control) if target else nan
    # A robot that was at the pillar is still there while it is near, also if its service has stopped it. If
    # no pillar is known, `remaining` is nan, and the comparison is false.
    is_still_at_pillar = controller_state.at_pillar and remaining <= RESUME_DISTANCE
    at_pillar = action.state is State.ARRIVED or is_still_at_pillar
    controller_state = controller_state._replace(
        state=action.state,
        at_pillar=at_pillar,
        search=action.search,
        started_at=_started_at(controller_state, stamp, enabled, at_pillar),
    )
    output = ControlOutput(
        state=action.state,
        at_pillar=at_pillar,
        twist=limited(action.twist, control),
        pillar=look.pillar,
        pillar_in_odom=look.pillar_in_odom,
        estimate=aged(estimate, stamp) if estimate else None,
        target_in_base=(target.x, target.y) if target else None,
        distance_error=remaining,
        bearing_error=target.bearing if target else nan,
        reason=action.reason,
        moved=moved,
    )
    return controller_state, output


def _moved(controller_state: ControllerState, observation: Observation) -> bool:
    """Return whether the robot was put elsewhere since the last scan, or odom was reset.

    The robot is then farther from its last position in odom than it can have driven.
    """
    before, now = controller_state.base_in_odom, observation.base_in_odom
    if before is None or now is None:
        return False
    elapsed = observation.scan.stamp - controller_state.updated_at
    return hypot(now.x - before.x, now.y - before.y) > TELEPORT_DISTANCE + TOP_SPEED * elapsed


def _put_elsewhere(controller_state: ControllerState) -> ControllerState:
    """Return the state of a robot that was put elsewhere, or whose odom was reset.

    A pillar is accepted again also at the positions that were rejected, and at the position to which the last
    object walked. The robot is not at the pillar, and begins a new drive. Walls of earlier scans no longer
    count (`in_room`). The remembered pillar stays, because the next scans show whether its position is empty.
    """
    track = controller_state.track._replace(rejected=(), walked_to=None)
    return controller_state._replace(track=track, started_at=None, at_pillar=False, in_room=False)


class _Look(NamedTuple):
    """Sight of the tracked pillar in one scan."""

    track: Track
    pillar: Optional[Pillar]  # pillar in the laser's frame; None if the scan does not show it
    pillar_in_odom: Optional[Vector3]  # [m] centre of `pillar`; None without a transform to odom
    # state of the pillar's remembered position in this scan, such as seen, hidden or empty
    visibility: Visibility


def _look(controller_state: ControllerState, observation: Observation, pillars: List[Pillar]) -> _Look:
    """Choose the pillar to drive to among the pillars of a scan, and remember its position in odom.

    It is the pillar that the last scans showed, at its remembered position. If the robot's pose in odom is
    unknown, positions cannot be compared, so the nearest pillar is chosen. `pillars` are sorted by distance.
    """
    laser_in_odom = observation.laser_in_odom
    if laser_in_odom is None:
        nearest = pillars[0] if pillars else None
        return _Look(controller_state.track, nearest, pillar_in_odom=None, visibility=Visibility.UNKNOWN)
    # an arrived robot does not give up a near pillar that is hidden, so that the robot stays when somebody
    # stands in front of the pillar
    keep_hidden = controller_state.state is State.ARRIVED
    track, sighting, visibility = follow(
        controller_state.track, pillars, observation.scan, laser_in_odom, keep_hidden
    )
    if sighting is None:
        return _Look(track, pillar=None, pillar_in_odom=None, visibility=visibility)
    return _Look(track, sighting.pillar, sighting.center_in_odom, visibility)


def _target(
    estimate: Optional[Estimate], observation: Observation, pillar: Optional[Pillar]
) -> Optional[Target]:
    """Return the pillar in base_link, to which the robot shall drive; None if its position is unknown.

    Args:
        estimate: remembered pillar in odom, which counts only if this scan does not show the pillar.
        observation: the poses at the stamp of the scan.
        pillar: pillar that this scan shows, in the laser's frame; None if the scan does not show it.
    """
    if observation.laser_in_base is None:
        return None
    if pillar is not None:
        x, y, _ = transform_point(observation.laser_in_base, (pillar.x, pillar.y, 0.0))
        return target_at((x, y), pillar.radius, observation.laser_in_base, observation.outline)
    if estimate is None or observation.base_in_odom is None:
        return None
    place_in_odom = (estimate.x, estimate.y, 0.0)
    x, y, _ = transform_point(inverse(pose_from_2d(observation.base_in_odom)), place_in_odom)
    return target_at((x, y), estimate.radius, observation.laser_in_base, observation.outline)


def _with_perception(
    controller_state: ControllerState,
    observation: Observation,
    track: Track,
    target: Optional[Target],
    control: ControlConfig,
) -> ControllerState:
    """Return the state with all that this scan shows; the command is chosen afterwards.

    Args:
        controller_state: state after the last scan.
        observation: the scan, and the poses at its stamp.
        track: track after this scan.
        target: pillar in base_link; None if its position is unknown.
        control: gains and limits.
    """
    scan, base_in_odom = observation.scan, observation.base_in_odom
    return controller_state._replace(
        track=track,
        close_at=_close_at(controller_state, target, scan.stamp, control),
        base_in_odom=base_in_odom,
        updated_at=scan.stamp,
        odom_at=controller_state.odom_at if base_in_odom is None else scan.stamp,
        in_room=controller_state.in_room or scan.valid_count > ROOM_FRACTION * len(scan.ranges),
    )


def _close_at(
    controller_state: ControllerState, target: Optional[Target], stamp: float, control: ControlConfig
) -> Optional[float]:
    """Return when the robot came close to a pillar that it shall touch [s]; None if it is not close.

    From this time on the robot creeps forwards for TOUCH_CREEP_TIME, to be sure that it touches the pillar.
    `stamp` is the stamp of this scan [s].
    """
    if target is None or not to_be_touched(target, control):
        return None
    if controller_state.close_at is None:  # the robot was not close at the last scan
        return stamp if target.gap <= TOUCH_GAP else None
    # The robot was close at the last scan. The measured gap has an error, so a gap just above TOUCH_GAP does
    # not show that the robot is no longer close. Only a gap above RESUME_DISTANCE shows this.
    return controller_state.close_at if target.gap <= RESUME_DISTANCE else None


def _started_at(
    controller_state: ControllerState, stamp: float, enabled: bool, at_pillar: bool
) -> Optional[float]:
    """Return when the present drive to the pillar began [s]; None if the controller is stopped.

    A drive begins when the controller is started, and when an arrived robot leaves the pillar.

    Args:
        controller_state: state with `at_pillar` and `started_at` of the last scan.
        stamp: stamp of this scan [s].
        enabled: whether the robot may move.
        at_pillar: whether the robot is at the pillar now.
    """
    if not enabled:
        return None
    has_left_pillar = controller_state.at_pillar and not at_pillar
    if controller_state.started_at is None or has_left_pillar:
        return stamp
    return controller_state.started_at


class _Action(NamedTuple):
    """Answer to one scan."""

    state: State
    twist: Twist2D  # command before it is limited to the largest allowed speeds
    reason: str
    search: Optional[Search] = None  # search to continue at the next scan; None if the robot does not search


def _act(
    controller_state: ControllerState,
    observation: Observation,
    target: Optional[Target],
    look: _Look,
    enabled: bool,
    control: ControlConfig,
) -> _Action:
    """Choose the state, the command, its reason, and the search to continue, if any.

    A robot that may move drives to the pillar if it knows where the pillar is. Otherwise it searches for a
    pillar, if the configuration allows the search.

    Args:
        controller_state: state with the track of this scan, and with the action of the last scan.
        observation: the scan, and the poses at its stamp.
        target: pillar in base_link, seen or remembered; None if its position is unknown.
        look: sight of the pillar in this scan.
        enabled: whether the robot may move.
        control: gains and limits.
    """
    if not enabled:
        return _Action(State.STOPPED, STOP, "stopped by its start/stop service")
    if observation.laser_in_base is None:
        return _wait(frame_sentence(observation.scan.frame))
    pillar_seen = look.pillar is not None
    has_return = pillar_seen or observation.scan.valid_count > 0
    forced_wait = _forced_wait(controller_state, observation, target, has_return)
    if forced_wait is not None:
        return forced_wait

    # returns of the pillar are not obstacles if this scan shows the pillar; if the pillar is only remembered,
    # all near returns are obstacles
    obstacles_in_base = near_points(
        observation.scan, observation.laser_in_base, target if pillar_seen else None, observation.outline
    )
    # if the pillar is only remembered, the robot drives to it only if the parameter `search` is true
    if target is not None and (pillar_seen or control.search):
        return _drive(
            controller_state,
            target,
            look,
            obstacles_in_base,
            observation.outline,
            control,
        )
    return _search(controller_state, observation, obstacles_in_base, has_return, control)


def _forced_wait(
    controller_state: ControllerState, observation: Observation, target: Optional[Target], has_return: bool
) -> Optional[_Action]:
    """Return the action of a robot that must not move now, with the reason; None if the robot may move.

    The clocks may differ, odometry may have stopped, the lidar may be covered, or the pillar may be a person.

    Args:
        controller_state: state with the track and `odom_at` of this scan.
        observation: the scan, and the offset of its clock.
        target: pillar in base_link, seen or remembered; None if its position is unknown.
        has_return: whether any beam of the scan has a return.
    """
    if observation.ahead_of_odometry > MAX_OFFSET:
        reason = "standing still until the clocks are set: scans are stamped too far ahead of odometry"
        return _Action(State.WAITING, STOP, reason)
    if observation.scan.stamp - controller_state.odom_at > ODOM_TIMEOUT:
        return _wait("no transform from odom to base_link any more; check that odometry is running")
    # A beam that meets nothing gives inf, so in an empty world all beams give inf, and the robot may move. If
    # no beam has a return and no beam gives inf, the lidar is covered, or the scan has no beams.
    if not has_return and not (observation.scan.returns == inf).any():
        return _wait("no pillar in the scan (it has no valid range); check that the lidar is uncovered")
    # The last tracked object has walked, so it was a person and not a pillar. The object that is tracked now
    # is not confirmed yet, so it may be the same person.
    if controller_state.track.doubtful and target is not None:
        return _wait("the pillar moves away; waiting until it stands")
    return None


def _wait(problem: str, search: Optional[Search] = None) -> _Action:
    """Return the action of a robot that stands still because of a problem."""
    return _Action(State.WAITING, STOP, f"standing still: {problem}", search)


def _search(
    controller_state: ControllerState,
    observation: Observation,
    obstacles_in_base: np.ndarray,
    has_return: bool,
    control: ControlConfig,
) -> _Action:
    """Choose the action of a robot that does not know where the pillar is: search for it, or stand still.

    Args:
        controller_state: state with the search of the last scan.
        observation: the scan, and the poses at its stamp.
        obstacles_in_base: obstacles near the robot, (N, 2) [m].
        has_return: whether any beam of the scan has a return.
        control: whether the robot may search, and how fast.
    """
    cause = "none of its returns looks like one" if has_return else "it has no valid range"
    no_pillar = f"no pillar in the scan ({cause})"
    if not control.search:
        return _wait(f"{no_pillar}; set ~search to true, or turn the robot")
    if observation.base_in_odom is None:
        return _wait(f"{no_pillar}, and no transform to odom; check that odometry is running")
    search, twist = search_on(
        controller_state.search or Search(),
        observation.base_in_odom,
        obstacles_in_base,
        observation.outline,
        control,
    )
    # The robot has turned once around before the search drives. An earlier scan showed walls around the robot
    # (`in_room`), but this scan has no return at all, so the lidar is covered or broken. The robot must not
    # drive with such a lidar. The search keeps the state of the last scan, and continues from there later.
    if twist.linear > 0.0 and not has_return and controller_state.in_room:
        problem = "no beam returns anything, although many did before; check that the lidar is uncovered"
        return _wait(problem, controller_state.search)
    motion = "turning to look around" if search.to_turn > 0.0 else "driving a widening search"
    return _Action(State.SEARCHING, twist, f"{motion}: {no_pillar}", search)


def _drive(
    controller_state: ControllerState,
    target: Target,
    look: _Look,
    obstacles_in_base: np.ndarray,
    outline: Footprint,
    control: ControlConfig,
) -> _Action:
    """Choose the action of a robot that knows where the pillar is.

    The robot drives to its stop position, around obstacles if needed. At the stop position, `_action_at_stop`
    chooses the action.

    Args:
        controller_state: memory; `close_at` and `updated_at` are of this scan, `state` is of the last scan.
        target: pillar in base_link.
        look: sight of the pillar in this scan; the robot arrives only if the scan shows the pillar.
        obstacles_in_base: obstacles near the robot, (N, 2) [m].
        outline: footprint of the robot.
        control: gains and limits.
    """
    pillar_seen = look.pillar is not None
    remaining = remaining_distance(target, control)
    action_at_stop = _action_at_stop(controller_state, target, remaining, pillar_seen, control)
    if action_at_stop is not None:
        return action_at_stop

    # Free direction that is nearest to the direction of the pillar, and equal to it if the way to the pillar
    # is free. The way need not be free beyond the stop point. In any other direction, `free_bearing` checks
    # the whole length LOOK_AHEAD.
    length_to_pillar = min(LOOK_AHEAD, remaining)
    bearing = free_bearing(obstacles_in_base, target.bearing, length_to_pillar, outline)
    if bearing is None:
        twist = Twist2D(0.0, control.search_rate)
        return _Action(State.DRIVING, twist, "turning to find a free way, because there is none ahead")
    if bearing != target.bearing:
        twist = heading_twist(bearing, min(SEARCH_SPEED, control.max_linear), control)
        return _Action(State.DRIVING, twist, "driving around an obstacle")
    if pillar_seen:
        reason = "driving to the pillar"
    else:
        reason = f"the pillar is {look.visibility.value}; driving to its last position"
    return _Action(State.DRIVING, steer(target, control), reason)


def _action_at_stop(
    controller_state: ControllerState,
    target: Target,
    remaining: float,
    pillar_seen: bool,
    control: ControlConfig,
) -> Optional[_Action]:
    """Return the action of a robot that need not drive on; None if the robot must still drive.

    A robot at its stop position arrives only if it sees the pillar. Otherwise it turns the lidar to the
    remembered position. A robot that shall touch the pillar must drive on until it has touched.

    Args:
        controller_state: memory; `close_at` and `updated_at` are of this scan, `state` is of the last scan.
        target: pillar in base_link.
        remaining: distance still to drive [m].
        pillar_seen: whether this scan shows the pillar.
        control: gains and limits.
    """
    shall_touch = to_be_touched(target, control)
    if shall_touch:
        is_at_stop = remaining <= TOUCH_GAP
        # the robot creeps on at its stop position, until it has surely touched
        is_finished, place = _has_touched(controller_state), "touching the pillar"
    else:
        is_at_stop = remaining <= control.arrival_tolerance
        is_finished, place = is_at_stop, "at the stop distance"
    # an arrived robot stays although it does not see the pillar, until `remaining` exceeds RESUME_DISTANCE
    stays = controller_state.state is State.ARRIVED and remaining <= RESUME_DISTANCE
    if (pillar_seen and is_finished) or stays:
        return _Action(State.ARRIVED, STOP, f"arrived: {place}")
    if is_at_stop and not pillar_seen:
        twist = heading_twist(target.bearing, 0.0, control)
        return _Action(State.DRIVING, twist, "turning to the last position of the pillar")
    return None


def _has_touched(controller_state: ControllerState) -> bool:
    """Return whether the robot has crept towards a pillar for TOUCH_CREEP_TIME, and so touches the pillar.

    The measured gap has an error, so the gap alone does not show the touch. `close_at` and `updated_at` of
    the controller's state are of this scan.
    """
    close_at, now = controller_state.close_at, controller_state.updated_at
    return close_at is not None and now - close_at > TOUCH_CREEP_TIME
