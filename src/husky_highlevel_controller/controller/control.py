"""Proportional control of the drive to a pillar, its limits, and the remaining distance.

In: the pillar's position in base_link. Out: the twist to command.

Two proportional laws: forward speed from the distance still to go, turning rate from the bearing.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot
from typing import NamedTuple, Tuple

from husky_highlevel_controller.config import number, setting
from husky_highlevel_controller.datatypes import Pose, Twist2D
from husky_highlevel_controller.footprint import Footprint

TOUCH_SPEED = 0.1  # [m/s] fastest speed at a gap below TOUCH_SLOW_FROM, if the robot shall touch the pillar
# [m/s] slowest speed before a touch; with the P law alone, the robot would become slower and slower, and
# never touch the pillar
MIN_TOUCH_SPEED = 0.04
# [m] the robot drives at TOUCH_SPEED or slower if the gap to the pillar is smaller than this; the gap is long
# enough to brake from 1.0 m/s at 3.0 m/s^2
TOUCH_SLOW_FROM = 0.25


@dataclass(frozen=True)
class ControlConfig:
    """Gains and limits of the drive to the pillar, and of the search for it.

    The default gains brake from 1.0 m/s with at most 2 m/s^2 and tolerate 0.1 s of delay without oscillation.
    The robot's own limits are in config/robots/.
    """

    p_gain_vel: float = number(0.0, 10.0, "forward speed per metre of remaining distance [1/s]", default=2.0)
    p_gain_ang: float = number(0.0, 10.0, "turning rate per radian of bearing [1/s]", default=2.0)
    stop_distance: float = number(
        0.0,
        10.0,
        "distance from the lidar to the surface of the pillar at which to stop; 0 means touch it [m]",
        default=0.4,
    )
    max_linear: float = number(0.0, 1.0, "maximum forward speed [m/s]", default=1.0)
    max_angular: float = number(0.0, 2.0, "maximum turning rate [rad/s]", default=1.0)
    arrival_tolerance: float = number(
        0.001, 0.09, "largest difference from stop_distance that counts as arrived [m]", default=0.01
    )
    search: bool = setting(
        "search for a pillar that was never seen or is lost; if false, stand still", default=True
    )
    search_rate: float = number(0.05, 2.0, "turning rate of the search [rad/s]", default=0.5)
    search_radius_step: float = number(0.1, 10.0, "growth of the search path per round [m]", default=1.5)


class Target(NamedTuple):
    """The pillar as the control needs it."""

    x: float  # [m] x of the pillar's centre in base_link
    y: float  # [m] y of the pillar's centre in base_link
    radius: float  # [m]
    distance: float  # [m] distance from the lidar to the nearest point of the pillar's surface
    gap: float  # [m] distance from the robot's footprint to the pillar's surface

    @property
    def bearing(self) -> float:
        """Direction of the centre in base_link [rad]."""
        return atan2(self.y, self.x)


def target_at(
    center_in_base: Tuple[float, float], radius: float, laser_in_base: Pose, outline: Footprint
) -> Target:
    """Return a pillar as the control needs it, from its centre in base_link [m] and its radius [m].

    `outline` is the footprint of the robot, from which the gap to the pillar is measured.
    """
    x, y = center_in_base
    distance = hypot(x - laser_in_base.position[0], y - laser_in_base.position[1]) - radius
    gap = outline.clearance_at(x, y) - radius
    return Target(x, y, radius, distance, gap)


def remaining_distance(target: Target, config: ControlConfig) -> float:
    """Distance still to drive [m]: to the stop point, or to the touch if the touch comes first."""
    return min(target.distance - config.stop_distance, target.gap)


def to_be_touched(target: Target, config: ControlConfig) -> bool:
    """Return whether the robot shall touch the pillar.

    This is so if the stop distance is so small that the hull meets the pillar before the lidar is at it.
    """
    return target.gap < target.distance - config.stop_distance


def steer(target: Target, config: ControlConfig) -> Twist2D:
    """Return the twist that drives to the pillar: forward speed by remaining distance, turning by bearing.

    The robot never drives backwards, and drives slower while the pillar is not straight ahead. Near a pillar
    that it shall touch and that is straight ahead, its speed is between MIN_TOUCH_SPEED and TOUCH_SPEED.
    """
    speed = config.p_gain_vel * remaining_distance(target, config)
    # with a gain of 0, the robot does not drive at all, not even at MIN_TOUCH_SPEED
    if config.p_gain_vel > 0.0 and to_be_touched(target, config):
        speed = max(speed, MIN_TOUCH_SPEED)
        if target.gap < TOUCH_SLOW_FROM:
            speed = min(speed, TOUCH_SPEED)
    return heading_twist(target.bearing, min(max(speed, 0.0), config.max_linear), config)


def heading_twist(bearing: float, speed: float, config: ControlConfig) -> Twist2D:
    """Return the twist that turns towards a bearing [rad] and drives forwards, at most at `speed` [m/s].

    The speed is multiplied by the cosine of the bearing. So the robot turns on the spot if the bearing is to
    the side or behind it, and drives at `speed` if the bearing is straight ahead.
    """
    return Twist2D(max(cos(bearing), 0.0) * speed, config.p_gain_ang * bearing)


def limited(twist: Twist2D, config: ControlConfig) -> Twist2D:
    """Return a twist within max_linear and max_angular; `decide` limits every command by this."""
    linear, angular = config.max_linear, config.max_angular
    return Twist2D(min(max(twist.linear, -linear), linear), min(max(twist.angular, -angular), angular))
