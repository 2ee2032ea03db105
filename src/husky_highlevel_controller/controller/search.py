"""Search for a pillar that is out of sight, and free directions round obstacles.

In: the robot's pose in odom, a scan. Out: the next twist, a free direction.

The search makes a full turn on the spot, then drives the legs of a widening square with a turn after each.
"""

from __future__ import annotations

from math import cos, hypot, pi, radians, sin
from typing import NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.controller.control import ControlConfig, Target
from husky_highlevel_controller.datatypes import Pose, Pose2D, Scan, Twist2D
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.geometry import matrix_from_quat, wrap_angle

# [m] the robot drives in a direction only if the way is free for this length in front of its footprint
LOOK_AHEAD = 1.0
SEARCH_SPEED = 0.5  # [m/s] fastest speed while searching
_FREE_BESIDE = 0.15  # [m] the way is free only if there is this much space on either side of the footprint
_OWN_BODY = 0.01  # [m] returns nearer to the footprint than this come from the robot itself
# [rad] angles between the goal and the directions that `free_bearing` tries: 0, and up to 120 degrees to the
# left and right
_SIDESTEPS = [radians(angle) for angle in range(120, -121, -15)]
# [m] returns with a longer range are ignored, because they are not within LOOK_AHEAD of the robot
_NEAR_RANGE = 2.0
_SAME_BODY = 0.2  # [m] neighbouring returns that are nearer to each other than this belong to one object
_TARGET_MARGIN = 0.15  # [m] returns nearer to the pillar's surface than this belong to the pillar
_FULL_TURN = 2.0 * pi
_QUARTER_TURN = pi / 2.0


class Search(NamedTuple):
    """Progress of the search."""

    leg: int = 0  # number of legs that have begun; a leg is a straight part of the square spiral
    to_turn: float = _FULL_TURN  # [rad] angle by which the robot must still turn before the next leg
    to_drive: float = 0.0  # [m] remaining length of the current leg
    pose: Optional[Pose2D] = None  # pose of base_link in odom at the last scan


def search_on(
    search: Search,
    base_in_odom: Pose2D,
    points_in_base: np.ndarray,
    outline: Footprint,
    config: ControlConfig,
) -> Tuple[Search, Twist2D]:
    """Continue the search for a pillar along a square spiral.

    Before the first leg the robot turns once around to look. At the end of a leg it turns once around to
    look, and a quarter turn more to the next side of the square. All turns are to the left. A leg ends early
    in front of an obstacle. Then the robot turns only to the next side, without the look around.

    Args:
        search: result of the last call; `Search()` at first, which begins with a full turn.
        base_in_odom: pose of the robot.
        points_in_base: obstacles near the robot, which are ends of beams, (N, 2) [m].
        outline: footprint of the robot.
        config: rate of turns, and growth of the spiral.

    Returns:
        The search for the next call, and the command.
    """
    # motion since the last call, by which the remaining turn or the remaining leg becomes shorter
    before = search.pose or base_in_odom
    turned = wrap_angle(base_in_odom.yaw - before.yaw)
    driven = hypot(base_in_odom.x - before.x, base_in_odom.y - before.y)
    search = search._replace(pose=base_in_odom)
    if search.to_turn > 0.0:
        search = search._replace(to_turn=search.to_turn - turned)
        if search.to_turn > 0.0:
            return search, Twist2D(0.0, config.search_rate)
        # the turn has ended, so the next leg begins; every second leg is longer than the leg before it
        length = config.search_radius_step * (1 + search.leg // 2)
        search = search._replace(leg=search.leg + 1, to_drive=length)
    else:
        search = search._replace(to_drive=search.to_drive - driven)
    # the whole leg is driven, so the robot turns once to look around, and then to the next direction
    if search.to_drive <= 0.0:
        return search._replace(to_turn=_FULL_TURN + _QUARTER_TURN), Twist2D()
    # an obstacle ends the leg, so the robot only turns to the next direction
    if not is_free(points_in_base, 0.0, LOOK_AHEAD, outline):
        return search._replace(to_drive=0.0, to_turn=_QUARTER_TURN), Twist2D()
    return search, Twist2D(SEARCH_SPEED, 0.0)


def near_points(scan: Scan, laser_in_base: Pose, target: Optional[Target], outline: Footprint) -> np.ndarray:
    """Return the obstacles near the robot, which are ends of beams, (N, 2) [m] in base_link.

    A beam that hits the robot itself or the target does not count. A single beam that hits another body than
    the beams beside it does not count, because it is usually an error of measurement.
    """
    (beams,) = ((scan.returns < _NEAR_RANGE) & scan.valid).nonzero()
    if not len(beams):
        return np.empty((0, 2))
    ranges = scan.returns[beams]
    # true for each beam that hits the same body as the next beam; one beam without a return may lie between
    # the two
    hits_same = (beams[1:] - beams[:-1] <= 2) & (np.abs(ranges[1:] - ranges[:-1]) < _SAME_BODY)
    # a beam is kept if it hits the same body as the beam after it or the beam before it
    is_kept = np.zeros(len(beams), dtype=bool)
    is_kept[:-1] = hits_same
    is_kept[1:] |= hits_same
    beams = beams[is_kept]
    angles = scan.angle_min + beams * scan.angle_increment
    points_in_laser = scan.returns[beams] * np.stack([np.cos(angles), np.sin(angles)])
    # the beams have z = 0 in the laser's frame, so the upper left part of the rotation is enough to compute x
    # and y
    rotation = matrix_from_quat(laser_in_base.quat_xyzw)[:2, :2]
    points = (rotation @ points_in_laser).T + laser_in_base.position[:2]
    is_obstacle = outline.clearance(points) > _OWN_BODY
    if target is not None:
        from_target = points - (target.x, target.y)
        is_obstacle &= np.hypot(from_target[:, 0], from_target[:, 1]) > target.radius + _TARGET_MARGIN
    return points[is_obstacle]


def is_free(points_in_base: np.ndarray, bearing: float, length: float, outline: Footprint) -> bool:
    """Return whether the robot could face `bearing` [rad] and drive `length` [m] without touching a point."""
    if not len(points_in_base):
        return True
    # distance of each point ahead of the robot if it faces `bearing`, and distance to the left or right, (N,)
    c, s = cos(bearing), sin(bearing)
    along = points_in_base @ (c, s)
    across = np.abs(points_in_base @ (-s, c))
    ahead, aside = outline.half_length + length, outline.half_width + _FREE_BESIDE
    return not bool(((along > 0.0) & (along < ahead) & (across < aside)).any())


def free_bearing(
    points_in_base: np.ndarray, goal: float, length: float, outline: Footprint
) -> Optional[float]:
    """Return the direction nearest to the direction `goal` that has a free path [rad]; None if there is none.

    If two directions are equally near to `goal`, the direction nearer to straight ahead is returned. In the
    direction of `goal` itself, only `length` [m] must be free, and in any other direction LOOK_AHEAD.
    """
    if is_free(points_in_base, goal, length, outline):
        return goal
    # the smallest turns away from the goal come first; of two equal turns, the one nearer to straight ahead
    turns = sorted(_SIDESTEPS, key=lambda turn: (abs(turn), abs(wrap_angle(goal + turn))))
    # the first turn is 0, which is the goal's own direction, and this direction is not free
    for turn in turns[1:]:
        bearing = wrap_angle(goal + turn)
        if is_free(points_in_base, bearing, LOOK_AHEAD, outline):
            return bearing
    return None
