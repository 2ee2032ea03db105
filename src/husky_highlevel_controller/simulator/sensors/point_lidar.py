"""Simulated 3D lidar: rings of beams at fixed elevations, as a grid of points.

In: the robot's true pose, a function that casts rays, a random generator. Out: points in the lidar's frame.

A ring has the beams of one elevation (angle above the horizon), and a column has the beams of one azimuth
(direction seen from above). The beams of two opposite columns lie in one upright plane. So the ray caster of
the planar lidar measures both columns in one cast.
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
        """Raise ValueError if a column has no opposite column, because the number of columns is odd."""
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
        # 1. The upright planes, one for each column of the first half turn. A plane also has the opposite
        # column. The frame of a plane is turned about x by 90 degrees, so that its y axis points upwards, and
        # then about z by the azimuth of the column, so that its x axis points along the column.
        half = config.columns // 2
        azimuths = 2.0 * pi / config.columns * np.arange(half)
        self._planes: List[Pose] = [
            Pose((0.0, 0.0, 0.0), quat_from_rpy(pi / 2.0, 0.0, azimuth)) for azimuth in azimuths
        ]
        # 2. The angles of the beams in a plane, within -pi to pi. The beams of the column come first, and
        # their angles are the elevations. Then come the beams of the opposite column. For example, a beam
        # that looks up by 10 degrees has the angle 170 there, and a beam that looks down by 10 has -170.
        elevations = np.linspace(-config.elevation_max, config.elevation_max, config.rings)
        opposite_angles = np.where(elevations > 0.0, pi, -pi) - elevations
        angles = np.append(elevations, opposite_angles)  # shape (2 * rings,)
        self._order = np.argsort(angles)  # ray casting needs ascending angles
        self._beams = beams_at(angles[self._order])
        # 3. the unit vectors of all beams in the lidar's frame, (rings, columns, 3)
        all_azimuths = np.append(azimuths, azimuths + pi)
        horizontal, vertical = np.cos(elevations)[:, None], np.sin(elevations)[:, None]
        self._directions = np.stack(
            [
                horizontal * np.cos(all_azimuths),
                horizontal * np.sin(all_azimuths),
                vertical * np.ones(config.columns),
            ],
            axis=-1,
        )

    def reset(self, rng: np.random.Generator) -> None:
        """Restart with noise from `rng`."""
        self._rng = rng

    def sample(self, state: RobotState) -> np.ndarray:
        """Return the points that the lidar measures now, in its frame, (rings, columns, 3) [m].

        The lowest ring comes first. A point is NaN if its beam meets nothing.
        """
        config, rings = self._config, self._config.rings
        pose_lidar_in_world = compose(state.pose_in_world, self._pose_in_base)
        # Ranges of the beams, with one column of this array for each plane. A plane has two columns of the
        # lidar: one is in the first half of the rows, and the opposite one is in the second half.
        ranges_of_planes = np.empty((2 * rings, len(self._planes)))
        for column, plane in enumerate(self._planes):
            pose_plane_in_world = compose(pose_lidar_in_world, plane)
            sorted_ranges = self._cast_rays(pose_plane_in_world, self._beams, config.range_max)
            # the beams are sorted by their angles; `_order` puts their ranges back in the order of the rows
            ranges_of_planes[self._order, column] = sorted_ranges
        # the opposite columns have azimuths from 180 to 360 degrees, so they come after the others
        ranges = np.hstack([ranges_of_planes[:rings], ranges_of_planes[rings:]])  # (rings, columns)
        # the true range decides whether there is a point, and then noise is added
        ranges[~((ranges >= config.range_min) & (ranges < config.range_max))] = np.nan
        ranges += self._rng.normal(0.0, config.noise, ranges.shape)
        points: np.ndarray = ranges[:, :, None] * self._directions
        return points
