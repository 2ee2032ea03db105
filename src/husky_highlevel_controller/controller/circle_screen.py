"""Limits of a pillar, and a screen of segments before the exact circle fit, which bounds the time per scan.

In: a scan's segments. Out: the segments that may be pillars, to be fitted one by one.

`fit_circle` takes about 0.1 ms for a segment, and a hedge makes hundreds of segments. Here all segments are
fitted together, in common arrays. Only segments that miss a limit by a clear margin are rejected, and the
exact fit decides about the rest, so that the pillars found are the same as without the screen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, NamedTuple, Tuple

import numpy as np

from husky_highlevel_controller.config import number
from husky_highlevel_controller.controller.circle_fit import (
    MAX_STEPS,
    MIN_COSINE,
    Segments,
    fit_step,
    line_squared_error,
)
from husky_highlevel_controller.datatypes import Scan

# The lead of a shape over the circle is a number that says how much better the shape fits a segment than the
# circle does. The shape is a straight line or a corner. Its lead is (number of beams - number of parameters
# of the shape) * log(squared errors of the circle / squared errors of the shape). If the lead of a line is at
# least LINE_ODDS, the segment is a wall and not a pillar. With 8 beams and a noise of 30 mm, 1 % of the
# pillars count as another shape. With a noise of 1 mm, less than 1 % of the boxes count as pillars. With more
# beams, both mistakes quickly become rare.
LINE_ODDS = 4.0
# if another object hides a part of the circle, the circle must fit better than a straight line: the lead of
# the line (see LINE_ODDS) must be below -HIDDEN_ODDS
HIDDEN_ODDS = 2.0
# a beam hits a circle if its range differs from the expected range by at most this many times `max_residual`
HIT_SLACK = 4.0
# A beam must meet a real pillar if it passes the centre of the fitted circle at a distance of at most
# INNER_PART * radius - INNER_RESIDUALS * residual. The residual is the root mean square distance of the
# beams' end points from the circle. Nearer to the circle's edge, a small error of the fit can make the beam
# miss the pillar.
INNER_PART, INNER_RESIDUALS = 0.9, 2.0
# [m] this coarse test allows each limit to be exceeded by this, because its fit is not exact
_MARGIN = 0.005
# the exact test has a limit for the lead of a line over the circle (see LINE_ODDS); the limit of this coarse
# test is larger by this
_ODDS_MARGIN = 1.0
_SAMPLES = 16  # up to this many of the beams that should meet a circle are checked


@dataclass(frozen=True)
class PillarConfig:
    """Limits of a pillar: size, errors of the fitted circle, number of beams."""

    pillar_radius: float = number(0.02, 2.0, "radius of the pillar to find [m]", default=0.2)
    pillar_height: float = number(
        0.1, 20.0, "height of the pillar marker, because a planar scan cannot measure it [m]", default=2.0
    )
    radius_tolerance: float = number(0.001, 1.0, "largest error of a measured radius [m]", default=0.05)
    max_residual: float = number(
        0.001, 0.5, "largest root mean square distance from the circle [m]", default=0.05
    )
    range_noise: float = number(0.0001, 0.2, "range differences below this are noise [m]", default=0.003)
    min_beams: int = number(2, 100, "minimum number of beams on a pillar", default=2)


class _Fits(NamedTuple):
    """Circles of S segments, arrays of (S,).

    Each circle has a frame of its own: the lidar is the origin, and x points to the middle of the segment.
    """

    x: np.ndarray  # [m] x of the centre, along the direction of the segment's middle
    y: np.ndarray  # [m] y of the centre, across this direction
    radius: np.ndarray  # [m]
    residual: np.ndarray  # [m] root mean square distance of the beams' end points from the circle
    # lead of the best straight line over the circle (see LINE_ODDS); positive if the line fits better
    line_lead: np.ndarray
    near: np.ndarray  # [m] shortest range of the segment
    counts: np.ndarray  # number of beams of the segment
    first: np.ndarray  # index of the segment's first beam in the scan
    last: np.ndarray  # index of the segment's last beam in the scan


def may_be_pillars(scan: Scan, segments: Segments, config: PillarConfig) -> Segments:
    """Return the segments that may be pillars; at least one segment must be given.

    The tests are those of the exact fit, with margins. They run for all segments at once, so that a scan of
    many objects takes little time.
    """
    fits = _geometric_fits(segments, config.pillar_radius, config.range_noise)
    candidates = (
        # the nearest point of a pillar is nearer to the lidar than its centre; if the centre is nearer, the
        # circle is a round niche in a wall
        (fits.x > fits.near - _MARGIN)
        & (fits.residual <= config.max_residual + _MARGIN)
        & (np.abs(fits.radius - config.pillar_radius) <= config.radius_tolerance + _MARGIN)
        & (fits.line_lead < LINE_ODDS + _ODDS_MARGIN)  # a line is not clearly better than the circle
    )
    # only segments that pass the tests above are tested for hidden beams and for beams that pass through the
    # circle
    fits = _Fits(*(column[candidates] for column in fits))
    missing, hidden = _silhouettes(scan, fits, slack=HIT_SLACK * config.max_residual)
    # true if the circle fits better than a line by HIDDEN_ODDS, so that the lead of the line is negative
    beats_line = fits.line_lead < -HIDDEN_ODDS + _ODDS_MARGIN
    # the beams that pass through the circle may be at most a tenth as many as the beams on the circle; if
    # another object hides a part of the circle, the circle must fit clearly better than a line
    is_solid = (missing <= fits.counts // 10) & ((hidden == 0) | beats_line)
    # `is_solid` has an entry for each candidate only, so only the entries of candidates are set
    candidates[candidates] = is_solid
    return segments.select(candidates)


class _Beams(NamedTuple):
    """Beams of S segments (B beams in all), segment by segment.

    Each segment has a frame of its own: the lidar is the origin, and x points to the middle of the segment.
    """

    segment: np.ndarray  # (B,) index of the segment of each beam
    cosines: np.ndarray  # (B,) x of the beam's unit vector
    sines: np.ndarray  # (B,) y of the beam's unit vector
    end_x: np.ndarray  # (B,) [m] x of the beam's end point
    end_y: np.ndarray  # (B,) [m] y of the beam's end point


class _Errors(NamedTuple):
    """Errors of B beams, each from the circle of its segment, arrays of (B,)."""

    # Derivatives of the error by x and y of the circle's centre. They are also the unit vector from the
    # beam's end point to the centre.
    dx: np.ndarray
    dy: np.ndarray
    error: np.ndarray  # [m] distance of the end point from the circle, positive outside
    # The fit minimises errors along the beams. Such an error is `error` / cosine of the angle between the
    # beam and (dx, dy), so the square of `error` counts with the weight 1 / cosine^2.
    weight: np.ndarray


def _geometric_fits(segments: Segments, radius: float, noise: float) -> _Fits:
    """Fit a circle to each segment as `fit_circle` does, and compare it with a line (`_Fits.line_lead`).

    A circle is fitted by steps of Gauss-Newton, which make the errors along the beams small and count the
    expected radius like one more measurement.

    Args:
        segments: beams to fit.
        radius: expected radius [m].
        noise: range differences below this are noise [m].
    """
    indices, ranges, count, near, step = segments
    starts = segments.starts
    first, last = indices[starts], indices[starts + count - 1]
    segment_of_beam = np.repeat(np.arange(len(count)), count)
    angles = step * (indices - (0.5 * (first + last))[segment_of_beam])
    cosines, sines = np.cos(angles), np.sin(angles)
    beams = _Beams(segment_of_beam, cosines, sines, ranges * cosines, ranges * sines)
    # one circle for each segment, (S,) [m]: the centre is (origin + x, y), the radius is r. (origin, 0) is
    # where `fit_step` expects the centre: one radius behind the segment's shortest range.
    origin = near + radius
    x, y, r = np.zeros(len(count)), np.zeros(len(count)), np.full(len(count), radius)
    summands = np.empty((9, len(indices)))  # memory for `_products`, which each step uses again
    for _ in range(MAX_STEPS):
        errors = _beam_errors(beams, origin + x, y, r)
        products = _products(errors, starts, summands)
        step_x, step_y, step_r = fit_step((x, y, r), products, radius)
        longest = np.maximum(np.maximum(np.abs(step_x), np.abs(step_y)), np.abs(step_r))
        fraction = radius / np.maximum(longest, radius)  # below 1 if the step is longer than the radius
        x, y = x - fraction * step_x, y - fraction * step_y
        r = np.maximum(r - fraction * step_r, 0.1 * radius)  # the lower limit keeps the radius above zero

    errors = _beam_errors(beams, origin + x, y, r)
    residual, line_lead = _residuals_and_line_leads(segments, beams, errors, noise)
    return _Fits(origin + x, y, r, residual, line_lead, near, count, first, last)


def _beam_errors(beams: _Beams, x: np.ndarray, y: np.ndarray, r: np.ndarray) -> _Errors:
    """Return the errors of all beams from circles with the centre (x, y) and the radius r, (S,) each [m]."""
    dx, dy = x[beams.segment] - beams.end_x, y[beams.segment] - beams.end_y
    distance = np.maximum(np.sqrt(dx * dx + dy * dy), 1e-9)
    dx /= distance
    dy /= distance
    cosine = np.maximum(dx * beams.cosines + dy * beams.sines, MIN_COSINE)
    return _Errors(dx, dy, distance - r[beams.segment], np.divide(1.0, cosine * cosine))


def _products(errors: _Errors, starts: np.ndarray, summands: np.ndarray) -> List[List[np.ndarray]]:
    """Return the sums over the beams of each segment that `fit_step` needs, (S,) each.

    As in `Products`, xe is the sum of (derivative of the error by x) * error * weight, and so on. The fourth
    row is empty, because `fit_step` does not use it.

    Args:
        errors: errors of B beams, with their derivatives and weights.
        starts: index at which each segment begins, (S,).
        summands: memory for the summands of the nine sums, (9, B).
    """
    dx, dy, error, weight = errors
    wx, wy, we = weight * dx, weight * dy, weight * error
    # `out` writes into `summands`, so that no new arrays are made
    np.multiply(wx, dx, out=summands[0])
    np.multiply(wx, dy, out=summands[1])
    np.multiply(wx, error, out=summands[2])
    np.multiply(wy, dy, out=summands[3])
    np.multiply(wy, error, out=summands[4])
    # the derivative of the error by r is -1; the sums with this factor get their minus sign at the end
    summands[5:] = wx, wy, weight, we
    xx, xy, xe, yy, ye, minus_xr, minus_yr, rr, minus_re = np.add.reduceat(summands, starts, axis=1)
    xr, yr, re = -minus_xr, -minus_yr, -minus_re
    return [[xx, xy, xr, xe], [xy, yy, yr, ye], [xr, yr, rr, re], []]


def _residuals_and_line_leads(
    segments: Segments, beams: _Beams, errors: _Errors, noise: float
) -> Tuple[np.ndarray, np.ndarray]:
    """Return how well each circle fits (`_Fits.residual`), and whether a line fits better (`line_lead`).

    The lead of a line is positive if its squared errors are smaller than those of the circle. The lead grows
    with the number of beams, because with more beams the difference is less likely to be noise.

    Args:
        segments: S segments.
        beams: all their beams, B.
        errors: errors of the beams, each from the circle of its segment.
        noise: range differences below this are noise [m].
    """
    ranges, count = segments.ranges, segments.counts
    squares = errors.error * errors.error
    # products of each beam that `line_squared_error` needs, with u = r^2 cos and v = r^2 sin
    u, v = ranges * beams.end_x, ranges * beams.end_y
    line_terms = (u * u, u * v, v * v, u * ranges, v * ranges, ranges * ranges)
    # sums over the beams of each segment, (S,): squared distances from the circle, squared errors of the
    # circle along the beams, and the six sums for the line
    summands = np.stack((squares, errors.weight * squares, *line_terms))
    sums = np.add.reduceat(summands, segments.starts, axis=1)
    squared_distances, circle_error, line_error = sums[0], sums[1], line_squared_error(sums[2:])
    # the squared errors that noise alone would make are added to both, so that differences below the noise do
    # not count
    noise_error = count * noise**2
    ratio = (circle_error + noise_error) / (line_error + noise_error)
    line_lead = np.maximum(count - 2, 1) * np.log(ratio)  # a line has two parameters
    return np.sqrt(squared_distances / count), line_lead


def _silhouettes(scan: Scan, fits: _Fits, slack: float) -> Tuple[np.ndarray, np.ndarray]:
    """Compare beams beside each segment with the circle that was fitted to it.

    Args:
        scan: the scan.
        fits: circles of S segments, each in a frame of its own: the lidar is the origin, and x points to the
            middle of the segment.
        slack: difference from the expected range that still counts as a hit in the exact test [m]; this
            coarse test adds _MARGIN to it.

    Returns:
        For each circle, the number of sampled beams that pass through it, and the number of sampled beams
        that a nearer object hides, both (S,). The sampled beams are up to _SAMPLES of those that should meet
        the circle; beams of the segment itself do not count.
    """
    # `[:, None]` makes an array (S,) into a column (S, 1), so that it can be combined with S rows of beams
    distance, r = np.hypot(fits.x, fits.y), fits.radius[:, None]
    samples, angle, is_counted = _sampled_beams(scan, fits, distance)
    # [m] distance at which the line of a beam passes the circle's centre. Only a beam that does not count may
    # miss the circle; the limit `r` keeps the square root below real for such a beam.
    across = np.minimum(np.abs(distance[:, None] * np.sin(angle)), r)
    # [m] range at which the beam should meet the circle
    expected = distance[:, None] * np.cos(angle) - np.sqrt(r * r - across * across)
    # an index beyond the scan does not count, so any beam may stand in for it
    in_scan = np.clip(samples, 0, len(scan.ranges) - 1).astype(int)
    reading = scan.returns[in_scan]
    missing = is_counted & (reading > expected + slack + _MARGIN)
    hidden = is_counted & (reading < expected - slack - _MARGIN)
    return missing.sum(axis=1), hidden.sum(axis=1)


def _sampled_beams(
    scan: Scan, fits: _Fits, distance: np.ndarray
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Choose up to _SAMPLES of the beams that should meet each circle, evenly from all of them.

    Args:
        scan: the scan.
        fits: circles of S segments.
        distance: distances of their centres, (S,) [m].

    Returns:
        Three arrays (S, _SAMPLES): indices of beams, angles between the beams and the direction of the
        circle's centre [rad], and a mask of the beams that count. A beam does not count if it belongs to the
        segment itself, or if a row has more places than there are beams that should meet the circle.
    """
    step = abs(scan.angle_increment)
    # [m] a beam should meet the circle if it passes the circle's centre at this distance or less
    inner_radius = np.maximum(INNER_PART * fits.radius - INNER_RESIDUALS * fits.residual - _MARGIN, 0.0)
    # `half_width` is the angle between the outermost of these beams and the centre, as a number of beams
    half_angle = np.arcsin(np.minimum(inner_radius / np.maximum(distance, 1e-9), 1.0))
    half_width = half_angle / step
    # Index of the beam that would point to the centre, usually not a whole number. In the frame of a circle,
    # arctan2 is the angle from the segment's middle to the centre.
    middle = 0.5 * (fits.first + fits.last)
    centre = middle + np.arctan2(fits.y, fits.x) / scan.angle_increment
    # smallest and largest index of the beams of the scan that should meet the circle; `largest` need not be
    # a whole number, because it is only a limit for whole numbers
    smallest = np.maximum(np.ceil(centre - half_width), 0.0)
    largest = np.minimum(centre + half_width, len(scan.ranges) - 1.0)
    # Each of the S rows has _SAMPLES indices of beams, from `smallest` on, in equal steps of 1 or more. If
    # fewer than _SAMPLES beams should meet the circle, the last indices of a row are above `largest`.
    stride = np.maximum((largest - smallest) / _SAMPLES, 1.0)
    samples = np.floor(smallest[:, None] + stride[:, None] * np.arange(_SAMPLES))
    angle = (samples - centre[:, None]) * step
    is_own = (samples >= fits.first[:, None]) & (samples <= fits.last[:, None])
    is_counted = (samples <= largest[:, None]) & ~is_own
    return samples, angle, is_counted
