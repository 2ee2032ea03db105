"""Finds pillars in a lidar scan.

In: one `Scan`. Out: the pillars in it, in the laser's own frame.
Must not know: ROS, PyBullet, how the lidar is mounted, what the robot does next.

A pillar is not the nearest return. It is a run of neighbouring beams that lie on a circle of the expected
radius, look more like a circle than like straight walls, and are framed by beams that pass where a pillar
lets them pass. All runs of a scan are judged at once, one row each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, inf, log, sin
from typing import List, Optional, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import Pillar, Scan
from husky_highlevel_controller.fitting import Circles, Runs, fit_circles, straight_misfits


@dataclass(frozen=True)
class PillarConfig:
    """What counts as a pillar."""

    pillar_radius: float = field(
        default=0.2, metadata={"min": 0.02, "max": 2.0, "help": "radius of the pillar looked for [m]"}
    )
    radius_tolerance: float = field(
        default=0.05, metadata={"min": 0.001, "max": 1.0, "help": "how far a measured radius may be off [m]"}
    )
    max_residual: float = field(
        default=0.05,
        metadata={"min": 0.001, "max": 0.5, "help": "largest root mean square distance from the circle [m]"},
    )
    range_noise: float = field(
        default=0.003,
        metadata={"min": 0.0001, "max": 0.2, "help": "differences in range not worth explaining [m]"},
    )
    min_beams: int = field(
        default=2, metadata={"min": 2, "max": 100, "help": "fewest beams that make a pillar"}
    )


# By how much a rival shape must explain the ranges better before it wins: logarithm of the ratio of squares,
# times the beams to spare. Measured with 8 beams: at 30 mm noise 1 % of pillars lose to a corner at this
# setting, at 1 mm less than 1 % of boxes escape; with more beams the two part quickly.
_LINE_ODDS = 4.0
_CORNER_ODDS = 1.0  # for each beam
_HIDDEN_ODDS = 2.0  # by which a circle must beat a line where part of the silhouette is hidden
_MAX_SKIPPED = 2  # beams without a return that a pillar may have between two with one


def find_pillars(scan: Scan, config: PillarConfig) -> List[Pillar]:
    """The pillars in a scan, nearest first.

    Args:
        scan: one sweep, of any field of view and number of beams.
        config: what counts as a pillar.

    Returns:
        Pillars in the laser's frame; empty when there is none. Those of few beams (far away) may turn out
        to be something else from nearer by.
    """
    beams, starts, counts = cluster(scan, config)
    runs = _plausible(scan, config, beams, starts, counts)
    if runs is None:
        return []
    circles = fit_circles(runs, config.pillar_radius, config.range_noise)
    round_ones = np.flatnonzero(
        (circles.residual <= config.max_residual)
        & (np.abs(circles.radius - config.pillar_radius) <= config.radius_tolerance)
        & (np.abs(circles.free_radius - config.pillar_radius) <= config.radius_tolerance + circles.free_slack)
    )
    if not len(round_ones):
        return []
    if len(round_ones) < len(runs.beams):
        runs = Runs(*(each[round_ones] for each in runs))
        circles = Circles(*(each[round_ones] for each in circles))
    pillars = [
        Pillar(distance * cos(bearing), distance * sin(bearing), radius, beams, residual)
        for distance, bearing, radius, residual, beams, good in zip(
            circles.distance.tolist(), circles.bearing.tolist(), circles.radius.tolist(),
            circles.residual.tolist(), runs.beams.tolist(), _stand_out(scan, runs, circles, config),
        )
        if good
    ]  # fmt: skip
    return sorted(_distinct(pillars), key=lambda pillar: pillar.distance)


def _stand_out(scan: Scan, runs: Runs, circles: Circles, config: PillarConfig) -> List[bool]:
    """Which circles explain their beams better than straight things would, and are framed as a pillar is."""

    def lead(circle: float, rival: float, spent: int, beams: int) -> float:
        floor = beams * config.range_noise**2
        return max(beams - spent, 1) * log((circle + floor) / (rival + floor))

    good = []
    for beams, circle, line, corner, missing, hidden in zip(
        runs.beams.tolist(), circles.misfit.tolist(),
        *(each.tolist() for each in (*straight_misfits(runs), *_silhouette(scan, circles, config))),
    ):  # fmt: skip
        good.append(
            lead(circle, line, 2, beams) < (-_HIDDEN_ODDS if hidden > 0 else _LINE_ODDS)
            and (corner == inf or lead(circle, corner, 5, beams) < _CORNER_ODDS * beams)
            and missing <= beams // 10
        )
    return good


def cluster(scan: Scan, config: PillarConfig) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split the valid beams into runs that may lie on one thing.

    Args:
        scan: one sweep.
        config: the pillar's size says how far apart neighbours may be.

    Returns:
        The beams that belong to runs (V,), where in them each run starts (K,), and its length (K,).
    """
    ranges, step = scan.ranges, abs(scan.angle_increment)
    largest = config.pillar_radius + config.radius_tolerance

    def apart(left: np.ndarray, right: np.ndarray) -> np.ndarray:
        near = np.minimum(ranges[left], ranges[right])
        spacing = (right - left) * step * near
        # depth of a circle between its edge and a beam one spacing further in: no two neighbours differ more
        depth = np.sqrt(np.maximum(2.0 * largest - spacing, 0.0) * spacing)
        depth = np.where(spacing < largest, depth, largest) + 2.0 * config.max_residual
        return (
            (np.abs(ranges[right] - ranges[left]) > depth)
            | (spacing > 2.0 * largest)
            | (right - left > _MAX_SKIPPED + 1)
        )

    beams = np.flatnonzero(scan.valid)
    if not len(beams):
        return beams, beams, beams
    breaks = apart(beams[:-1], beams[1:])
    alone = 1 + np.flatnonzero(breaks[:-1] & breaks[1:])
    speckle = alone[~apart(beams[alone - 1], beams[alone + 1])]
    if len(speckle):
        beams = np.delete(beams, speckle)
        breaks = apart(beams[:-1], beams[1:])
    edges = np.concatenate(([0], 1 + np.flatnonzero(breaks), [len(beams)]))
    return beams, edges[:-1], edges[1:] - edges[:-1]


def _plausible(
    scan: Scan, config: PillarConfig, beams: np.ndarray, starts: np.ndarray, counts: np.ndarray
) -> Optional[Runs]:
    """The runs no wider and no deeper than a pillar there would be; None when there is none."""
    if not len(beams) or scan.angle_increment == 0.0:
        return None
    step, ranges = scan.angle_increment, scan.ranges[beams]
    largest = config.pillar_radius + config.radius_tolerance
    near, far = np.minimum.reduceat(ranges, starts), np.maximum.reduceat(ranges, starts)
    width = (beams[starts + counts - 1] - beams[starts]) * abs(step)
    keep = np.flatnonzero(
        (counts >= config.min_beams)
        & (width <= 2.0 * np.arcsin(largest / (near + largest)) + abs(step))
        & (far - near <= largest + 4.0 * config.max_residual)
    )
    if not len(keep):
        return None
    starts, counts = starts[keep], counts[keep]
    column = np.arange(counts.max())
    mask = column < counts[:, None]
    index = beams[np.where(mask, starts[:, None] + column, starts[:, None])]
    middle = 0.5 * (index[:, 0] + beams[starts + counts - 1])
    return Runs(
        middle=scan.angle_min + middle * step,
        near=near[keep],
        ranges=scan.ranges[index],
        angles=(index - middle[:, None]) * step,
        mask=mask.astype(float),
        beams=counts,
    )


def _silhouette(scan: Scan, circles: Circles, config: PillarConfig) -> Tuple[np.ndarray, np.ndarray]:
    """Beams that should have met each circle: how many passed through it (K,), how many are hidden (K,)."""
    step = scan.angle_increment
    inner = np.maximum(0.9 * circles.radius - 2.0 * circles.residual, 0.0)
    half = np.arcsin(np.minimum(inner / np.maximum(circles.distance, 1e-9), 1.0))
    centre = np.rint((circles.bearing - scan.angle_min) / step).astype(int)
    reach = int(half.max() / abs(step)) + 1
    index = centre[:, None] + np.arange(-reach, reach + 1)
    psi = scan.angle_min + index * step - circles.bearing[:, None]
    should = np.abs(psi) <= half[:, None]
    inside = (index >= 0) & (index < len(scan.ranges))
    ranges = np.where(inside, scan.ranges.take(index, mode="clip"), np.nan)
    across = np.minimum(np.abs(circles.distance[:, None] * np.sin(psi)), circles.radius[:, None])
    predicted = circles.distance[:, None] * np.cos(psi) - np.sqrt(circles.radius[:, None] ** 2 - across**2)
    slack = 4.0 * config.max_residual
    beside = np.abs(psi) <= half[:, None] + abs(step)
    seen = ranges >= predicted - slack
    return (should & (ranges > predicted + slack)).sum(axis=1), (beside & ~seen).sum(axis=1)


def _distinct(pillars: List[Pillar]) -> List[Pillar]:
    """Without those that stand inside another of more beams (one pillar seen in two pieces)."""
    kept: List[Pillar] = []
    for one in sorted(pillars, key=lambda pillar: -pillar.beams):
        if all(np.hypot(one.x - other.x, one.y - other.y) > other.radius for other in kept):
            kept.append(one)
    return kept
