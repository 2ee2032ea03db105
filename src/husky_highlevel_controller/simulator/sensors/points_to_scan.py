"""Planar scan of a point cloud: the nearest point in each direction.

This module replaces pointcloud_to_laserscan 1.4 (Noetic), together with `ros/simulator/points_to_scan.py`,
the script points_to_scan and `compat/pointcloud_to_laserscan`. `test_points_to_scan.py` computes the same
ranges with the original's rules, one point after the other. No test runs the original, which Debian does not
have.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import ceil, pi
from typing import Any, Dict, Mapping

import numpy as np

from husky_highlevel_controller.config import number, setting

FAR = 1e6  # [m] larger than any coordinate of a point, so a limit of this size has no effect
MAX_DIRECTIONS = 100_000  # largest number of directions of a scan; a config with more is an error


def _number(default: Any, help_text: str, minimum: float = -FAR) -> Any:
    """Return a numeric field of a config; its limits are wide, because the original has none."""
    return number(minimum, FAR, help_text, default=default)


@dataclass(frozen=True)
class FlattenConfig:
    """Parameters of pointcloud_to_laserscan 1.4, with its defaults."""

    target_frame: str = setting(
        "frame of the scan; defaults to the frame of the cloud", default="", optional=True
    )
    transform_tolerance: float = _number(0.01, "time that has no effect here [s]")
    min_height: float = _number(-FAR, "lower points are omitted [m]")
    max_height: float = _number(FAR, "higher points are omitted [m]")
    angle_min: float = _number(-pi, "angle of the first direction [rad]")
    angle_max: float = _number(pi, "angle of the last direction [rad]")
    angle_increment: float = _number(pi / 180.0, "angle between directions [rad]", 1e-4)
    scan_time: float = _number(1.0 / 30.0, "time from scan to scan, copied to the message [s]")
    range_min: float = _number(0.0, "nearer points are omitted [m]")
    range_max: float = _number(FAR, "farther points are omitted [m]")
    use_inf: bool = setting("+inf if there is no point; if false, a range beyond range_max", default=True)
    inf_epsilon: float = _number(1.0, "distance beyond range_max [m]")
    concurrency_level: int = _number(1, "number that has no effect here")
    queue_size: int = _number(1, "number that has no effect here")

    def __post_init__(self) -> None:
        """Raise ValueError if there is no direction, or too many."""
        if self.angle_min >= self.angle_max:
            raise ValueError(f"angle_min = {self.angle_min} is not below angle_max = {self.angle_max}")
        if self.directions > MAX_DIRECTIONS:
            raise ValueError(
                f"angle_increment = {self.angle_increment} makes {self.directions} directions "
                f"from angle_min to angle_max, more than {MAX_DIRECTIONS}"
            )

    @property
    def directions(self) -> int:
        """Number of directions."""
        return ceil((self.angle_max - self.angle_min) / self.angle_increment)


def parameters_of(given: Mapping[str, Any]) -> Dict[str, Any]:
    """Return all parameters of a FlattenConfig, with defaults for missing values.

    A text instead of a number becomes the default, too. Such a text is an argument that roslaunch has not
    replaced, for example `$(arg min)`.
    """
    values: Dict[str, Any] = {}
    for name, default in asdict(FlattenConfig()).items():
        value = given.get(name, default)
        is_text_for_number = isinstance(value, str) and not isinstance(default, str)
        values[name] = default if is_text_for_number else value
    return values


def flatten(points: np.ndarray, config: FlattenConfig) -> np.ndarray:
    """Return the distance of the nearest point in each direction, seen from above, (M,) [m].

    `points` are (N, 3) [m] in the scan's frame.
    """
    count = config.directions
    # range of a direction without a point: inf, or a range that is too long to be valid
    no_point = np.inf if config.use_inf else config.range_max + config.inf_epsilon
    ranges = np.full(count, no_point)
    x, y, z = points.T
    distance, angle = np.hypot(x, y), np.arctan2(y, x)
    inside = (z >= config.min_height) & (z <= config.max_height)
    inside &= (distance >= config.range_min) & (distance <= config.range_max)
    inside &= (angle >= config.angle_min) & (angle <= config.angle_max)
    # for each point inside, index in `ranges` of the direction in which the point lies
    index = ((angle[inside] - config.angle_min) / config.angle_increment).astype(int)
    index = np.minimum(index, count - 1)  # an angle of exactly `angle_max` belongs to the last direction
    # the nearest point in each direction counts; without `at`, only one of its points would count
    np.minimum.at(ranges, index, distance[inside])
    return ranges
