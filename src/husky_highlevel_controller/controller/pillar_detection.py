"""Pillar detection in a lidar scan: segmentation, circle fit, and a comparison with lines and corners.

In: one `Scan`. Out: the pillars in it, in the laser's own frame.

A pillar is not the nearest return. It is a segment of neighbouring beams that lie on a circle of the expected
radius, look more like a circle than like straight walls, and have beams at both sides that pass the circle.
"""

from __future__ import annotations

from math import asin, atan2, ceil, cos, floor, hypot, inf, isfinite, log, sin
from typing import List, NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.controller.circle_fit import (
    Circle,
    Segment,
    Segments,
    corner_sum_squared_error,
    fit_circle,
    line_sum_squared_error,
)
from husky_highlevel_controller.controller.circle_screen import (
    HIDDEN_ODDS,
    HIT_SLACK,
    INNER_PART,
    INNER_RESIDUALS,
    LINE_ODDS,
    PillarConfig,
    may_be_pillars,
)
from husky_highlevel_controller.datatypes import Scan


class Pillar(NamedTuple):
    """A pillar seen in one scan."""

    x: float  # [m] x of the pillar's centre in the laser's frame
    y: float  # [m] y of the pillar's centre in the laser's frame
    radius: float  # [m]
    beams: int  # number of beams that hit the pillar
    residual: float  # [m] root mean square distance of the beams' end points from the circle

    @property
    def bearing(self) -> float:
        """Direction of the centre in the laser's frame [rad]."""
        return atan2(self.y, self.x)

    @property
    def distance(self) -> float:
        """Distance from the laser to the near surface [m]."""
        return hypot(self.x, self.y) - self.radius


# A segment is the corner of a box and not a pillar if the lead of a corner over the circle (see LINE_ODDS) is
# at least this number times the number of beams
_CORNER_ODDS = 1.0
# if a scan has at most this many segments, all are fitted exactly without the coarse test, because this test
# takes as long as a few fits
_UNSCREENED = 8
# at most this many segments of a scan are fitted exactly, so that a scan of many objects does not take too
# long
MAX_FITS = 24
_MAX_SKIPPED = 2  # two beams may lie on one pillar if at most this many beams between them have no return


def find_pillars(scan: Scan, config: PillarConfig) -> List[Pillar]:
    """Return the pillars of a scan in the laser's frame, nearest first.

    Few beams hit a far object, so a pillar that is far away may turn out to be another object when the robot
    comes closer.
    """
    # the directions of the beams are not known if they all have the same angle, or an angle is not finite
    has_directions = 0.0 < abs(scan.angle_increment) < inf and isfinite(scan.angle_min)
    if not has_directions or not scan.valid_count:
        return []
    pillars = []
    for segment in _candidates(scan, config).one_by_one():
        pillar = _pillar_of(scan, config, segment)
        if pillar is not None:
            pillars.append(pillar)
    return sorted(_distinct(pillars), key=lambda pillar: pillar.distance)


def _candidates(scan: Scan, config: PillarConfig) -> Segments:
    """Return the segments of a scan that may be pillars and get an exact fit, at most the nearest `MAX_FITS`.

    Quick tests reject the other segments, because an exact fit takes long.
    """
    segments = cluster(scan, config)
    segments = segments.select(_plausible(segments, config))
    # this coarse test would take longer than the exact fits of a few segments
    if len(segments.counts) > _UNSCREENED:
        segments = may_be_pillars(scan, segments, config)
    if len(segments.counts) > MAX_FITS:
        nearest = np.zeros(len(segments.counts), dtype=bool)
        nearest[np.argsort(segments.near, kind="stable")[:MAX_FITS]] = True
        segments = segments.select(nearest)
    return segments


def cluster(scan: Scan, config: PillarConfig) -> Segments:
    """Split the valid beams of a scan into segments that may each lie on one body.

    The pillar's size limits the distance between neighbours in a segment. If a single beam between two beams
    on a body meets another object, this single beam is omitted, so that the body stays one segment. The scan
    must have a valid beam.
    """
    (beams,) = scan.valid.nonzero()
    ranges = scan.returns[beams]
    starts, single = _starts_of_bodies(config, abs(scan.angle_increment), beams, ranges)
    if len(single):
        # without the single beams, the beams on their two sides become neighbours
        beams, ranges = np.delete(beams, single), np.delete(ranges, single)
        starts, _ = _starts_of_bodies(config, abs(scan.angle_increment), beams, ranges)
    # each segment ends where the next one begins, and the last segment ends at the last beam
    counts = np.concatenate((starts[1:], (len(beams),))) - starts
    return Segments(beams, ranges, counts, np.minimum.reduceat(ranges, starts), scan.angle_increment)


def _largest_depth(spacing: np.ndarray, radius: float) -> np.ndarray:
    """Return the largest possible difference of the ranges of two beams on one pillar [m].

    The difference is largest if one beam just touches the edge of the circle. This beam passes the centre at
    the distance `radius`, and the other beam passes it at radius - spacing. By Pythagoras, the other beam
    meets the circle earlier by sqrt(radius^2 - (radius - spacing)^2) = sqrt((2 radius - spacing) spacing).

    Args:
        spacing: distances between the two beams [m]; above one radius, the difference no longer grows.
        radius: radius of the pillar [m].
    """
    spacing = np.minimum(spacing, radius)
    depth: np.ndarray = np.sqrt((2.0 * radius - spacing) * spacing)
    return depth


def _starts_of_bodies(
    config: PillarConfig, step: float, beams: np.ndarray, ranges: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Find where one body ends in a row of beams and the next body begins.

    Two neighbouring beams are on two bodies if their ranges differ too much for beams on one pillar.

    Args:
        config: size of the pillar.
        step: angle between neighbouring beams [rad].
        beams: indices of the valid beams in the scan, ascending (B,).
        ranges: their ranges (B,) [m].

    Returns:
        Indices in `beams` at which bodies begin, and indices in `beams` of beams to omit. A beam to omit is
        the only beam on its body, and lies between two beams that may be on one pillar. If there are beams to
        omit, `cluster` calls this function again without them.
    """
    radius = config.pillar_radius + config.radius_tolerance  # [m] largest radius that a pillar may have
    noise = 2.0 * config.max_residual  # [m] largest difference of two ranges that noise makes

    def on_two_bodies(left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return a mask of pairs of beams that cannot be on one pillar; a pair is two indices in `beams`."""
        steps = beams[right] - beams[left]  # number of angle steps between the two beams of a pair
        # a range may be negative if the driver's range_min is negative, and then counts as 0
        shorter_range = np.maximum(np.minimum(ranges[left], ranges[right]), 0.0)
        spacing = steps * step * shorter_range  # [m] distance between the two beams at the shorter range
        is_too_deep = np.abs(ranges[right] - ranges[left]) > _largest_depth(spacing, radius) + noise
        different: np.ndarray = is_too_deep | (steps > _MAX_SKIPPED + 1)
        return different

    # Most neighbouring beams are on one body, because no beam is missing between them and their ranges differ
    # only by noise. Only the other pairs of neighbours are tested; `left` has the first beam of each pair.
    has_gap = beams[1:] - beams[:-1] > 1
    has_step = np.abs(ranges[1:] - ranges[:-1]) > noise
    (left,) = (has_step | has_gap).nonzero()
    if not len(left):
        return np.array((0,)), left  # all beams lie on one body; no beam is omitted, and `left` is empty
    last_of_body = left[on_two_bodies(left, left + 1)]  # last beam of each body but the last body
    later_starts = last_of_body + 1  # first beam of each body but the first body
    # A body has a single beam if the next body begins at the next beam. For example, if bodies begin at 3, 4
    # and 9, the beam 3 is single.
    starts, next_starts = later_starts[:-1], later_starts[1:]
    single = starts[next_starts == starts + 1]
    # a single beam is omitted if the beams before and after it may lie on one pillar
    omitted = single[~on_two_bodies(single - 1, single + 1)]
    return np.concatenate(((0,), later_starts)), omitted


def _plausible(segments: Segments, config: PillarConfig) -> np.ndarray:
    """Return a mask, (S,) bool, of the segments that are large and small enough for a pillar.

    Such a segment has enough beams, and is not wider or deeper than a pillar at its range.
    """
    beams, ranges, counts, near, step = segments
    starts, step = segments.starts, abs(step)
    far = np.maximum.reduceat(ranges, starts)
    span = (beams[starts + counts - 1] - beams[starts]) * step  # [rad] angle from first to last beam
    largest_radius = config.pillar_radius + config.radius_tolerance
    distance = np.maximum(near, 0.0)  # [m] shortest range; a negative range counts as 0
    plausible: np.ndarray = (
        (counts >= config.min_beams)
        & (near > 0.0)  # some drivers give 0 if there is no return
        # angle that the largest pillar fills at this distance, and a margin of one beam
        & (span <= 2.0 * np.arcsin(largest_radius / (distance + largest_radius)) + step)
        # the visible side of a pillar is at most one radius deep; four residuals are added for noise
        & (far - distance <= largest_radius + 4.0 * config.max_residual)
        # distance between neighbouring beams at this range; if it is larger than the pillar's diameter, too
        # few beams hit a pillar to show its shape
        & (near * step <= 2.0 * largest_radius)
    )
    return plausible


def _pillar_of(scan: Scan, config: PillarConfig, segment: Segment) -> Optional[Pillar]:
    """Return the pillar that a segment shows; None if the segment shows another object."""
    radius, tolerance = config.pillar_radius, config.radius_tolerance
    circle = fit_circle(segment, radius, config.range_noise)
    # the nearest point of a pillar is nearer to the lidar than its centre; if the centre is nearer, the
    # circle is a round niche in a wall
    is_behind = circle.x > segment.near
    fits = circle.residual <= config.max_residual
    # `circle.radius` was fitted with the expected radius as one more measurement; `circle.free_radius` comes
    # from the beams alone, and may be wrong by `free_slack`
    has_radius = abs(circle.radius - radius) <= tolerance
    may_have_radius = abs(circle.free_radius - radius) <= tolerance + circle.free_slack
    if not (is_behind and fits and has_radius and may_have_radius):
        return None
    if not _explains_best(scan, config, segment, circle):
        return None
    # turn the centre from the frame of the circle, in which x points to the middle of the segment, to the
    # laser's frame
    middle = scan.angle_min + segment.middle * segment.step
    c, s = cos(middle), sin(middle)
    x, y = c * circle.x - s * circle.y, s * circle.x + c * circle.y
    return Pillar(x, y, circle.radius, len(segment.beams), circle.residual)


def _explains_best(scan: Scan, config: PillarConfig, segment: Segment, circle: Circle) -> bool:
    """Return whether a circle explains a segment, and neither a line nor a corner explains it clearly better.

    Beams that pass through the circle speak against it. If beams on its sides are hidden, the circle must be
    clearly better than the line.
    """
    beams = len(segment.beams)
    missing, hidden = _silhouette(scan, config, segment, circle)
    # the beams that pass through the circle may be at most a tenth as many as the beams on the circle
    if missing > beams // 10:
        return False
    noise = beams * config.range_noise**2  # [m^2] sum of the squared errors that noise alone would make

    def lead(sum_squared_error: float, parameters: int) -> float:
        """Return how much better than the circle another shape fits; positive if the shape fits better.

        The lead is (beams - parameters) * log(squared errors of the circle / squared errors of the shape).
        The sum of the squared errors of the shape is in m^2, and `parameters` is its number of parameters.
        """
        ratio = (circle.sum_squared_error + noise) / (sum_squared_error + noise)
        return max(beams - parameters, 1) * log(ratio)

    # A line wins if its lead is at least `line_limit`. Normally, the line must fit clearly better than the
    # circle. If beams are hidden, the limit is negative, so the circle must fit clearly better than the line.
    line_limit = -HIDDEN_ODDS if hidden else LINE_ODDS
    # a line has two parameters; if even a line with an error of 0 would lose, the line need not be fitted
    line_loses = lead(0.0, 2) < line_limit or lead(line_sum_squared_error(segment), 2) < line_limit
    if not line_loses:
        return False
    # A corner has five parameters, so it fits five beams or fewer without error, which proves nothing.
    if beams <= 5:
        return True
    # The limit of a corner grows with the number of beams, because its lead grows, too. So with any number of
    # beams, a corner wins only if log(squared errors of the circle / squared errors of the corner) is above
    # _CORNER_ODDS.
    corner_limit = _CORNER_ODDS * beams
    # if even a corner with an error of 0 would lose, the corner need not be fitted
    return lead(0.0, 5) < corner_limit or lead(corner_sum_squared_error(segment), 5) < corner_limit


def _silhouette(scan: Scan, config: PillarConfig, segment: Segment, circle: Circle) -> Tuple[int, int]:
    """Return how many beams pass through a circle that they should have met, and how many are hidden.

    If many beams pass through the circle, no pillar is there. A beam is hidden if it ends at a nearer object
    before it reaches the circle or a side of the circle. Each end of the scan that cuts the circle counts as
    one hidden beam.
    """
    step = abs(segment.step)
    distance = hypot(circle.x, circle.y)
    # beams that pass the centre within `inner_radius` [m] should meet the circle; the angle between such a
    # beam and the direction of the centre is at most `half_angle` [rad]
    inner_radius = max(INNER_PART * circle.radius - INNER_RESIDUALS * circle.residual, 0.0)
    half_angle = asin(min(inner_radius / max(distance, 1e-9), 1.0))
    # index of the beam that would point exactly to the circle's centre; it is usually not a whole number. The
    # x axis of `circle` points along the middle of the segment, so atan2 is the angle from there.
    centre = segment.middle + atan2(circle.y, circle.x) / segment.step
    # On either side of `centre`, the beams within `half_angle` are checked, and one more. This one may miss
    # the circle, so it does not count as a beam that should have met the circle. It only shows whether a
    # nearer object hides the side of the circle.
    half_width = half_angle / step + 1.0
    first, last = ceil(centre - half_width), floor(centre + half_width)
    hidden_by_ends = int(first < 0) + int(last >= len(scan.ranges))
    # [m] a beam hits the circle if its range differs from the expected range by at most this
    slack = HIT_SLACK * config.max_residual
    # the beams of the segment need no check if the sum of their squared errors is below slack^2, because then
    # each error is below `slack`
    known_hits = segment.beams if circle.sum_squared_error < slack**2 else None
    checked = _indices_between(first, last, len(scan.ranges), known_hits)
    if not len(checked):
        return 0, hidden_by_ends
    angle = (checked - centre) * step  # [rad] angle between a beam and the direction of the circle's centre
    excess = _excess(scan.returns[checked], angle, distance, circle.radius)
    passes_through = (np.abs(angle) <= half_angle) & (excess > slack)
    ends_before = excess < -slack
    return int(np.count_nonzero(passes_through)), int(np.count_nonzero(ends_before)) + hidden_by_ends


def _indices_between(first: int, last: int, count: int, omitted: Optional[np.ndarray]) -> np.ndarray:
    """Return the indices of a scan's beams from `first` to `last`, without the indices in `omitted`.

    `count` is the number of beams of the scan. `first` and `last` may be beyond the ends of the scan.
    """
    is_wanted = np.ones(count, dtype=bool)
    if omitted is not None:
        is_wanted[omitted] = False
    # a negative index would count from the end of the array
    begin, end = max(first, 0), max(last + 1, 0)
    return is_wanted[begin:end].nonzero()[0] + begin  # `nonzero` counts from the beginning of the slice


def _excess(ranges: np.ndarray, angle: np.ndarray, distance: float, radius: float) -> np.ndarray:
    """Return the ranges minus the ranges at which the beams should meet a circle [m].

    The result is negative if a beam ends in front of the circle. A beam that misses the circle is compared
    with the point on its line that is nearest to the centre.

    Args:
        ranges: ranges of the beams [m].
        angle: angles between the beams and the direction of the circle's centre [rad].
        distance: distance of the centre [m].
        radius: radius of the circle [m].
    """
    across = distance * np.sin(angle)  # [m] distance at which the line of a beam passes the centre
    nearest_to_centre = distance * np.cos(angle)  # [m] range of the point that is nearest to the centre
    # [m] length of the beam's line from the circle to this point; 0 if the line misses the circle
    square = radius * radius
    depth = np.sqrt(square - np.minimum(across * across, square))
    excess: np.ndarray = ranges - nearest_to_centre + depth
    return excess


def _distinct(pillars: List[Pillar]) -> List[Pillar]:
    """Return the pillars without the smaller piece of each pillar that was seen in two pieces.

    Two pieces belong to one pillar if their centres are nearer to each other than the radius. The piece with
    more beams stays.
    """
    kept: List[Pillar] = []
    for pillar in sorted(pillars, key=lambda pillar: -pillar.beams):
        if all(hypot(pillar.x - other.x, pillar.y - other.y) > other.radius for other in kept):
            kept.append(pillar)
    return kept
