"""Drive of a real Husky: 10 Hz control loop, one speed limit for both sides, wheels with a time constant.

In: velocity commands and the time. Out: the wheels' speeds.

Sources: husky_base 0.6.10 (Noetic, repository husky_robot) runs its loop at 10 Hz and, if one side would
exceed 1.0 m/s, scales both (limitDifferentialSpeed), so that the curve keeps its radius. The lag comes from a
measurement (norlab-ulaval/DRIVE): wheels of a Husky need 0.7 s from 10 % to 90 % of a step, at 2.0 m/s^2. A
lag of 0.29 s and the drive's own limit of 3.0 m/s^2 give both values. The encoders measure speeds in whole
cm/s (BorealTC).
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
    """Scale both wheel speeds by one factor, so that neither exceeds `limit`; all have the same unit."""
    fastest = max(abs(left), abs(right))
    return (left, right) if fastest <= limit else (left * limit / fastest, right * limit / fastest)


class HuskyBase(Drive):
    """Drive with the control rate, the speed limit and the lag of the real base."""

    def __init__(self, drive_config: DriveConfig, config: HuskyBaseConfig, dt: float) -> None:
        """`dt`: duration of a physics step [s]; a period of the control loop is a whole number of steps."""
        self._base = config
        self.steps = round(1.0 / (config.control_rate * dt))
        # in one step, the difference between a wheel's speed and its target speed shrinks by this fraction
        self._lag_fraction = 1.0 - exp(-dt / config.lag) if config.lag > 0.0 else 1.0
        super().__init__(drive_config)  # calls `reset`

    def reset(self) -> None:
        """Stand still and forget the last command; the next step begins a period of the control loop."""
        super().reset()
        self._step_count = 0
        self._target_speeds = self._wheel_speeds = (0.0, 0.0)
        self._command_in_force = STOP

    def turn(self, now: float, dt: float) -> Tuple[Twist2D, Tuple[float, float]]:
        """Advance by `dt` to `now` [s]; return the command in force, and (left, right) speeds [rad/s]."""
        # `dt` is not used here, because the constructor has computed `steps` and `_lag_fraction` from it
        if self._step_count % self.steps == 0:  # a new period of the control loop begins
            self._command_in_force = self.update(now, 1.0 / self._base.control_rate)
            limit = self._base.max_wheel_speed / self._config.wheel_radius
            self._target_speeds = scale_to_limit(*wheel_speeds(self._command_in_force, self._config), limit)
        self._step_count += 1
        # the speeds of the wheels follow the target speeds with a time constant
        (left, right), (to_left, to_right) = self._wheel_speeds, self._target_speeds
        self._wheel_speeds = (
            left + self._lag_fraction * (to_left - left),
            right + self._lag_fraction * (to_right - right),
        )
        return self._command_in_force, self._wheel_speeds

    def encoded(self, wheels: WheelState) -> WheelState:
        """Return the wheels as husky_base publishes them: speeds in steps of the resolution, no efforts."""
        step = self._base.speed_resolution / self._config.wheel_radius
        return wheels._replace(
            speeds=tuple(round(speed / step) * step for speed in wheels.speeds),
            efforts=(0.0,) * len(wheels.efforts),
        )
