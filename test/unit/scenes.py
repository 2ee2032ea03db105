"""Scans of flat scenes in closed form: circles and straight pieces, no physics engine."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import Scan

Circle = Tuple[float, float, float]  # x, y, radius [m], in the laser's frame
Segment = Tuple[float, float, float, float]  # x1, y1, x2, y2 [m], in the laser's frame


@dataclass(frozen=True)
class Lidar:
    """The reference lidar unless told otherwise (SICK LMS1xx description, lms1xx 0.3.0)."""

    beams: int = 720
    angle_max: float = 2.35619  # [rad], and minus that on the other side
    range_min: float = 0.1  # [m]
    range_max: float = 30.0  # [m]


SICK = Lidar()


def box(x: float, y: float, yaw: float, length: float, width: float) -> Tuple[Segment, ...]:
    """The four sides of a rectangle centred at (x, y)."""
    corners = [
        (
            x + cos(yaw) * a * length / 2 - sin(yaw) * b * width / 2,
            y + sin(yaw) * a * length / 2 + cos(yaw) * b * width / 2,
        )
        for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    return tuple(corners[i] + corners[(i + 1) % 4] for i in range(4))


def cast(
    circles: Sequence[Circle] = (), segments: Sequence[Segment] = (), lidar: Lidar = SICK
) -> Tuple[np.ndarray, np.ndarray]:
    """Distance to the first thing each beam meets, (N,) [m], and which it is, (N,).

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


def scan_of(ranges: np.ndarray, lidar: Lidar = SICK) -> Scan:
    """The numbers as a scan, too far and too close marked as REP 117 says."""
    ranges = np.asarray(ranges, dtype=float)
    with np.errstate(invalid="ignore"):
        ranges = np.where(ranges >= lidar.range_max, np.inf, ranges)
        ranges = np.where(ranges <= lidar.range_min, -np.inf, ranges)
    edge = lidar.angle_max
    return Scan(0.0, "front_laser", -edge, edge, lidar.range_min, lidar.range_max, ranges)


def look(
    circles: Sequence[Circle] = (),
    segments: Sequence[Segment] = (),
    lidar: Lidar = SICK,
    noise: float = 0.001,
    rng: Optional[np.random.Generator] = None,
) -> Scan:
    """One sweep over the scene; `noise` is the standard deviation of a range [m] (none without `rng`)."""
    ranges, _ = cast(circles, segments, lidar)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, noise, lidar.beams)
    return scan_of(ranges, lidar)


def room(size: float, yaw: float, x: float = 0.0, y: float = 0.0) -> Tuple[Segment, ...]:
    """Four walls around the lidar."""
    return box(x, y, yaw, size, size)


def any_angle(rng: np.random.Generator) -> float:
    """A direction [rad]."""
    return float(rng.uniform(-pi, pi))
