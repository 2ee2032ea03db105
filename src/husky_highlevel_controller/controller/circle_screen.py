"""Limits of a pillar, and a screen of segments before the exact circle fit, which bounds the time per scan.

In: a scan's segments. Out: the segments that may be pillars, to be fitted one by one.

`fit_circle` takes about 0.1 ms for a segment, and a hedge makes hundreds of segments. Here one geometric fit
runs for all of them in the same arrays. It rejects only segments that miss a limit by a clear margin, and the
exact fit decides about the rest, so that the pillars found are the same as without the screen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Tuple

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

# Lead with which a rival shape wins: logarithm of the ratio of the sums of squares, times the beams to spare.
# With 8 beams and 30 mm noise, 1 % of pillars lose to a corner at this setting. At 1 mm noise less than 1 %
# of boxes count as pillars. With more beams both errors become rare quickly.
LINE_ODDS = 4.0
HIDDEN_ODDS = 2.0  # lead that a circle needs over a line if part of the silhouette is hidden
_MARGIN = 0.005  # [m] distance by which a circle must miss a limit
_ODDS_MARGIN = 1.0  # margin of the odds of a line
_SAMPLES = 16  # number of beams of a silhouette that are checked


@dataclass(frozen=True)
class PillarConfig:
    """Limits of a pillar: size, number of beams, clearance."""

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
    """Circles of S segments, arrays of (S,)."""

    x: np.ndarray  # [m], centre, along the segment's middle
    y: np.ndarray  # [m], centre, across it
    radius: np.ndarray  # [m]
    residual: np.ndarray  # [m], root mean square distance of the end points
    line_lead: np.ndarray  # lead of a line over the circle, as in LINE_ODDS
    near: np.ndarray  # [m] shortest range
    counts: np.ndarray  # number of beams
    first: np.ndarray  # index of the first beam
    last: np.ndarray  # index of the last beam


def may_be_pillars(scan: Scan, segments: Segments, config: PillarConfig) -> Segments:
    """Return the segments that the exact fit may find to be pillars, from one or more segments.

    The screen has the tests of the exact fit, with margins, for all segments at once, so that clutter takes
    little time.
    """
    fits = _geometric_fits(segments, config.pillar_radius, config.range_noise)
    candidates = (
        (fits.x > fits.near - _MARGIN)
        & (fits.residual <= config.max_residual + _MARGIN)
        & (np.abs(fits.radius - config.pillar_radius) <= config.radius_tolerance + _MARGIN)
        & (fits.line_lead < LINE_ODDS + _ODDS_MARGIN)
    )
    fits = _Fits(*(column[candidates] for column in fits))
    missing, hidden = _silhouettes(scan, fits, 4.0 * config.max_residual)
    framed = (missing <= fits.counts // 10) & ((hidden == 0) | (fits.line_lead < -HIDDEN_ODDS + _ODDS_MARGIN))
    candidates[candidates] = framed
    return segments.select(candidates)


def _geometric_fits(segments: Segments, radius: float, noise: float) -> _Fits:
    """Fit a circle to every segment at once, with the steps of `fit_circle`, and compute the lead of a line.

    These fits discard segments quickly. `fit_circle` fits the remaining segments exactly.

    Args:
        segments: beams to fit.
        radius: expected radius [m].
        noise: differences in range not worth explaining [m].
    """
    beams, ranges, count, near, step = segments
    starts = segments.starts
    of = np.repeat(np.arange(len(count)), count)  # index of each beam's segment
    first, last = beams[starts], beams[starts + count - 1]
    angles = step * (beams - (0.5 * (first + last))[of])
    cosines, sines = np.cos(angles), np.sin(angles)
    px, py, origin = ranges * cosines, ranges * sines, near + radius
    x, y, r = np.zeros(len(count)), np.zeros(len(count)), np.full(len(count), radius)
    terms = np.empty((9, len(beams)))  # sums of products of J = (dx, dy, -1) and the error, times the weight

    def residuals() -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of each beam's error by x and y, the error [m], and its weight, as in `fit_circle`."""
        dx, dy = (origin + x)[of] - px, y[of] - py
        rho = np.maximum(np.sqrt(dx * dx + dy * dy), 1e-9)
        dx /= rho
        dy /= rho
        cosine = np.maximum(dx * cosines + dy * sines, MIN_COSINE)
        return dx, dy, rho - r[of], np.divide(1.0, cosine * cosine)

    for _ in range(MAX_STEPS):
        dx, dy, error, weight = residuals()
        wx, wy, we = weight * dx, weight * dy, weight * error
        for row, factors in enumerate(((wx, dx), (wx, dy), (wx, error), (wy, dy), (wy, error))):
            np.multiply(*factors, out=terms[row])
        terms[5:] = wx, wy, weight, we
        xx, xy, xe, yy, ye, xr, yr, rr, re = np.add.reduceat(terms, starts, axis=1)
        xr, yr, re = -xr, -yr, -re
        # a step does not use the fourth row, of the error
        products = [[xx, xy, xr, xe], [xy, yy, yr, ye], [xr, yr, rr, re], []]
        step_x, step_y, step_r = fit_step((x, y, r), products, radius)
        longest = np.maximum(np.maximum(np.abs(step_x), np.abs(step_y)), np.abs(step_r))
        share = radius / np.maximum(longest, radius)
        x, y, r = x - share * step_x, y - share * step_y, np.maximum(r - share * step_r, 0.1 * radius)
    _, _, error, weight = residuals()
    squares = error * error
    u, v = ranges * px, ranges * py
    line_terms = (u * u, u * v, v * v, u * ranges, v * ranges, ranges * ranges)
    sums = np.add.reduceat(np.stack((squares, weight * squares, *line_terms)), starts, axis=1)
    noises = count * noise**2
    lead = np.maximum(count - 2, 1) * np.log((sums[1] + noises) / (line_squared_error(sums[2:]) + noises))
    return _Fits(origin + x, y, r, np.sqrt(sums[0] / count), lead, near, count, first, last)


def _silhouettes(scan: Scan, fits: _Fits, slack: float) -> Tuple[np.ndarray, np.ndarray]:
    """Count the sampled beams that pass through each circle, and the hidden ones."""
    step, distance, r = abs(scan.angle_increment), np.hypot(fits.x, fits.y), fits.radius[:, None]
    inner = np.maximum(0.9 * fits.radius - 2.0 * fits.residual - _MARGIN, 0.0)
    half = np.arcsin(np.minimum(inner / np.maximum(distance, 1e-9), 1.0)) / step
    centre = 0.5 * (fits.first + fits.last) + np.arctan2(fits.y, fits.x) / scan.angle_increment
    low, high = np.maximum(np.ceil(centre - half), 0.0), np.minimum(centre + half, len(scan.ranges) - 1.0)
    stride = np.maximum((high - low) / _SAMPLES, 1.0)
    samples = np.floor(low[:, None] + stride[:, None] * np.arange(_SAMPLES))
    psi = (samples - centre[:, None]) * step
    across = np.minimum(np.abs(distance[:, None] * np.sin(psi)), r)
    expected = distance[:, None] * np.cos(psi) - np.sqrt(r * r - across * across)
    reading = scan.returns[np.clip(samples, 0, len(scan.ranges) - 1).astype(int)]
    is_own = (samples >= fits.first[:, None]) & (samples <= fits.last[:, None])
    is_other = (samples <= high[:, None]) & ~is_own
    missing = is_other & (reading > expected + slack + _MARGIN)
    hidden = is_other & (reading < expected - slack - _MARGIN)
    return missing.sum(axis=1), hidden.sum(axis=1)
