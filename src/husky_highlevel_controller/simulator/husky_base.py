"""Drive of a real Husky: 10 Hz control loop, one speed limit for both sides, wheels with a time constant.

In: velocity commands and the time. Out: the wheels' speeds.

Sources: husky_base 0.6.10 (Noetic, repository husky_robot) runs its control loop at 10 Hz. If one side would
exceed 1.0 m/s, it scales both sides (limitDifferentialSpeed), so that the curve keeps its radius. The lag
comes from a measurement (norlab-ulaval/DRIVE): after a step of the command, the wheels of a Husky need 0.7 s
from 10 % to 90 % of the step, and accelerate by at most 2.0 m/s^2. With a lag of 0.29 s and the drive's own
limit of 3.0 m/s^2, the simulated wheels need the same time and accelerate as fast. The encoders measure
speeds in whole cm/s (BorealTC).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Tuple

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import STOP, Twist2D, WheelState
from husky_highlevel_controller.robot import DriveConfig
from husky_highlevel_controller.simulator.diff_drive import Drive, wheel_speeds


@dataclass(frozen=True)
class HuskyBaseConfig:
    """The real drive."""

    control_rate: int = number(1, 200, "commands, wheel odometry and joint states [Hz]", default=10)
    max_wheel_speed: float = number(
        0.1, 5.0, "maximum speed of either side, before both are scaled [m/s]", default=1.0
    )
    lag: float = number(0.0, 5.0, "time constant of the wheel speed [s]", default=0.29)
    speed_resolution: float = number(
        1e-4, 1.0, "speeds are reported in multiples of this [m/s]", default=0.01
    )


def scale_to_limit(left: float, right: float, limit: float) -> Tuple[float, float]:
    """Scale both wheel speeds by one factor, so that neither exceeds `limit`; all have the same unit.

    So the robot drives slower on the same curve.
    """
    fastest = max(abs(left), abs(right))
    if fastest <= limit:
        return left, right
    return left * limit / fastest, right * limit / fastest


class HuskyBase(Drive):
    """Drive with the control rate, the speed limit and the lag of the real base."""

    def __init__(self, drive_config: DriveConfig, config: HuskyBaseConfig, dt: float) -> None:
        """`dt`: duration of a physics step [s]; a period of the control loop is a whole number of steps."""
        self._base = config
        self.steps = round(
            1.0 / (config.control_rate * dt)
        )  # number of steps in a period of the control loop
        # in one step, the difference between a wheel's speed and its target speed shrinks by this fraction
        self._lag_fraction = 1.0 - exp(-dt / config.lag) if config.lag > 0.0 else 1.0
        super().__init__(drive_config)  # this also calls `reset`

    def reset(self) -> None:
        """Stand still and forget the last command; the next step begins a period of the control loop."""
        super().reset()
        self._step_count = 0
        self._target_speeds = self._wheel_speeds = (0.0, 0.0)
        self._command_in_force = STOP

    def turn(self, now: float, dt: float) -> Tuple[Twist2D, Tuple[float, float]]:
        """Advance by one step to the time `now` [s]; return the limited command and the speeds of the wheels.

        The speeds are (left, right) [rad/s]. `dt` is the same as in the constructor, so it is not used here.
        """
        if self._step_count % self.steps == 0:  # a new period of the control loop begins
            # `update` takes the last command, or STOP if it has expired, and limits its acceleration
            self._command_in_force = self.update(now, 1.0 / self._base.control_rate)
            limit = self._base.max_wheel_speed / self._config.wheel_radius  # [rad/s]
            self._target_speeds = scale_to_limit(*wheel_speeds(self._command_in_force, self._config), limit)
        self._step_count += 1
        # the speeds of the wheels follow the target speeds with a time constant
        (left, right), (target_left, target_right) = self._wheel_speeds, self._target_speeds
        self._wheel_speeds = (
            left + self._lag_fraction * (target_left - left),
            right + self._lag_fraction * (target_right - right),
        )
        return self._command_in_force, self._wheel_speeds

    def encoded(self, wheels: WheelState) -> WheelState:
        """Return the wheels as husky_base publishes them: speeds rounded to the resolution, efforts of 0."""
        step = self._base.speed_resolution / self._config.wheel_radius  # [rad/s]
        return wheels._replace(
            speeds=tuple(round(speed / step) * step for speed in wheels.speeds),
            efforts=(0.0,) * len(wheels.efforts),
        )
