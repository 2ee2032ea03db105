"""Drives to a pillar and stops in front of it.

In: where the pillar is, seen from base_link, and what the robot was doing.
Out: the twist to command, and what the robot does now.
Must not know: ROS, PyBullet, scans, time.

Two proportional laws: forward speed from the distance still to go, turning rate from the bearing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from math import atan2, cos, hypot, isfinite
from typing import Optional, Tuple

from husky_highlevel_controller.datatypes import STOP, Pillar, Pose, Twist2D
from husky_highlevel_controller.geometry import transform_point


@dataclass(frozen=True)
class ControlConfig:
    """Gains and limits of the drive to the pillar.

    The default gains brake from 1.0 m/s with at most 2 m/s^2 and forgive 0.1 s of delay without swinging;
    the robot's own limits are 1.0 m/s, 3.0 m/s^2, 2.0 rad/s, 6.0 rad/s^2 (husky_control 0.6.10).
    """

    p_gain_vel: float = field(
        default=2.0,
        metadata={"min": 0.0, "max": 10.0, "help": "forward speed for each metre still to go [1/s]"},
    )
    p_gain_ang: float = field(
        default=2.0,
        metadata={"min": 0.0, "max": 10.0, "help": "turning rate for each radian of bearing [1/s]"},
    )
    stop_distance: float = field(
        default=0.4,
        metadata={
            "min": 0.1,
            "max": 10.0,
            "help": "where to stop, from the lidar to the pillar's surface [m]",
        },
    )
    max_linear: float = field(
        default=1.0, metadata={"min": 0.0, "max": 1.0, "help": "fastest forward speed [m/s]"}
    )
    max_angular: float = field(
        default=1.0, metadata={"min": 0.0, "max": 2.0, "help": "fastest turning rate [rad/s]"}
    )
    arrival_tolerance: float = field(
        default=0.01,
        metadata={"min": 0.001, "max": 0.09, "help": "how near to stop_distance counts as arrived [m]"},
    )


RESUME_ERROR = 0.10  # [m], further than this from where it should stand an arrived robot drives again


class Phase(Enum):
    """What the robot is doing."""

    WAITING = "waiting"  # there is no pillar
    DRIVING = "driving"
    ARRIVED = "arrived"


@dataclass(frozen=True)
class Target:
    """The pillar as the controller needs it."""

    x: float  # [m], centre, in base_link
    y: float  # [m], centre, in base_link
    distance: float  # [m], from the lidar to the pillar's near surface, as a scan reads it

    @property
    def bearing(self) -> float:
        """Direction of the centre in base_link [rad]."""
        return atan2(self.y, self.x)


def target_from_pillar(pillar: Pillar, pose_laser_in_base: Pose) -> Target:
    """The target that a pillar is, whichever way up the lidar is mounted."""
    x, y, _ = transform_point(pose_laser_in_base, (pillar.x, pillar.y, 0.0))
    return Target(x, y, hypot(pillar.x, pillar.y) - pillar.radius)


def advance(phase: Phase, target: Optional[Target], config: ControlConfig) -> Tuple[Phase, Twist2D]:
    """Decide on one scan.

    Args:
        phase: what the robot was doing, WAITING at first.
        target: the pillar in this scan; None, or one that is not a number, means there is none.
        config: gains and limits.

    Returns:
        What the robot does now, and the velocity to command. It stands still unless it is DRIVING.
    """
    if target is None or not isfinite(target.x + target.y + target.distance):
        return Phase.WAITING, STOP
    to_go = target.distance - config.stop_distance
    near_enough = RESUME_ERROR if phase is Phase.ARRIVED else config.arrival_tolerance
    if to_go <= near_enough:
        return Phase.ARRIVED, STOP
    return Phase.DRIVING, steer(target, config)


def steer(target: Target, config: ControlConfig) -> Twist2D:
    """The proportional laws: never backwards, slower the less the robot faces the pillar, limited.

    Args:
        target: where the pillar is.
        config: gains and limits.

    Returns:
        The velocity to command, in base_link.
    """
    linear = config.p_gain_vel * (target.distance - config.stop_distance)
    facing = max(cos(target.bearing), 0.0)
    angular = config.p_gain_ang * target.bearing
    return Twist2D(
        linear=facing * min(max(linear, 0.0), config.max_linear),
        angular=min(max(angular, -config.max_angular), config.max_angular),
    )
