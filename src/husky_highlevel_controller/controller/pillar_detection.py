"""Pillar detection in a lidar scan: segmentation, circle fit, rival shapes.

In: one `Scan`. Out: the pillars in it, in the laser's own frame.

A pillar is not the nearest return. It is a segment of neighbouring beams that lie on a circle of the expected
radius, look more like a circle than like straight walls, and are framed by beams that pass where a pillar
lets them pass.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import asin, atan2, ceil, cos, floor, hypot, inf, isfinite, log, nan, sin, sqrt
from typing import Callable, List, Optional, Tuple

import numpy as np

from husky_highlevel_controller.controller.circle_fit import (
    Circle,
    Segment,
    Segments,
    corner_sum_squared_error,
    fit_circle,
    line_sum_squared_error,
)
from husky_highlevel_controller.controller.circle_screen import Limits, may_be_pillars
from husky_highlevel_controller.datatypes import Pillar, Scan


@dataclass(frozen=True)
class PillarConfig:
    """Limits of a pillar: size, number of beams, clearance."""

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
_HOPELESS = 3.0  # times the largest residual: an algebraic fit as bad as this is not refined
_FEW_SEGMENTS = 8  # up to so many are fitted without a screen: find_pillars takes a tenth of the time
MAX_FITS = 24  # exact fits for one scan; they bound the time that clutter takes
_MANY_EXPECTED = 100  # more beams than this on a silhouette are compared by arrays
_FEW_SUSPECTS = 40  # up to so many neighbours that differ are compared one by one: saves a third of the time
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
    if not (0.0 < abs(scan.angle_increment) < inf and isfinite(scan.angle_min)):
        return []  # beams without a direction
    pillars = []
    for segment in _candidates(scan, config):
        pillar = _judge(scan, config, segment)
        if pillar is not None:
            pillars.append(pillar)
    if len(pillars) < 2:
        return pillars
    return sorted(_distinct(pillars), key=lambda pillar: pillar.distance)


def _candidates(scan: Scan, config: PillarConfig) -> List[Segment]:
    """The segments worth an exact fit; of clutter the nearest ones, at most `MAX_FITS`."""
    valid, measured, breaks = _split(scan, config)
    if len(breaks) < _FEW_SEGMENTS:
        runs = _runs(valid, measured, breaks, config.min_beams)
        found = [_plausible(scan, config, beams, ranges) for beams, ranges in runs]
        return [segment for segment in found if segment is not None]
    segments = _plausible_of_many(scan, config, valid, measured, breaks)
    if len(segments.counts) > _FEW_SEGMENTS:
        limits = Limits(
            config.pillar_radius,
            config.radius_tolerance,
            config.max_residual,
            config.range_noise,
            _LINE_ODDS,
            -_HIDDEN_ODDS,
        )
        segments = may_be_pillars(scan, segments, limits)
    if len(segments.counts) > MAX_FITS:
        nearest = np.zeros(len(segments.counts), dtype=bool)
        nearest[np.argsort(segments.near, kind="stable")[:MAX_FITS]] = True
        segments = segments.those(nearest)
    return segments.one_by_one()


def cluster(scan: Scan, config: PillarConfig) -> List[Tuple[List[int], List[float]]]:
    """Split the valid beams into segments of enough beams, that may each lie on one body.

    Args:
        scan: one sweep.
        config: the pillar's size says how far apart neighbours may be.

    Returns:
        Of each segment the beams, and their ranges [m].
    """
    return _runs(*_split(scan, config), config.min_beams)


def _runs(
    valid: np.ndarray, measured: np.ndarray, breaks: List[int], min_beams: int
) -> List[Tuple[List[int], List[float]]]:
    """Beams and ranges of each segment of enough beams."""
    beams, ranges = valid.tolist(), measured.tolist()
    bounds = zip([0, *breaks], [*breaks, len(beams)])
    return [(beams[start:stop], ranges[start:stop]) for start, stop in bounds if stop - start >= min_beams]


def _split(scan: Scan, config: PillarConfig) -> Tuple[np.ndarray, np.ndarray, List[int]]:
    """The valid beams without speckle, their ranges [m], and where among them another body begins."""
    (valid,) = scan.valid.nonzero()
    measured, step = scan.returns[valid], abs(scan.angle_increment)
    breaks, speckle = _breaks(config, step, valid, measured)
    if speckle:
        valid, measured = np.delete(valid, speckle), np.delete(measured, speckle)
        breaks, _ = _breaks(config, step, valid, measured)
    return valid, measured, breaks


def _breaks(
    config: PillarConfig, step: float, valid: np.ndarray, ranges: np.ndarray
) -> Tuple[List[int], List[int]]:
    """Starts of bodies in `valid`; and single beams that others pass by on both sides."""
    largest, rough = config.pillar_radius + config.radius_tolerance, 2.0 * config.max_residual
    doubtful = (np.abs(ranges[1:] - ranges[:-1]) > rough) | (valid[1:] - valid[:-1] > 1)
    suspects = doubtful.nonzero()[0].tolist()
    if len(suspects) > _FEW_SUSPECTS:
        return _breaks_of_many(config, step, valid, ranges, np.array(suspects))
    beams, depths = valid.tolist(), ranges.tolist()

    def apart(left: int, right: int) -> bool:
        between = beams[right] - beams[left]
        spacing = between * step * max(min(depths[left], depths[right]), 0.0)
        # depth of a circle between its edge and a beam one spacing further in: no two neighbours differ more
        depth = sqrt((2.0 * largest - spacing) * spacing) if spacing < largest else largest
        return abs(depths[right] - depths[left]) > depth + rough or between > _MAX_SKIPPED + 1

    breaks = [left + 1 for left in suspects if apart(left, left + 1)]
    alone = [start for start, stop in zip(breaks, breaks[1:]) if stop == start + 1]
    return breaks, [at for at in alone if not apart(at - 1, at + 1)]


def _breaks_of_many(
    config: PillarConfig, step: float, valid: np.ndarray, ranges: np.ndarray, suspects: np.ndarray
) -> Tuple[List[int], List[int]]:
    """Starts as of `_breaks`, by arrays: sooner done where many neighbours differ."""
    largest, rough = config.pillar_radius + config.radius_tolerance, 2.0 * config.max_residual

    def apart(left: np.ndarray, right: np.ndarray) -> np.ndarray:
        between = valid[right] - valid[left]
        spacing = between * step * np.maximum(np.minimum(ranges[left], ranges[right]), 0.0)
        spacing = np.minimum(spacing, largest)  # at which the depth is the largest radius
        depth = np.sqrt((2.0 * largest - spacing) * spacing)
        jump: np.ndarray = np.abs(ranges[right] - ranges[left]) > depth + rough
        return jump | (between > _MAX_SKIPPED + 1)

    breaks = suspects[apart(suspects, suspects + 1)] + 1
    alone = breaks[:-1][breaks[1:] == breaks[:-1] + 1]
    return breaks.tolist(), alone[~apart(alone - 1, alone + 1)].tolist()


def _plausible(scan: Scan, config: PillarConfig, beams: List[int], ranges: List[float]) -> Optional[Segment]:
    """The segment of these beams, if it is no wider and no deeper than a pillar there would be."""
    near, span, step = min(ranges), beams[-1] - beams[0], abs(scan.angle_increment)
    largest = config.pillar_radius + config.radius_tolerance
    if (
        near <= 0.0  # some drivers' way to say that there is no return
        or span * step > 2.0 * asin(largest / (near + largest)) + step
        or max(ranges) - near > largest + 4.0 * config.max_residual
        or near * step > 2.0 * largest  # beams so far apart show no shape
    ):
        return None
    return Segment(beams, ranges, near, scan.angle_increment)


def _plausible_of_many(
    scan: Scan, config: PillarConfig, valid: np.ndarray, ranges: np.ndarray, breaks: List[int]
) -> Segments:
    """Segments as of `_plausible`, by arrays: sooner done where there are many."""
    starts = np.array([0, *breaks])
    stops = np.array([*breaks, len(valid)])
    counts, step = stops - starts, abs(scan.angle_increment)
    near, far = np.minimum.reduceat(ranges, starts), np.maximum.reduceat(ranges, starts)
    span, largest = valid[stops - 1] - valid[starts], config.pillar_radius + config.radius_tolerance
    ahead = np.maximum(near, 0.0)
    widest = 2.0 * np.arcsin(largest / (ahead + largest)) + step
    plausible = (
        (counts >= config.min_beams)
        & (near > 0.0)
        & (span * step <= widest)
        & (far - ahead <= largest + 4.0 * config.max_residual)
        & (near * step <= 2.0 * largest)
    )
    return Segments(valid, ranges, counts, near, scan.angle_increment).those(plausible)


def _judge(scan: Scan, config: PillarConfig, segment: Segment) -> Optional[Pillar]:
    """The pillar that a segment is, if it is one."""
    radius, tolerance = config.pillar_radius, config.radius_tolerance
    circle = fit_circle(segment, radius, config.range_noise, _HOPELESS * config.max_residual)
    if not (
        circle.x > segment.near  # or it is a niche, which is as round
        and circle.residual <= config.max_residual
        and abs(circle.radius - radius) <= tolerance
        and abs(circle.free_radius - radius) <= tolerance + circle.free_slack
        and _stands_out(scan, config, segment, circle)
    ):
        return None
    middle = scan.angle_min + segment.middle * segment.step
    c, s = cos(middle), sin(middle)
    x, y = c * circle.x - s * circle.y, s * circle.x + c * circle.y
    return Pillar(x, y, circle.radius, len(segment.beams), circle.residual)


def _stands_out(scan: Scan, config: PillarConfig, segment: Segment, circle: Circle) -> bool:
    """Whether a circle beats a line and a corner, and is framed as a pillar is."""
    beams = len(segment.beams)
    missing, hidden = _silhouette(scan, config, segment, circle)
    noise = beams * config.range_noise**2

    def beats(rival: Callable[[Segment], float], spent: int, odds: float) -> bool:
        def lead(sum_squared_error: float) -> float:
            return max(beams - spent, 1) * log(
                (circle.sum_squared_error + noise) / (sum_squared_error + noise)
            )

        return lead(0.0) < odds or lead(rival(segment)) < odds  # mostly not even a perfect rival would win

    return (
        missing <= beams // 10
        and beats(line_sum_squared_error, 2, -_HIDDEN_ODDS if hidden else _LINE_ODDS)
        and (beams <= 5 or beats(corner_sum_squared_error, 5, _CORNER_ODDS * beams))
    )


def _silhouette(scan: Scan, config: PillarConfig, segment: Segment, circle: Circle) -> Tuple[int, int]:
    """Count the beams that pass through a circle they should have met, and the hidden ones."""
    step, beams = abs(segment.step), segment.beams
    distance = hypot(circle.x, circle.y)
    inner = max(0.9 * circle.radius - 2.0 * circle.residual, 0.0)
    half = asin(min(inner / max(distance, 1e-9), 1.0))
    centre = segment.middle + atan2(circle.y, circle.x) / segment.step
    reach, slack = half / step + 1.0, 4.0 * config.max_residual
    expected_to = range(max(ceil(centre - reach), -1), min(floor(centre + reach), len(scan.ranges)) + 1)
    # none of its own is farther off than the root of the sum of squares
    known = beams if circle.sum_squared_error < slack**2 else []
    if len(expected_to) > _MANY_EXPECTED:
        others = np.setdiff1d(np.arange(expected_to.start, expected_to.stop), known)
        psis = (others - centre) * step
        offset = np.minimum(np.abs(distance * np.sin(psis)), circle.radius)
        depth = distance * np.cos(psis) - np.sqrt(circle.radius**2 - offset**2)
        outside = (others < 0) | (others >= len(scan.ranges))
        readings = np.where(outside, nan, scan.returns[np.where(outside, 0, others)])
        passed = (np.abs(psis) <= half) & (readings > depth + slack)
        return int(passed.sum()), int((~(readings >= depth - slack)).sum())
    missing = hidden = 0
    for beam in set(expected_to).difference(known):
        psi = (beam - centre) * step
        across = min(abs(distance * sin(psi)), circle.radius)
        expected = distance * cos(psi) - sqrt(circle.radius**2 - across**2)
        reading = float(scan.returns[beam]) if 0 <= beam < len(scan.ranges) else nan
        missing += abs(psi) <= half and reading > expected + slack
        hidden += not reading >= expected - slack
    return missing, hidden


def _distinct(pillars: List[Pillar]) -> List[Pillar]:
    """Without those that stand inside another of more beams (one pillar seen in two pieces)."""
    kept: List[Pillar] = []
    for one in sorted(pillars, key=lambda pillar: -pillar.beams):
        if all(hypot(one.x - other.x, one.y - other.y) > other.radius for other in kept):
            kept.append(one)
    return kept
