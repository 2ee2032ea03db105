"""Simulated 3D lidar: rings of beams at fixed elevations, as a grid of points.

In: the robot's true pose, a function that casts rays, a random generator. Out: points in the lidar's frame.

The beams of two opposite columns lie in one upright plane. So the ray caster of the planar lidar measures
both columns in one cast.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import List

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.datatypes import Pose, RobotState, beams_at
from husky_highlevel_controller.geometry import compose, quat_from_rpy
from husky_highlevel_controller.simulator.sensors.lidar import CastRays


@dataclass(frozen=True)
class PointsConfig:
    """Rings, columns, range and noise; config/robots/ holds the values."""

    rings: int = number(1, 128, "elevations")
    columns: int = number(4, 4096, "directions of a full turn; an even number")
    elevation_max: float = number(
        0.01, 1.5, "elevation of the highest ring; the lowest has the negative angle [rad]"
    )
    range_min: float = number(0.0, 10.0, "nearer points are omitted [m]")
    range_max: float = number(0.1, 1000.0, "farther points are omitted [m]")
    noise: float = number(0.0, 1.0, "standard deviation [m]")

    def __post_init__(self) -> None:
        """Raise ValueError if opposite columns are not in one plane."""
        if self.columns % 2:
            raise ValueError(f"columns = {self.columns} is not even")


class PointLidar:
    """A 3D lidar on base_link."""

    def __init__(self, config: PointsConfig, cast_rays: CastRays, pose_in_base: Pose) -> None:
        """Prepare the directions of all beams, and the planes in which they are cast.

        Args:
            config: rings, columns, range and noise.
            cast_rays: measures the beams of one plane.
            pose_in_base: pose of the lidar in base_link.
        """
        self._config, self._cast_rays, self._pose_in_base = config, cast_rays, pose_in_base
        # Each upright plane contains a column of beams in the first half turn, and the opposite column. The x
        # axis of the plane's frame points along the azimuth of the first column, and its y axis upwards.
        half = config.columns // 2
        azimuths = 2.0 * pi / config.columns * np.arange(half)
        self._planes: List[Pose] = [
            Pose((0.0, 0.0, 0.0), quat_from_rpy(pi / 2.0, 0.0, azimuth)) for azimuth in azimuths
        ]
        # angles of the beams in a plane, within +-pi: first the elevations of the column, then the opposite
        # column, where the elevation e has the angle pi - e if e is positive, and otherwise -pi - e
        elevations = np.linspace(-config.elevation_max, config.elevation_max, config.rings)
        bearings = np.append(elevations, np.where(elevations > 0.0, pi, -pi) - elevations)
        self._order = np.argsort(bearings)  # ray casting needs ascending angles
        self._beams = beams_at(bearings[self._order])
        # unit vectors of all beams in the lidar's frame, (rings, columns, 3)
        all_azimuths = np.append(azimuths, azimuths + pi)
        horizontal = np.cos(elevations)[:, None]
        self._directions = np.stack(
            [
                horizontal * np.cos(all_azimuths),
                horizontal * np.sin(all_azimuths),
                np.sin(elevations)[:, None] * np.ones(2 * half),
            ],
            axis=-1,
        )

    def reset(self, rng: np.random.Generator) -> None:
        """Restart with noise from `rng`."""
        self._rng = rng

    def sample(self, state: RobotState) -> np.ndarray:
        """Return the points (rings, columns, 3) [m] now, lowest ring first; NaN for beams that meet nothing.

        One cast measures a column of beams and the column on the opposite side, because both are in one
        upright plane. So there are half as many casts as columns.
        """
        config, rings = self._config, self._config.rings
        pose = compose(state.pose_in_world, self._pose_in_base)
        # For each plane, this array has the ranges of both columns of beams below one another: in the first
        # half of the rows those of the first half turn, in the second half those of the opposite column.
        ranges = np.empty((2 * rings, len(self._planes)))
        for column, plane in enumerate(self._planes):
            # the beams are cast in the order of their angles, and `_order` puts their ranges back in place
            ranges[self._order, column] = self._cast_rays(compose(pose, plane), self._beams, config.range_max)
        # the opposite columns are the second half turn, so they come behind the first half
        ranges = np.hstack([ranges[:rings], ranges[rings:]])
        # the true range decides whether there is a point, and then noise is added
        ranges[~((ranges >= config.range_min) & (ranges < config.range_max))] = np.nan
        ranges += self._rng.normal(0.0, config.noise, ranges.shape)
        points: np.ndarray = ranges[:, :, None] * self._directions
        return points
