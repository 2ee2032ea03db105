"""Braking distance and collision check of the stop guards; a danger stops the robot only once.

In: scans and velocities. Out: the clearance, and whether to call for a stop now.

A planar lidar sees only objects at its own height and in its field of view, which may end beside the robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, hypot, inf
from typing import List, Optional, Tuple

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import Pose, Pose2D, Scan, Twist2D
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.geometry import advance, matrix_from_quat
from husky_highlevel_controller.robot import DriveConfig, Robot

# [m/s], [rad/s] slower motion counts as standing, because odometry has noise
MOVING_LINEAR, MOVING_ANGULAR = 0.02, 0.05
# [m/s], [rad/s] no robot drives or turns faster than this; a measured velocity above it is wrong
FASTEST = 100.0
PATH_STEPS = 12  # number of poses on the way to standstill at which the clearance is checked
# [m] the robot moves towards an obstacle if the clearance shrinks by more than this before the robot stands
APPROACH = 1e-3
# [s] a robot that was stopped should stand after this time; if it still moves then, it counts as started
# again
STOPPING_TIMEOUT = 1.0


@dataclass(frozen=True)
class ProximityConfig:
    """Distances at which something is too close."""

    margin: float = number(0.0, 1.0, "clearance to keep after stopping [m]", default=0.1)
    reaction_time: float = number(0.0, 2.0, "delay from a scan to the first braking [s]", default=0.2)
    braking: float = number(
        0.1, 10.0, "assumed deceleration, at most the limit of the drivetrain [m/s^2]", default=3.0
    )


def is_moving(twist: Twist2D) -> bool:
    """Return whether a robot moves, by its measured velocity; a robot at rest has only a little noise.

    A velocity of NaN counts as motion, because the robot may move.
    """
    # a comparison with NaN is false, so NaN gives true here
    return not (abs(twist.linear) <= MOVING_LINEAR and abs(twist.angular) <= MOVING_ANGULAR)


def too_close(
    scan: Scan, pose_laser_in_base: Pose, twist_in_base: Twist2D, config: ProximityConfig, robot: Robot
) -> Optional[float]:
    """Decide whether the robot must brake now to keep its margin to everything that it moves towards.

    The robot's footprint is moved along its path to standstill, first at the present velocity, then braking.
    A return of the scan counts if the footprint comes too close to it on this path. It may be on any side.

    Args:
        scan: one sweep. Returns inside the robot's footprint are the robot itself.
        pose_laser_in_base: pose of the lidar, which may be upside-down.
        twist_in_base: measured velocity of the robot.
        config: margin and brakes.
        robot: robot with its footprint and the limits of its drive, at which it brakes.

    Returns:
        The present clearance between the robot's footprint and the nearest return that counts [m], or None if
        there is no need to brake, as for a robot that stands or moves away.
    """
    if not is_moving(twist_in_base):
        return None
    is_possible = abs(twist_in_base.linear) <= FASTEST and abs(twist_in_base.angular) <= FASTEST
    if not is_possible:
        # a wrong velocity (or NaN) does not tell where the robot goes, so the clearance counts as 0
        return 0.0
    outline = robot.footprint
    path = _braking_path(twist_in_base, config, robot.drive)
    points_in_base = _points(scan, pose_laser_in_base)
    clearance_now = _clearance(points_in_base, Pose2D(), outline)

    # points that the footprint cannot reach on the way to standstill need not be checked
    within_reach = clearance_now < config.margin + _longest_move(path, outline)
    points_in_base, clearance_now = points_in_base[within_reach], clearance_now[within_reach]

    smallest_clearance = clearance_now  # smallest clearance on the path, for each point
    for pose in path:
        smallest_clearance = np.minimum(smallest_clearance, _clearance(points_in_base, pose, outline))
    # A point is a danger if it comes too close, and if the robot moves towards it. A point inside the
    # footprint is the robot itself. It never counts, because its clearance of 0 cannot become smaller.
    is_danger = (smallest_clearance < config.margin) & (smallest_clearance < clearance_now - APPROACH)
    return float(clearance_now[is_danger].min()) if is_danger.any() else None


def nearest_clearance(scan: Scan, pose_laser_in_base: Pose, outline: Footprint) -> float:
    """Distance from a robot's outline to the nearest return of a scan [m]; inf if there is none."""
    clearance = outline.clearance(_points(scan, pose_laser_in_base))
    return float(clearance.min()) if len(clearance) else inf


def _braking_path(twist: Twist2D, config: ProximityConfig, drive: DriveConfig) -> List[Pose2D]:
    """Return the poses of a robot that brakes, until it stands: PATH_STEPS poses at equal times.

    The poses are in the frame of base_link before the braking. The robot keeps its present twist for the
    reaction time. Then forward speed and yaw rate are braked.
    """
    braking = min(config.braking, drive.max_linear_acceleration)
    angular_braking = drive.max_angular_acceleration
    braking_time = max(abs(twist.linear) / braking, abs(twist.angular) / angular_braking)
    duration = (config.reaction_time + braking_time) / PATH_STEPS  # [s] time between two poses
    path, pose = [], Pose2D()
    for step in range(PATH_STEPS):
        # [s] time for which the robot has braked at the middle of this step
        braked_for = max((step + 0.5) * duration - config.reaction_time, 0.0)
        linear = max(abs(twist.linear) - braking * braked_for, 0.0)
        angular = max(abs(twist.angular) - angular_braking * braked_for, 0.0)
        braked = Twist2D(copysign(linear, twist.linear), copysign(angular, twist.angular))
        pose = advance(pose, braked, duration)
        path.append(pose)
    return path


def _longest_move(path: List[Pose2D], outline: Footprint) -> float:
    """Return a length by which no point of the footprint moves farther on a path [m].

    A corner of the footprint moves at most by the way of base_link, plus the turn times the corner's distance
    from base_link. All other points of the footprint are nearer to base_link.
    """
    corner_distance = hypot(outline.half_length, outline.half_width)
    return max(hypot(pose.x, pose.y) + abs(pose.yaw) * corner_distance for pose in path)


def _points(scan: Scan, pose_laser_in_base: Pose) -> np.ndarray:
    """Return the ends of the beams in base_link, (N, 2) [m]; a return of -inf counts as `range_min`.

    By REP 117, -inf means that an object is too near to measure its range.
    """
    too_near = scan.ranges == -np.inf
    ranges, counted = np.where(too_near, scan.range_min, scan.ranges), scan.valid | too_near
    ranges, bearings = ranges[counted], scan.bearings[counted]
    in_laser = np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])
    # the beams have z = 0 in the laser's frame, so the upper left part of the rotation is enough for x and y
    turn = matrix_from_quat(pose_laser_in_base.quat_xyzw)[:2, :2]
    points: np.ndarray = (turn @ in_laser).T + pose_laser_in_base.position[:2]
    return points


def _clearance(points_in_base: np.ndarray, pose: Pose2D, outline: Footprint) -> np.ndarray:
    """Return the distance from the outline of a robot at `pose` to each point, (N,) [m]; 0 inside."""
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    # the points in the frame of the robot at `pose`
    from_robot = (points_in_base - (pose.x, pose.y)) @ np.array([[c, -s], [s, c]])
    return outline.clearance(from_robot)


@dataclass(frozen=True)
class Latch:
    """Memory that a guard has stopped the robot, so that a danger stops the robot only once.

    Otherwise a robot that stands at an obstacle could not be started again.
    """

    # [s] time at which the controller was stopped because of a danger; None if it was not stopped, or was
    # started again
    tripped_at: Optional[float] = None
    stood: bool = False  # true if the robot stood at the last update


def advance_latch(latch: Latch, danger: bool, moving: bool, stamp: float) -> Tuple[Latch, bool]:
    """Return the latch after an update, and whether to stop the robot now.

    The first danger stops the robot, and the latch remembers this. A further danger stops the robot only
    after somebody has started the robot again. This is so if the robot moves after it stood, or if it still
    moves STOPPING_TIMEOUT after the stop.

    Args:
        latch: result of the last call; Latch() at first.
        danger: whether the robot is in danger now.
        moving: whether the robot moves now.
        stamp: time of this update [s]; a time before the stop means a new run.
    """
    if latch.tripped_at is not None:
        elapsed = stamp - latch.tripped_at
        is_started = moving and (latch.stood or elapsed > STOPPING_TIMEOUT)
        is_new_run = elapsed < 0.0
        latch = Latch() if is_started or is_new_run else Latch(latch.tripped_at, stood=not moving)
    if latch.tripped_at is None and danger:
        return Latch(stamp), True
    return latch, False
