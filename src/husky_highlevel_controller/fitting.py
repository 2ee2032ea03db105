"""Fits circles, lines and corners to runs of beams, all runs at once.

In: `Runs`. Out: `Circles`, and how well straight things would do.
Must not know: ROS, PyBullet, what counts as a pillar besides its radius.
"""

from __future__ import annotations

from typing import NamedTuple, Tuple

import numpy as np

_RADIUS_WEIGHT = 0.6  # the expected radius counts as much as this many beams
_PLACE_WEIGHT = 1e-3  # and so little that the centre is on the line of sight
_LEAST_WEIGHT = 1e-6  # keeps the equations solvable
_MIN_COSINE = 0.3  # of incidence; grazing beams weigh no more than this one
_MAX_ITERATIONS = 6
_SETTLED = 1e-4  # [m], a smaller step of the fit is the last


class Runs(NamedTuple):
    """Runs of beams, one a row, padded on the right; angles are relative to the middle of the run."""

    middle: np.ndarray  # (K,) [rad], bearing in the laser's frame
    near: np.ndarray  # (K,) [m], shortest range
    ranges: np.ndarray  # (K, M) [m]; padded with the first
    angles: np.ndarray  # (K, M) [rad]
    mask: np.ndarray  # (K, M) float, 1 where there is a beam
    beams: np.ndarray  # (K,), how many


class Circles(NamedTuple):
    """Fitted circles, one a row."""

    distance: np.ndarray  # (K,) [m], from the laser to the centre
    bearing: np.ndarray  # (K,) [rad], of the centre, continuous with the scan's bearings
    radius: np.ndarray  # (K,) [m]
    free_radius: np.ndarray  # (K,) [m], what the beams alone would make it
    free_slack: np.ndarray  # (K,) [m], how far that may be wrong
    residual: np.ndarray  # (K,) [m], root mean square distance of the end points
    misfit: np.ndarray  # (K,) [m^2], sum of squares in the direction of the beams


def fit_circles(runs: Runs, radius: float, noise: float) -> Circles:
    """Most probable circle of each run, given the expected radius.

    Range noise acts along the beam, so a distance from the circle counts as much as the range would have to
    change (distance over the cosine of incidence). Where beams are few the radius stays as expected and the
    depth profile gives the place; where they are many they decide alone. Gauss-Newton, all runs at once.

    Args:
        runs: of the beams.
        radius: what is expected [m].
        noise: differences in range not worth explaining [m].
    """
    mean = np.zeros((len(runs.near), 3))
    mean[:, 0], mean[:, 2] = runs.near + radius, radius
    guess = mean
    weight = np.array([_LEAST_WEIGHT, _PLACE_WEIGHT, _RADIUS_WEIGHT])
    prior = np.diag(weight)
    beam = np.stack([np.cos(runs.angles), np.sin(runs.angles)], axis=1)
    ends = runs.ranges[:, None] * beam
    for _ in range(_MAX_ITERATIONS):
        products, _ = _circle_products(guess, ends, beam, runs.mask)
        gradient = products[:, :3, 3] + weight * (guess - mean)
        change = np.linalg.solve(products[:, :3, :3] + prior, gradient[:, :, None])[:, :, 0]
        largest = np.abs(change).max()
        if largest > radius:
            change = np.minimum(np.maximum(change, -radius), radius)
        guess = guess - change
        guess[:, 2] = np.maximum(guess[:, 2], 0.1 * radius)
        if largest < _SETTLED:
            break
    products, error = _circle_products(guess, ends, beam, runs.mask)
    shift, slack = _free_radius(products, runs.beams, noise)
    return Circles(
        distance=np.hypot(guess[:, 0], guess[:, 1]),
        bearing=runs.middle + np.arctan2(guess[:, 1], guess[:, 0]),
        radius=guess[:, 2],
        free_radius=guess[:, 2] + shift,
        free_slack=slack,
        residual=np.sqrt((runs.mask * error**2).sum(axis=1) / runs.beams),
        misfit=products[:, 3, 3],
    )


def _circle_products(
    circle: np.ndarray, ends: np.ndarray, beam: np.ndarray, mask: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Weighted products (K, 4, 4) of derivatives and error, and the errors (K, M), of ends (K, 2, M).

    The error is the distance from the circle [m]; its derivatives are by the centre's x, y and the radius.
    """
    columns = np.empty((len(circle), 4, ends.shape[2]))
    inwards = np.subtract(circle[:, :2, None], ends, out=columns[:, :2])
    rho = np.sqrt(inwards[:, 0] * inwards[:, 0] + inwards[:, 1] * inwards[:, 1])
    inwards /= rho[:, None]
    cosine = inwards[:, 0] * beam[:, 0] + inwards[:, 1] * beam[:, 1]
    error = rho - circle[:, 2:]
    columns[:, 2], columns[:, 3] = -1.0, error
    columns *= (mask / np.maximum(cosine, _MIN_COSINE))[:, None]
    return columns @ columns.transpose(0, 2, 1), error


def _free_radius(products: np.ndarray, count: np.ndarray, noise: float) -> Tuple[np.ndarray, np.ndarray]:
    """How much the beams alone would change the radius (K,), and how far that may be wrong (K,) [m]."""
    gradient = products[:, :3, 3]
    covariance = np.linalg.inv(products[:, :3, :3] + np.diag([_LEAST_WEIGHT, 1e-4, 1e-4]))
    change = (covariance @ gradient[:, :, None])[:, :, 0]
    spare = np.maximum(count - 3, 1e-3)
    variance = np.maximum(products[:, 3, 3] - (change * gradient).sum(axis=1), 0.0) / spare
    spread = np.sqrt((variance + noise**2) * covariance[:, 2, 2])
    return -change[:, 2], (2.0 + 4.0 / spare) * spread  # the factor follows Student's distribution


def straight_misfits(runs: Runs) -> Tuple[np.ndarray, np.ndarray]:
    """Sums of squares along the beams of the best line (K,) and the best two lines (K,) [m^2].

    The inverse range of a straight wall is linear in the cosine and sine of the beam, so that the sums of all
    ways to cut a run in two come from running sums.
    """
    scale = (runs.ranges * runs.mask).sum(axis=1, keepdims=True) / runs.beams[:, None]
    depth = runs.ranges * np.cos(runs.angles)
    across, inverse = scale * np.tan(runs.angles), scale - scale**2 / depth
    weight = runs.mask * (runs.ranges * depth / scale**2) ** 2
    terms = np.empty((6, *across.shape))
    terms[0], terms[1], terms[2] = 1.0, across, inverse
    terms[3:5], terms[5] = across * terms[1:3], inverse * inverse
    terms *= weight
    sums = np.empty((6, 2, *across.shape))  # of the beams up to the cut, and of those behind it
    left = np.cumsum(terms, axis=2, out=sums[:, 0])
    np.subtract(left[:, :, -1:], left, out=sums[:, 1])
    misfits = _line_misfit(sums)
    cut = np.arange(1, runs.ranges.shape[1] + 1)
    fits = (cut < runs.beams[:, None]) & (runs.beams[:, None] > 5)
    return misfits[0, :, -1], np.where(fits, misfits[0] + misfits[1], np.inf).min(axis=1)


def _line_misfit(sums: np.ndarray) -> np.ndarray:
    """Sum of squares left by a line, from the weighted sums of 1, x, y, x^2, xy, y^2."""
    n, x, y, xx, xy, yy = sums
    n = np.maximum(n, 1e-12)
    spread = np.maximum(xx - x * x / n, 1e-12)
    return np.maximum(yy - y * y / n - (xy - x * y / n) ** 2 / spread, 0.0)
