"""Least-squares fits of a circle, a line and a corner to a segment of beams.

In: a `Segment`. Out: a `Circle`, and the errors of a line and of a corner, which is two lines.

Sums over many beams are matrix products. The small systems of equations are solved with plain numbers.
"""

from __future__ import annotations

from math import sqrt
from typing import List, NamedTuple, Sequence, Tuple, TypeVar

import numpy as np

from husky_highlevel_controller.datatypes import Vector3

_RADIUS_WEIGHT = 0.6  # the expected radius counts in the fit as much as this many beams
# The fit expects y = 0 for the circle's centre, with this weight. y is 0 on the line from the lidar through
# the middle of the segment.
_Y_WEIGHT = 1e-3
# The fit expects the centre one radius farther away than the shortest range, with this weight. The weight is
# tiny. It only keeps the equations solvable if the beams do not determine the distance of the centre.
_X_WEIGHT = 1e-6
# weight instead of _RADIUS_WEIGHT and _Y_WEIGHT when the radius is computed from the beams alone
_FREE_WEIGHT = 1e-4
# The weight of a beam in the fit is 1 / cosine^2, with the angle between the beam and the circle's normal. A
# cosine below MIN_COSINE counts as MIN_COSINE. Otherwise, beams that only touch the circle's edge would get a
# very large weight.
MIN_COSINE = 0.3
MAX_STEPS = 6
# [m] the fit ends with a step smaller than this, because the next step would be a thousand times smaller
_SETTLED = 3e-4

# (4, 4) matrix of sums over the beams. Each beam has four numbers: the derivatives of its error by the
# circle's x, y and radius, and the error itself. Each number has a row and a column of the matrix, which are
# called x, y, r and e. For example, the entry `xe` in row x and column e is the sum over the beams of
# (derivative of the error by x) * error * weight of the beam.
Products = List[List[float]]
Number = TypeVar("Number", float, np.ndarray)  # a number, or an array with a number for each segment
Row3 = Tuple[Number, Number, Number]
Matrix3 = Tuple[Row3[Number], Row3[Number], Row3[Number]]


class Segment(NamedTuple):
    """Neighbouring beams that may lie on one body (M of them)."""

    beams: np.ndarray  # (M,) indices of the beams in the scan, ascending
    ranges: np.ndarray  # (M,) [m]
    near: float  # [m] shortest range of the segment
    step: float  # [rad] angle between neighbouring beams of the scan

    @property
    def middle(self) -> float:
        """Index half-way between the first and last beam; the x axis of the fit has this direction."""
        return 0.5 * float(self.beams[0] + self.beams[-1])

    @property
    def directions(self) -> np.ndarray:
        """Unit vectors of the beams, (2, M)."""
        angles = self.step * (self.beams - self.middle)
        return np.array((np.cos(angles), np.sin(angles)))


class Segments(NamedTuple):
    """All segments of one scan (S of them), in common arrays."""

    beams: np.ndarray  # (B,) indices of the beams in the scan, segment by segment, ascending in each segment
    ranges: np.ndarray  # (B,) [m]
    counts: np.ndarray  # (S,) number of beams of each segment
    near: np.ndarray  # (S,) [m] shortest range of each segment
    step: float  # [rad] angle between neighbouring beams of the scan

    @property
    def starts(self) -> np.ndarray:
        """Index at which each segment begins in `beams` and `ranges`, (S,)."""
        starts: np.ndarray = self.counts.cumsum() - self.counts
        return starts

    def select(self, mask: np.ndarray) -> Segments:
        """Return the segments for which `mask`, (S,) bool, is true."""
        if np.count_nonzero(mask) == len(mask):
            return self  # usually all are selected, and a copy would take as long as a step of a fit
        beam_mask = mask.repeat(self.counts)
        return Segments(
            self.beams[beam_mask], self.ranges[beam_mask], self.counts[mask], self.near[mask], self.step
        )

    def one_by_one(self) -> List[Segment]:
        """Return a list with a record for each of the S segments."""
        segments = []
        for start, count, near in zip(self.starts.tolist(), self.counts.tolist(), self.near.tolist()):
            end = start + count
            segments.append(Segment(self.beams[start:end], self.ranges[start:end], near, self.step))
        return segments


class Circle(NamedTuple):
    """A fitted circle, in a frame with the lidar as origin and the x axis along the segment's middle."""

    x: float  # [m] x of the centre
    y: float  # [m] y of the centre
    radius: float  # [m]
    free_radius: float  # [m] radius from the beams alone, without the expected radius
    free_slack: float  # [m] possible error of `free_radius`
    residual: float  # [m] root mean square distance of the beams' end points from the circle
    sum_squared_error: float  # [m^2] sum of the squared errors, each measured along its beam


def fit_circle(segment: Segment, radius: float, noise: float) -> Circle:
    """Fit a circle to a segment, and take the expected radius into account like one more measurement.

    The result is the most probable circle (maximum a posteriori), which is found by Gauss-Newton. With p_i
    the end point of beam i, d_i its direction, c the centre and r the radius, the residual of a beam

        e_i = |c - p_i| - r,    n_i = (c - p_i) / |c - p_i|,    cos_i = max(n_i . d_i, MIN_COSINE)

    is weighted by w_i = 1 / cos_i^2, because noise acts along the beam and e_i / cos_i is the change of range
    that would remove the residual. The lidar is the origin, and the x axis points to the middle of the
    segment. The prior expects the centre at c_0 = (near + R, 0), behind the nearest beam, and the radius R.
    The fit minimises

        sum_i w_i e_i^2 + 1e-6 (c_x - c_0x)^2 + 1e-3 c_y^2 + 0.6 (r - R)^2

    With J_i = (n_ix, n_iy, -1), the derivatives of e_i, each step solves the normal equations

        (sum_i w_i J_i J_i^T + P) step = sum_i w_i J_i e_i + P (c - c_0, r - R),    P = diag(1e-6, 1e-3, 0.6)

    and is subtracted, shortened to R if it is longer. Few beams hardly change the radius, so they only give
    the position. Many beams outweigh the expected radius.

    Args:
        segment: beams to fit.
        radius: expected radius [m].
        noise: range differences below this are noise [m].
    """
    # x is measured from `origin`, which is near the centre, because small numbers have small rounding errors
    origin, directions = segment.near + radius, segment.directions
    points = segment.ranges * directions
    points[0] -= origin
    circle: Vector3 = (0.0, 0.0, radius)
    for _ in range(MAX_STEPS):
        before = circle
        errors, products = _errors(before, points, directions)
        circle, step_length = _improved(before, products, radius)
        if step_length < _SETTLED:
            break
    # `errors` and `products` are those of the circle before the last step. This step is usually tiny, so the
    # errors count for the final circle, too.
    residual = sqrt(float(errors @ errors) / len(errors))
    sum_squared_error = products[3][3]  # sum_i w_i e_i^2
    free_change, free_slack = _free_radius(products, len(errors), noise)
    x, y, r = circle
    return Circle(
        x=origin + x,
        y=y,
        radius=r,
        free_radius=before[2] + free_change,
        free_slack=free_slack,
        residual=residual,
        sum_squared_error=sum_squared_error,
    )


def _errors(circle: Vector3, points: np.ndarray, directions: np.ndarray) -> Tuple[np.ndarray, Products]:
    """Return the distance of each beam's end point from a circle, (M,) [m], and the sums that a step needs.

    The distance is positive outside of the circle. The sums are weighted, see `fit_circle`.

    Args:
        circle: x, y and r [m], in the frame of `points`.
        points: end points of the beams, (2, M) [m].
        directions: unit vectors of the beams, (2, M).
    """
    x, y, r = circle
    # one column for each beam i: n_ix, n_iy and -1, which are the derivatives of its error, and the error e_i
    rows = np.empty((4, points.shape[1]))
    # parts of `rows`, which the next lines fill
    normals, (normal_x, normal_y, derivative_by_r, errors) = rows[:2], rows
    derivative_by_r.fill(-1.0)
    np.subtract(x, points[0], out=normal_x)
    np.subtract(y, points[1], out=normal_y)
    distance = np.hypot(normal_x, normal_y)  # distance of the end point from the centre
    normals /= np.maximum(distance, 1e-9)
    np.subtract(distance, r, out=errors)
    cosine = np.add.reduce(normals * directions)  # sum over x and y, which is the product n_i . d_i
    # A beam's four numbers are divided by cos_i. A product of two of these numbers then has the weight
    # 1 / cos_i^2, so this matrix product gives all the weighted sums.
    weighted = rows / np.maximum(cosine, MIN_COSINE)
    return errors, (weighted @ weighted.T).tolist()


def _improved(circle: Vector3, products: Products, radius: float) -> Tuple[Vector3, float]:
    """Return the circle (x, y, r) [m] after a step of Gauss-Newton, and the step's largest component [m].

    x and y are measured from the point at which the centre is expected; `radius` is the expected radius [m].
    The step is shortened if a component is longer than `radius`, because the linear equations hold only near
    the present circle.
    """
    x, y, r = circle
    dx, dy, dr = fit_step(circle, products, radius)
    longest = max(abs(dx), abs(dy), abs(dr))
    fraction = min(1.0, radius / longest) if longest > 0.0 else 1.0
    # the lower limit keeps the radius above zero
    return (x - fraction * dx, y - fraction * dy, max(r - fraction * dr, 0.1 * radius)), longest


def fit_step(circle: Row3[Number], products: Sequence[Sequence[Number]], radius: float) -> Row3[Number]:
    """Return the Gauss-Newton step (x, y, r) [m], which the caller subtracts from the circle.

    The function computes the step of one circle or of many. The caller shortens a step that is too long.

    Args:
        circle: x, y and r [m]; x and y are measured from the point at which the centre is expected, which is
            one radius behind the segment's nearest beam.
        products: sums as in `Products`; the last row is not used.
        radius: expected radius [m].
    """
    x, y, r = circle
    # `Products` explains the names: xe is the sum of (derivative of the error by x) * error * weight
    (xx, xy, xr, xe), (_, yy, yr, ye), (_, _, rr, re), _ = products
    # The beams alone give the equations [[xx, xy, xr], [xy, yy, yr], [xr, yr, rr]] step = (xe, ye, re). Each
    # expectation (x = 0, y = 0, r = radius) is added with its weight, like a further measurement. Its error
    # is x, y or r - radius, and the derivative of this error is 1.
    inverse = _inverse(xx + _X_WEIGHT, xy, xr, yy + _Y_WEIGHT, yr, rr + _RADIUS_WEIGHT)
    right_side = (xe + _X_WEIGHT * x, ye + _Y_WEIGHT * y, re + _RADIUS_WEIGHT * (r - radius))
    return _apply(inverse, right_side)


def _free_radius(products: Products, count: int, noise: float) -> Tuple[float, float]:
    """Return the change of radius that the beams alone would make, and its possible error [m].

    The fit also counts the expected radius. Only the radius by the beams alone shows whether the beams agree
    with the expected radius.

    Args:
        products: sums of the beams' errors from a circle (see `Products`); the radius of this circle changes.
        count: number of beams.
        noise: range differences below this are noise [m].
    """
    (xx, xy, xr, xe), (_, yy, yr, ye), (_, _, rr, re), (_, _, _, ee) = products
    # step of Gauss-Newton as in `fit_step`, but with small weights in place of the expectations; they keep
    # the matrix invertible if the beams alone do not determine the circle
    inverse = _inverse(xx + _X_WEIGHT, xy, xr, yy + _FREE_WEIGHT, yr, rr + _FREE_WEIGHT)
    step_x, step_y, step_r = _apply(inverse, (xe, ye, re))
    radius_change = -step_r  # a step is subtracted from the circle
    # [m^2] sum of the squared errors after this step; the subtracted part is what the step explains
    left_after_step = ee - (step_x * xe + step_y * ye + step_r * re)
    degrees_of_freedom = max(count - 3, 1e-3)  # a circle has three parameters
    # [m^2] variance of one beam's error
    beam_variance = max(left_after_step, 0.0) / degrees_of_freedom + noise**2
    # if the error of each beam had the variance 1, `inverse` would be the covariance of x, y and r
    standard_error = sqrt(beam_variance * max(inverse[2][2], 0.0))
    # Two standard errors are enough for many beams (95 %). For few beams, the variance itself is uncertain,
    # so the factor is larger, about as in Student's t distribution: 4 for five beams.
    possible_error = (2.0 + 4.0 / degrees_of_freedom) * standard_error
    return radius_change, possible_error


def _inverse(a: Number, b: Number, c: Number, d: Number, e: Number, f: Number) -> Matrix3[Number]:
    """Return the inverse of the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]]."""
    # cofactors of the matrix, which become the inverse when they are divided by the determinant
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    scale = 1.0 / (a * aa + b * ab + c * ac)
    aa, ab, ac, bb, bc, cc = aa * scale, ab * scale, ac * scale, bb * scale, bc * scale, cc * scale
    return (aa, ab, ac), (ab, bb, bc), (ac, bc, cc)


def _apply(matrix: Matrix3[Number], vector: Row3[Number]) -> Row3[Number]:
    """Return the product of a matrix and a vector."""
    x, y, z = vector
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def line_sum_squared_error(segment: Segment) -> float:
    """Sum of the squared errors of the best straight line [m^2].

    In polar coordinates, a line has the equation 1 / r = a cos + b sin, with the range r of a beam and its
    angle. Multiplied by r^2, this is r = a u + b v, with u = r^2 cos and v = r^2 sin. A fit of this form
    minimises the errors of r, which are measured along the beams.
    """
    terms = _terms(segment)
    # entries of the matrix, which is symmetric: uv is the sum over the beams of u times v, and so on
    (uu, uv, ur), (_, vv, vr), (_, _, rr) = (terms @ terms.T).tolist()
    return float(line_squared_error(np.array((uu, uv, vv, ur, vr, rr))))


def corner_sum_squared_error(segment: Segment) -> float:
    """Sum of the squared errors of the best corner, which is two lines, measured along the beams [m^2]."""
    terms = _terms(segment)
    # products uu, uv, vv, ur, vr, rr of each beam, from whose sums `line_squared_error` fits a line
    u, v, r = terms
    products = np.array((u * u, u * v, v * v, u * r, v * r, r * r))
    # The corner may lie between any two neighbouring beams, so each such place is tried. If the corner lies
    # after beam i, column i of `left` has the sums over the beams on its one side, from the first beam to
    # beam i. Column i of `right` has the sums over the other beams.
    left = np.cumsum(products, axis=1)
    right = left[:, -1:] - left
    return float((line_squared_error(left[:, :-1]) + line_squared_error(right[:, :-1])).min())


def _terms(segment: Segment) -> np.ndarray:
    """Return u = r^2 cos, v = r^2 sin and the range r of each beam, (3, M); a line has r = a u + b v."""
    ranges = segment.ranges
    return np.vstack([segment.directions * (ranges * ranges), ranges])


def line_squared_error(sums: np.ndarray) -> np.ndarray:
    """Return the squared errors of the best line r = a u + b v [m^2], from the sums uu, uv, vv, ur, vr, rr.

    In polar coordinates, a line has the equation 1 / r = a cos + b sin, with the range r of a beam and its
    angle. Multiplied by r^2, this is r = a u + b v, with u = r^2 cos and v = r^2 sin. A fit of this form
    minimises the errors of r, which are measured along the beams.

    Args:
        sums: sums over the beams of u times u, u times v, and so on, for one segment (6,) or for many (6, S).
    """
    uu, uv, vv, ur, vr, rr = sums
    # The best a and b solve [[uu, uv], [uv, vv]] (a, b) = (ur, vr). The sum of the squared errors of this
    # line is rr - (a ur + b vr). The lower limit keeps the determinant above 0 if all beams have almost the
    # same direction.
    determinant = np.maximum(uu * vv - uv * uv, 1e-9 * uu * vv)
    a_ur_plus_b_vr = (vv * ur * ur - 2.0 * uv * ur * vr + uu * vr * vr) / determinant
    return np.maximum(rr - a_ur_plus_b_vr, 0.0)
