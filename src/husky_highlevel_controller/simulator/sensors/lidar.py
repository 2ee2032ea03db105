"""Simulated planar lidar.

In: the robot's true pose, a function that casts rays, a random generator. Out: a `Scan`.

Beams that meet nothing, or a body that is too near, get the ranges of gazebo_ros_laser and REP 117.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable

import numpy as np

from husky_highlevel_controller.config import number, setting
from husky_highlevel_controller.datatypes import Beams, Pose, RobotState, Scan, even_beams
from husky_highlevel_controller.geometry import compose

# function that takes the laser's pose in the world, N beams and max_range [m]; it returns the distances (N,)
# [m], +inf for a beam that meets nothing
CastRays = Callable[[Pose, Beams, float], np.ndarray]


@dataclass(frozen=True)
class LidarConfig:
    """Beams, range and noise of the lidar; config/robots/ holds their values."""

    beams: int = number(2, 16384, "number of beams")
    angle_max: float = number(0.01, 3.14159, "angle of the last beam; the first has the negative angle [rad]")
    range_min: float = number(0.0, 10.0, "a shorter range reads -inf, see hides_near [m]")
    range_max: float = number(0.1, 1000.0, "a longer range reads +inf [m]")
    noise: float = number(0.0, 1.0, "standard deviation [m]")
    hides_near: bool = setting("a shorter range reads +inf, as in pointcloud_to_laserscan; if false, -inf")

    def __post_init__(self) -> None:
        """Raise ValueError if no range can be valid, because the limits are in the wrong order."""
        if self.range_min >= self.range_max:
            raise ValueError(f"range_min = {self.range_min} is not below range_max = {self.range_max}")


class Lidar:
    """A planar lidar on base_link."""

    def __init__(self, config: LidarConfig, cast_rays: CastRays, frame: str, pose_in_base: Pose) -> None:
        """Make a lidar.

        Args:
            config: beams, range and noise.
            cast_rays: measures true distances along beams.
            frame: name of the frame of the scans.
            pose_in_base: pose of the lidar in base_link.
        """
        self._config, self._cast_rays = config, cast_rays
        self._frame, self._pose_in_base = frame, pose_in_base
        self._beams = even_beams(-config.angle_max, config.angle_max, config.beams)

    def reset(self, rng: np.random.Generator) -> None:
        """Restart with noise from `rng`."""
        self._rng = rng

    def sample(self, state: RobotState, stamp: float) -> Scan:
        """Return the scan; all beams measure at the same time, `stamp` [s].

        A beam that meets nothing has the range +inf. A beam that meets a body that is too near has -inf (REP
        117), or +inf if `hides_near` is set, as in pointcloud_to_laserscan. These ranges have no noise.
        """
        config = self._config
        pose_laser_in_world = compose(state.pose_in_world, self._pose_in_base)
        # true distances; inf if a beam meets nothing within `range_max`
        ranges = self._cast_rays(pose_laser_in_world, self._beams, config.range_max)
        # every beam gets a random number, even if it meets nothing, so that the noise of one beam does not
        # depend on the other beams
        noisy = self._rng.normal(0.0, config.noise, len(ranges))
        noisy += ranges
        # The true distance decides whether a range is valid, and noise does not change this. So noisy ranges
        # are first limited to the valid range, and then invalid ones are set.
        np.maximum(noisy, config.range_min, out=noisy)
        np.minimum(noisy, config.range_max, out=noisy)
        noisy[ranges >= config.range_max] = np.inf
        if ranges.min() <= config.range_min:  # this saves time, because a too near body is seldom
            noisy[ranges <= config.range_min] = np.inf if config.hides_near else -np.inf
        noisy.setflags(write=False)
        return Scan(
            stamp,
            self._frame,
            angle_min=-config.angle_max,
            angle_max=config.angle_max,
            range_min=config.range_min,
            range_max=config.range_max,
            ranges=noisy,
        )
