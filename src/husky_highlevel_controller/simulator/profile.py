"""The real Husky's profile: all differences from Gazebo's Husky, in one record.

In: nothing. Out: `RobotProfile`, `Ground`.

`SimulatorConfig` describes Gazebo's Husky. A simulation with a profile publishes the same messages as the
real robot's drivers. config/robot_profile.yaml has the same numbers, and a test compares them.

The values of the grounds come from measurements (BorealTC, LaRocque et al. 2024, arXiv 2403.16877;
norlab-ulaval/DRIVE). If a robot turns in place, its wheels skid, so it turns more slowly than its wheels
would turn it without skidding. It is as slow as a robot without skidding whose track (the distance between
left and right wheels) is chi times as large. chi is 1 + ratio (wheelbase / track)^2, with the ratio of
sideways to lengthwise grip (see `traction.py`). It does not depend on the strength of the grip. On flooring,
chi was measured as 1.74, so the ratio is 0.92. On sandy loam, chi was measured as 2.13, so the ratio is 1.40,
because sunken wheels push soil aside. Both grounds have the friction of the URDF, because no measurement
contradicts this value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from husky_highlevel_controller.config import number, setting
from husky_highlevel_controller.simulator.husky_base import HuskyBaseConfig
from husky_highlevel_controller.simulator.power import PowerConfig
from husky_highlevel_controller.simulator.sensors.lms1xx import Lms1xxConfig
from husky_highlevel_controller.simulator.sensors.vibration import VibrationConfig


@dataclass(frozen=True)
class Ground:
    """Ground under the robot: what it changes for the wheels, the motors and the IMU."""

    friction: float = number(0.05, 2.0, "friction of the wheels along the driving direction")
    lateral_grip: float = number(0.1, 10.0, "ratio of sideways to lengthwise friction")
    rolling_current: float = number(0.0, 100.0, "current of both motors when driving straight [A]")
    vibration: VibrationConfig = setting("vibration that the IMU measures")


PROFILES, GROUNDS = ("gazebo", "robot"), ("hard", "soft")
HARD = Ground(
    friction=1.0, lateral_grip=0.92, rolling_current=3.9, vibration=VibrationConfig(3.1, 1.3, 0.06, 0.6)
)
SOFT = Ground(
    friction=1.0, lateral_grip=1.40, rolling_current=7.5, vibration=VibrationConfig(4.8, 1.7, 0.16, 0.3)
)


@dataclass(frozen=True)
class RobotProfile:
    """The real Husky, all grounds, and the name of the ground under the robot."""

    lidar: Lms1xxConfig = setting("the lidar and its driver", default=Lms1xxConfig())
    base: HuskyBaseConfig = setting("the drive", default=HuskyBaseConfig())
    power: PowerConfig = setting("battery and motors", default=PowerConfig())
    hard: Ground = setting("floors and asphalt", default=HARD)
    soft: Ground = setting("loam and snow", default=SOFT)
    surface: str = "hard"  # name of the ground, one of GROUNDS

    def on(self, surface: str) -> RobotProfile:
        """Return the profile with another ground under the robot, one of GROUNDS."""
        return replace(self, surface=surface)

    @property
    def ground(self) -> Ground:
        """Values of the ground under the robot."""
        return self.soft if self.surface == "soft" else self.hard
