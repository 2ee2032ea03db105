"""The SICK LMS1xx on the Husky: one sweep of a planar lidar.

In: where the laser stands, a function that casts rays, a random generator. Out: a `Scan`.
Must not know: ROS, PyBullet.

Numbers: LMS1xx 0.3.0, urdf/sick_lms1xx.urdf.xacro; edge cases as gazebo_ros_laser and REP 117 have them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Callable

import numpy as np

from husky_highlevel_controller.datatypes import Pose, Scan

# (pose of the laser in the world, bearings (N,) [rad], reach [m]) -> distances (N,) [m], +inf for nothing
CastRays = Callable[[Pose, np.ndarray, float], np.ndarray]


@dataclass(frozen=True)
class LidarConfig:
    """What the lidar is; defaults are the Noetic Husky's."""

    beams: int = field(default=720, metadata={"min": 2, "max": 16384, "help": "number of beams"})
    angle_max: float = field(
        default=2.35619,
        metadata={"min": 0.01, "max": 3.14159, "help": "last beam's angle; first is minus it [rad]"},
    )
    range_min: float = field(default=0.1, metadata={"min": 0.0, "max": 10.0, "help": "nearer reads -inf [m]"})
    range_max: float = field(
        default=30.0, metadata={"min": 0.1, "max": 1000.0, "help": "farther reads +inf [m]"}
    )
    noise: float = field(default=0.001, metadata={"min": 0.0, "max": 1.0, "help": "standard deviation [m]"})


@lru_cache(maxsize=8)
def bearings(config: LidarConfig) -> np.ndarray:
    """Angles of the beams in the laser's frame, (N,) [rad], read-only."""
    angles = np.linspace(-config.angle_max, config.angle_max, config.beams)
    angles.setflags(write=False)
    return angles


def sweep(
    cast_rays: CastRays,
    pose_laser_in_world: Pose,
    config: LidarConfig,
    rng: np.random.Generator,
    stamp: float,
    frame: str,
) -> Scan:
    """One scan at one instant: misses are +inf and too close is -inf, both without noise (REP 117)."""
    ranges = cast_rays(pose_laser_in_world, bearings(config), config.range_max)
    # one draw per beam whatever it hits: the noise of a beam never depends on the other beams
    noisy = rng.normal(0.0, config.noise, len(ranges))
    noisy += ranges
    np.maximum(noisy, config.range_min, out=noisy)
    np.minimum(noisy, config.range_max, out=noisy)
    noisy[ranges >= config.range_max] = np.inf
    if ranges.min() <= config.range_min:  # seldom
        noisy[ranges <= config.range_min] = -np.inf
    noisy.setflags(write=False)
    return Scan(stamp, frame, -config.angle_max, config.angle_max, config.range_min, config.range_max, noisy)
