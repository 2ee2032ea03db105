"""Random scenarios from a seed: whole runs, and single scans.

In: numbers and a seed. Out: `Scenario`s to drive, `PillarScan`s to analyse. Number n of a seed never changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, pi, sin
from typing import List, Optional, Sequence, Tuple, Union

import numpy as np

from husky_highlevel_controller.course import PILLAR_NAME, PILLAR_RADIUS, course_world
from husky_highlevel_controller.datatypes import Box, Cylinder, Pose, Pose2D, Scan, World, even_beams
from husky_highlevel_controller.geometry import inverse, pose_from_2d, transform_point
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.models.sdf_world import load_world
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene
from husky_highlevel_controller.simulator.simulator_config import simulator_config

Disc = Tuple[float, float, float]  # x, y, radius [m], in the laser's frame
Solid = Tuple[Union[Box, Cylinder], Pose]  # shape and its pose in the laser's frame

# [m] limits of the random distance between base_link and the pillar's centre at the start of a run
_NEAREST_START, _FARTHEST_START = 2.0, 25.0
# [m] limits of the random distance between the lidar and the pillar's centre in a single scan
_NEAREST_LOOK, _FARTHEST_LOOK = 0.6, 25.0
# [m] smallest gap between the pillar and another object, because a pillar close to a wall looks like a part
# of the wall
_FREE = 0.3
# [rad] largest bearing of random objects to the left or right, so that they are in the Husky's view
_SIDE = 2.3
_THIN = 0.01  # [m] thickness of walls
# [rad] smallest angle between the pillar's centre and the lidar's first or last beam
_EDGE = 0.05
# part of the random seed, so that the scans with a pillar and those without have different random numbers
_WITH_PILLAR, _WITHOUT_PILLAR = 1, 2


@dataclass(frozen=True)
class Scenario:
    """Scenario of a run: a world, a start, a seed of all noise."""

    name: str
    world: World
    start: Pose2D  # pose of base_link in the world
    seed: int = 0
    pillar: str = PILLAR_NAME  # name of the object to which the robot drives


SICK = simulator_config().lidar  # lidar of the Husky


@dataclass(frozen=True, eq=False)
class PillarScan:
    """Scan with at most one pillar."""

    scan: Scan
    pillar: Optional[Disc]  # None if there is no pillar in the scan


def course_scenario(seed: int = 0) -> Scenario:
    """Return the course's own scenario: from the origin to the pillar at (20, 5)."""
    return Scenario("course", load_world(course_world()), Pose2D(), seed)


def random_starts(count: int, seed: int) -> List[Scenario]:
    """Return scenarios in the course's world with random starts, 2-25 m from its pillar, with any yaw."""
    course = course_scenario()
    (pillar,) = [body for body in course.world.bodies if body.name == course.pillar]
    x, y, _ = pillar.pose_in_world.position
    scenarios = []
    for number in range(count):
        # each start has its own generator, so that it does not depend on `count`
        rng = np.random.default_rng([seed, number])
        distance, bearing = rng.uniform(_NEAREST_START, _FARTHEST_START), rng.uniform(-pi, pi)
        start = Pose2D(x + distance * cos(bearing), y + distance * sin(bearing), rng.uniform(-pi, pi))
        noise_seed = int(rng.integers(2**31))
        scenarios.append(Scenario(f"start {number}", course.world, start, seed=noise_seed))
    return scenarios


def scan_of(ranges: np.ndarray, lidar: LidarConfig = SICK) -> Scan:
    """Return a scan with these ranges; as in REP 117, a range is inf if it is too far, -inf if too close."""
    ranges = np.asarray(ranges, dtype=float)
    with np.errstate(invalid="ignore"):  # otherwise a comparison with nan prints a warning
        ranges = np.where(ranges >= lidar.range_max, np.inf, ranges)
        ranges = np.where(ranges <= lidar.range_min, -np.inf, ranges)
    return Scan(
        stamp=0.0,
        frame=load_robot().lidar_mount.frame,
        angle_min=-lidar.angle_max,
        angle_max=lidar.angle_max,
        range_min=lidar.range_min,
        range_max=lidar.range_max,
        ranges=ranges,
    )


def pillar_scene(number: int, seed: int, clutter: bool = False, lidar: LidarConfig = SICK) -> PillarScan:
    """Return a scan with a pillar 0.6-25 m away, at any bearing in view, that at least three beams hit.

    With `clutter` there are other objects, at least 0.3 m from the pillar; some are in front of it.
    """
    rng = np.random.default_rng([seed, _WITH_PILLAR, number])
    side = min(_SIDE, lidar.angle_max - _EDGE)  # [rad] largest bearing at which the pillar is in view
    while True:  # the loop ends as soon as a random scene has the wanted properties
        distance, bearing = rng.uniform(_NEAREST_LOOK, _FARTHEST_LOOK), rng.uniform(-side, side)
        x, y = distance * cos(bearing), distance * sin(bearing)
        pillar = _post(x, y, PILLAR_RADIUS)
        others = _clutter(rng) if clutter else []
        # (N,) [m] ranges of the beams if all objects are there, and if only the pillar is there
        ranges, alone = _cast([pillar, *others], lidar), _cast([pillar], lidar)
        # (N,) true for the beams that hit the pillar and no nearer object; 1e-9 allows for rounding
        is_seen = np.isfinite(alone) & (ranges > alone - 1e-9)
        stands_free = all(_gap((x, y), other) >= PILLAR_RADIUS + _FREE for other in others)
        if is_seen.sum() >= 3 and stands_free:
            noisy = ranges + rng.normal(0.0, lidar.noise, lidar.beams)
            return PillarScan(scan_of(noisy, lidar), (x, y, PILLAR_RADIUS))


def bare_scene(number: int, seed: int, lidar: LidarConfig = SICK) -> PillarScan:
    """Return a scan without a pillar: boxes, walls, corners, goal posts and rooms, with some speckle."""
    rng = np.random.default_rng([seed, _WITHOUT_PILLAR, number])
    ranges = _cast(_clutter(rng), lidar) + rng.normal(0.0, lidar.noise, lidar.beams)
    # speckle: 0.5 % of the beams get a random range
    ranges = np.where(rng.random(lidar.beams) < 0.005, rng.uniform(0.2, 29.0, lidar.beams), ranges)
    return PillarScan(scan_of(ranges, lidar), None)


def _cast(solids: Sequence[Solid], lidar: LidarConfig) -> np.ndarray:
    """Return the distance to the first object that each beam hits, (N,) [m]; inf if it hits no object."""
    beams = even_beams(-lidar.angle_max, lidar.angle_max, lidar.beams)
    return cast_rays(make_scene(solids), Pose(), beams, inf)


def _gap(point: Tuple[float, float], solid: Solid) -> float:
    """Return the distance from a point to the outline of an object [m]; 0 inside."""
    shape, pose = solid
    x, y, _ = transform_point(inverse(pose), (*point, 0.0))  # the point in the object's frame
    if isinstance(shape, Cylinder):
        return max(hypot(x, y) - shape.radius, 0.0)
    length, width, _ = shape.size
    return hypot(max(abs(x) - length / 2.0, 0.0), max(abs(y) - width / 2.0, 0.0))


def _post(x: float, y: float, radius: float) -> Solid:
    """Return an upright cylinder with its axis at (x, y) [m] in the laser's frame."""
    return Cylinder(radius, 1.0), Pose((x, y, 0.0))


def _box(x: float, y: float, yaw: float, length: float, width: float = _THIN) -> Solid:
    """Return a box with its middle at (x, y) [m] in the laser's frame; by default as thin as a wall."""
    return Box((length, width, 1.0)), pose_from_2d(Pose2D(x, y, yaw))


def _clutter(rng: np.random.Generator) -> List[Solid]:
    """Return one to three random objects: objects 0.8-18 m away, or rooms 4-40 m wide around the lidar."""
    solids: List[Solid] = []
    for _ in range(rng.integers(1, 4)):
        distance, bearing = rng.uniform(0.8, 18.0), rng.uniform(-_SIDE, _SIDE)
        x, y, yaw = distance * cos(bearing), distance * sin(bearing), rng.uniform(-pi, pi)
        kind = rng.integers(5)
        if kind == 0:  # a box
            solids.append(_box(x, y, yaw, rng.uniform(0.1, 1.5), rng.uniform(0.1, 1.5)))
        elif kind == 1:  # a wall
            solids.append(_box(x, y, yaw, rng.uniform(0.1, 8.0)))
        elif kind == 2:  # a corner of two walls
            # each wall is 2 m long, so the middle of the wall is 1 m from the corner
            for turn in (yaw, yaw + rng.uniform(0.8, 2.4)):
                solids.append(_box(x + cos(turn), y + sin(turn), turn, 2.0))
        elif kind == 3:  # two posts 1.6 m apart, like the goal in the world robocup14_spl_field
            solids += [_post(x, y, 0.05), _post(x - 1.6 * sin(yaw), y + 1.6 * cos(yaw), 0.05)]
        else:  # four walls around the lidar
            half = rng.uniform(4.0, 40.0) / 2.0  # [m] distance from the lidar to each wall
            for quarter in range(4):
                side = yaw + quarter * pi / 2.0  # [rad] direction from the lidar to the wall
                solids.append(_box(half * cos(side), half * sin(side), side + pi / 2.0, 2.0 * half))
    return solids
