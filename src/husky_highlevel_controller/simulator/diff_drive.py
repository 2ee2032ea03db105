"""Differential drive kinematics, limits and time-out, as in diff_drive_controller: cmd_vel to wheel speeds.

In: velocity commands and the time. Out: the limited command and the wheel speeds of both sides.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import Tuple

from husky_highlevel_controller.datatypes import STOP, HuskyError, Twist2D, WheelState
from husky_highlevel_controller.robot import DriveConfig


class CommandError(HuskyError):
    """A velocity command that must not reach the wheels."""


def limit(target: Twist2D, previous: Twist2D, dt: float, config: DriveConfig) -> Twist2D:
    """Return the command nearest to `target` that the limits of speed and acceleration allow.

    `previous` is the command of `dt` s before.
    """
    return Twist2D(
        _limit(target.linear, previous.linear, config.max_linear, config.max_linear_acceleration * dt),
        _limit(target.angular, previous.angular, config.max_angular, config.max_angular_acceleration * dt),
    )


def _limit(target: float, previous: float, max_speed: float, max_change: float) -> float:
    """Return the speed nearest to `target` within `max_speed`, and within `max_change` of `previous`."""
    target = min(max(target, -max_speed), max_speed)
    return min(max(target, previous - max_change), previous + max_change)


def wheel_speeds(twist: Twist2D, config: DriveConfig) -> Tuple[float, float]:
    """Return the speeds of the (left, right) wheels that a command needs, forward positive [rad/s]."""
    # Half the distance of the wheels [m]. When the robot turns, its wheels skid and turn the robot less than
    # wheels that roll, so the distance is multiplied by a measured factor.
    half_track = config.wheel_separation * config.wheel_separation_multiplier / 2.0
    return (
        (twist.linear - twist.angular * half_track) / config.wheel_radius,
        (twist.linear + twist.angular * half_track) / config.wheel_radius,
    )


def twist_of_wheels(left: float, right: float, config: DriveConfig) -> Twist2D:
    """Return the velocity of the robot from the speeds of its wheels [rad/s]; inverse of `wheel_speeds`."""
    separation = config.wheel_separation * config.wheel_separation_multiplier
    return Twist2D(
        (left + right) / 2.0 * config.wheel_radius, (right - left) * config.wheel_radius / separation
    )


class Drive:
    """Drive of a robot in Gazebo: it follows the last command, within limits, until the command expires.

    The wheels have the commanded speed at once, as with Gazebo's velocity interface.
    """

    steps = 1  # number of physics steps between two readings of the encoders

    def __init__(self, config: DriveConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Stand still and forget the last command."""
        self._command, self._commanded_at = STOP, -inf
        self.output = STOP  # present command of the wheels, after the limits were applied

    def command(self, twist: Twist2D, now: float) -> None:
        """Take a command at `now` [s]. Raises CommandError, and keeps the last command, if not finite."""
        if not (isfinite(twist.linear) and isfinite(twist.angular)):
            raise CommandError(
                f"refused a velocity command that is not finite: linear.x = {twist.linear}, "
                f"angular.z = {twist.angular}"
            )
        self._command, self._commanded_at = twist, now

    def update(self, now: float, dt: float) -> Twist2D:
        """Advance by `dt` to the time `now` [s], and return the command after the limits were applied.

        If the last command has expired, the result slows down to a stop.
        """
        expired = now - self._commanded_at > self._config.timeout
        target = STOP if expired else self._command
        if target != self.output:  # saves the call of `limit` while the command is constant
            self.output = limit(target, self.output, dt, self._config)
        return self.output

    def turn(self, now: float, dt: float) -> Tuple[Twist2D, Tuple[float, float]]:
        """Advance by `dt` to the time `now` [s]; return the limited command and the speeds of the wheels.

        The speeds are (left, right) [rad/s].
        """
        command = self.update(now, dt)
        return command, wheel_speeds(command, self._config)

    def encoded(self, wheels: WheelState) -> WheelState:
        """Return the angles and speeds that the wheel encoders report; in Gazebo, the true ones."""
        return wheels
