"""Random scenarios from a seed: whole runs, and single scans.

In: numbers and a seed. Out: `Scenario`s to drive, `PillarScan`s to analyse; number n of a seed never changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, pi, sin
from typing import List, Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.course import PILLAR_NAME, PILLAR_RADIUS, course_world
from husky_highlevel_controller.datatypes import Pose2D, Scan, World
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.models.sdf_world import load_world
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig
from husky_highlevel_controller.simulator.simulator_config import simulator_config

Disc = Tuple[float, float, float]  # x, y, radius [m], in the laser's frame
Wall = Tuple[float, float, float, float]  # x1, y1, x2, y2 [m], in the laser's frame

_NEAREST_START, _FARTHEST_START = 2.0, 25.0  # [m], base_link to the pillar's centre
_NEAREST_LOOK, _FARTHEST_LOOK = 0.6, 25.0  # [m], lidar to the pillar's centre
_FREE = 0.3  # [m], a pillar nearer to a wall is part of it
_SIDE = 2.3  # [rad], to either side: the pillar is in the Husky's view
_EDGE = 0.05  # [rad], from the last beam of a lidar that sees less


@dataclass(frozen=True)
class Scenario:
    """A run: a world, a start, a seed of all noise."""

    name: str
    world: World
    start: Pose2D  # of base_link in the world
    seed: int = 0
    pillar: str = PILLAR_NAME  # name of the body to drive to


SICK = simulator_config().lidar


@dataclass(frozen=True, eq=False)
class PillarScan:
    """Scan, and the pillar to be found in it."""

    scan: Scan
    pillar: Optional[Disc]


# ---------------------------------------------------------------------------- runs


def course_scenario(seed: int = 0) -> Scenario:
    """The course's own: from the origin to the pillar at (20, 5)."""
    return Scenario("course", load_world(course_world()), Pose2D(), seed)


def random_starts(count: int, seed: int) -> List[Scenario]:
    """The course's world, started anywhere 2-25 m around its pillar, whichever way the robot faces."""
    course = course_scenario()
    (pillar,) = (body for body in course.world.bodies if body.name == course.pillar)
    x, y, _ = pillar.pose_in_world.position
    scenarios = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        distance, bearing = rng.uniform(_NEAREST_START, _FARTHEST_START), rng.uniform(-pi, pi)
        start = Pose2D(x + distance * cos(bearing), y + distance * sin(bearing), rng.uniform(-pi, pi))
        scenarios.append(Scenario(f"start {number}", course.world, start, int(rng.integers(2**31))))
    return scenarios


# ---------------------------------------------------------------------------- scans in closed form


def box(x: float, y: float, yaw: float, length: float, width: float) -> Tuple[Wall, ...]:
    """The four sides of a rectangle centred at (x, y)."""
    corners = [
        (
            x + cos(yaw) * a * length / 2 - sin(yaw) * b * width / 2,
            y + sin(yaw) * a * length / 2 + cos(yaw) * b * width / 2,
        )
        for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    return tuple(corners[i] + corners[(i + 1) % 4] for i in range(4))


def room(size: float, yaw: float, x: float = 0.0, y: float = 0.0) -> Tuple[Wall, ...]:
    """Four walls around the lidar."""
    return box(x, y, yaw, size, size)


def cast(
    circles: Sequence[Disc] = (), segments: Sequence[Wall] = (), lidar: LidarConfig = SICK
) -> Tuple[np.ndarray, np.ndarray]:
    """Distance to the first body each beam meets, (N,) [m], and which it is, (N,).

    Circles are numbered first, then segments; nothing is inf and -1.
    """
    bearings = np.linspace(-lidar.angle_max, lidar.angle_max, lidar.beams)
    c, s = np.cos(bearings), np.sin(bearings)
    hits = [np.full(lidar.beams, np.inf)]
    with np.errstate(divide="ignore", invalid="ignore"):
        for x, y, radius in circles:
            along, across = x * c + y * s, x * s - y * c
            near = along - np.sqrt(radius**2 - across**2)
            hits.append(np.where(near > 0.0, near, np.inf))
        for x1, y1, x2, y2 in segments:
            dx, dy = x2 - x1, y2 - y1
            cross = c * dy - s * dx
            distance, share = (x1 * dy - y1 * dx) / cross, (x1 * s - y1 * c) / cross
            hits.append(np.where((distance > 0.0) & (share >= 0.0) & (share <= 1.0), distance, np.inf))
    table = np.array(hits)
    return table.min(axis=0), table.argmin(axis=0) - 1


def scan_of(ranges: np.ndarray, lidar: LidarConfig = SICK) -> Scan:
    """The numbers as a scan, too far and too close marked as REP 117 says."""
    ranges = np.asarray(ranges, dtype=float)
    with np.errstate(invalid="ignore"):
        ranges = np.where(ranges >= lidar.range_max, np.inf, ranges)
        ranges = np.where(ranges <= lidar.range_min, -np.inf, ranges)
    edge = lidar.angle_max
    return Scan(0.0, load_robot().lidar_mount.frame, -edge, edge, lidar.range_min, lidar.range_max, ranges)


# ---------------------------------------------------------------------------- random scans


def pillar_scene(number: int, seed: int, clutter: bool = False, lidar: LidarConfig = SICK) -> PillarScan:
    """A scan with a pillar 0.6-25 m away, at any bearing in view, that three beams or more fall on.

    Args:
        number: of the scene; same number, same scene.
        seed: of everything random.
        clutter: whether other bodies stand around, some in front of the pillar, none nearer than 0.3 m.
        lidar: beams, range and noise.
    """
    rng, side = np.random.default_rng([seed, 1, number]), min(_SIDE, lidar.angle_max - _EDGE)
    while True:
        distance, bearing = rng.uniform(_NEAREST_LOOK, _FARTHEST_LOOK), rng.uniform(-side, side)
        pillar = (distance * cos(bearing), distance * sin(bearing), PILLAR_RADIUS)
        circles, segments = _clutter(rng) if clutter else ([], [])
        ranges, shapes = cast([pillar, *circles], segments, lidar)
        if (shapes == 0).sum() >= 3 and _clearance(pillar, circles, segments) >= _FREE:
            return PillarScan(scan_of(ranges + rng.normal(0.0, lidar.noise, lidar.beams), lidar), pillar)


def bare_scene(number: int, seed: int, lidar: LidarConfig = SICK) -> PillarScan:
    """A scan of boxes, walls, corners, goal posts and rooms with some speckle, and no pillar."""
    rng = np.random.default_rng([seed, 2, number])
    ranges = cast(*_clutter(rng), lidar)[0] + rng.normal(0.0, lidar.noise, lidar.beams)
    ranges = np.where(rng.random(lidar.beams) < 0.005, rng.uniform(0.2, 29.0, lidar.beams), ranges)
    return PillarScan(scan_of(ranges, lidar), None)


def _clearance(pillar: Disc, circles: Sequence[Disc], segments: Sequence[Wall]) -> float:
    """Gap between the pillar's surface and the nearest other body [m]."""
    x, y, radius = pillar
    gaps = [hypot(x - other[0], y - other[1]) - other[2] for other in circles]
    for x1, y1, x2, y2 in segments:
        dx, dy = x2 - x1, y2 - y1
        share = min(max(((x - x1) * dx + (y - y1) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        gaps.append(hypot(x - x1 - share * dx, y - y1 - share * dy))
    return min(gaps, default=inf) - radius


def _clutter(rng: np.random.Generator) -> Tuple[List[Disc], List[Wall]]:
    """Bodies, one to three, 0.8-18 m away."""
    circles: List[Disc] = []
    segments: List[Wall] = []
    for _ in range(rng.integers(1, 4)):
        distance, bearing = rng.uniform(0.8, 18.0), rng.uniform(-_SIDE, _SIDE)
        x, y, yaw = distance * cos(bearing), distance * sin(bearing), rng.uniform(-pi, pi)
        kind = rng.integers(5)
        if kind == 0:
            segments += box(x, y, yaw, rng.uniform(0.1, 1.5), rng.uniform(0.1, 1.5))
        elif kind == 1:  # a wall
            segments += box(x, y, yaw, rng.uniform(0.1, 8.0), 0.01)
        elif kind == 2:  # a corner
            turns = (yaw, yaw + rng.uniform(0.8, 2.4))
            segments += [(x, y, x + 2.0 * cos(turn), y + 2.0 * sin(turn)) for turn in turns]
        elif kind == 3:  # a goal: the posts of robocup14_spl_field, 1.6 m apart
            circles += [(x, y, 0.05), (x - 1.6 * sin(yaw), y + 1.6 * cos(yaw), 0.05)]
        else:
            segments += room(rng.uniform(4.0, 40.0), yaw)
    return circles, segments
