"""Least-squares fits of a circle, a line and a corner to a segment of beams.

In: a `Segment`. Out: a `Circle`, and how well a line or two lines would do.

Sums over many beams are matrix products; what is solved for with them are a few plain numbers.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt
from typing import Callable, List, NamedTuple, Sequence, Tuple, TypeVar

import numpy as np

from husky_highlevel_controller.datatypes import Vector3

_RADIUS_WEIGHT = 0.6  # the expected radius counts as much as this many beams
_PLACE_WEIGHT = 1e-3  # and so little that the centre is on the line of sight
_LEAST_WEIGHT = 1e-6  # keeps the equations solvable
_FREE_WEIGHT = 1e-4  # the same where nothing is expected of the radius
MIN_COSINE = 0.3  # of incidence; grazing beams weigh no more than this one
_FEW = 24  # up to so many beams are summed one by one: saves a third of find_pillars, 5 % of a rollout
_MAX_WEIGHINGS = 3
_WEIGHED = 0.1  # share of the radius; weights are good for a centre that moves no farther
MAX_STEPS = 6
_SETTLED, _REFINED = 1e-5, 1e-4  # [m], a smaller step of the fit is the last
_SMOOTH, _SMOOTH_SHARE = 0.0015, 0.0075  # [m], of the radius: the algebraic fit is off by 0.2 mm

Products = List[List[float]]  # (4, 4) sums over beams: of derivatives of the error by x, y, r, and the error
Moments = Callable[[float, float, float], Products]  # of a circle's x, y, r: sums of products of the basis
Number = TypeVar("Number", float, np.ndarray)  # one value, or those of many segments
Row3 = Tuple[Number, Number, Number]
Matrix3 = Tuple[Row3[Number], Row3[Number], Row3[Number]]


class Segment(NamedTuple):
    """Neighbouring beams that may lie on one body (M of them)."""

    beams: List[int]  # which ones of the scan, ascending
    ranges: List[float]  # [m]
    near: float  # [m], the shortest
    step: float  # [rad], from one beam of the scan to the next

    @property
    def middle(self) -> float:
        """Half-way between the first and the last beam: the x axis of whatever is fitted."""
        return 0.5 * (self.beams[0] + self.beams[-1])


class Segments(NamedTuple):
    """Many segments of one scan (S of them) in arrays, without a list for each."""

    beams: np.ndarray  # (B,) of all segments, one after the other, ascending in each
    ranges: np.ndarray  # (B,) [m]
    counts: np.ndarray  # (S,) beams of each
    near: np.ndarray  # (S,) [m], the shortest range of each
    step: float  # [rad], from one beam of the scan to the next

    @property
    def starts(self) -> np.ndarray:
        """Index at which each segment begins in `beams` and `ranges`, (S,)."""
        starts: np.ndarray = np.cumsum(self.counts) - self.counts
        return starts

    def those(self, chosen: np.ndarray) -> Segments:
        """Segments for which `chosen`, (S,) bool, is true."""
        of = np.repeat(chosen, self.counts)
        return Segments(self.beams[of], self.ranges[of], self.counts[chosen], self.near[chosen], self.step)

    def one_by_one(self) -> List[Segment]:
        """Each by itself."""
        beams, ranges = self.beams.tolist(), self.ranges.tolist()
        bounds = zip(self.starts.tolist(), self.counts.tolist(), self.near.tolist())
        return [
            Segment(beams[start : start + count], ranges[start : start + count], near, self.step)
            for start, count, near in bounds
        ]


class Circle(NamedTuple):
    """A fitted circle."""

    x: float  # [m], centre, along the segment's middle
    y: float  # [m], centre, across it
    radius: float  # [m]
    free_radius: float  # [m], what the beams alone would make it
    free_slack: float  # [m], how far that may be wrong
    residual: float  # [m], root mean square distance of the end points
    sum_squared_error: float  # [m^2], sum of squares in the direction of the beams


def fit_circle(segment: Segment, radius: float, noise: float, hopeless: float) -> Circle:
    """Most probable circle, given the expected radius.

    Range noise acts along the beam, so a distance from the circle counts as much as the range would have to
    change (distance over the cosine of incidence). Where beams are few the radius stays as expected and the
    depth profile gives the place; where they are many they decide alone.

    Args:
        segment: of the beams.
        radius: what is expected [m].
        noise: differences in range not worth explaining [m].
        hopeless: a segment whose algebraic fit has this residual or more gets no geometric fit [m].
    """
    origin = segment.near + radius
    smooth = min(_SMOOTH, _SMOOTH_SHARE * radius)
    circle, products, residual = _algebraic_fit(segment, origin, radius, smooth)
    if smooth < residual < hopeless:
        circle, products, residual = _geometric_fit(segment, origin, radius)
    shift, slack = _free_radius(products, len(segment.ranges), noise)
    x, y, r = circle
    return Circle(origin + x, y, r, r + shift, slack, residual, sum_squared_error=max(products[3][3], 0.0))


def _algebraic_fit(
    segment: Segment, origin: float, radius: float, smooth: float
) -> Tuple[Vector3, Products, float]:
    """The circle (x, y, radius) of a segment, by sums made once, and its residual [m], good up to `smooth`.

    The distance of a point p from it is taken as (|p - c|^2 - r^2) / 2r, which is linear in the basis
    (p_x, p_y, 1, |p|^2). It is off by the square of the distance over 2r: by nothing that matters where the
    points are smooth. x and p_x count from `origin` [m] ahead, so that no digits are lost far away.
    """
    moments = (few_moments if len(segment.ranges) <= _FEW else many_moments)(segment, origin)
    x, y, r = 0.0, 0.0, radius
    for _ in range(_MAX_WEIGHINGS):
        before_x, before_y = x, y
        sums = moments(x, y, r)
        for _ in range(MAX_STEPS):
            products = _products(sums, x, y, r)
            (x, y, r), step = _improved((x, y, r), products, radius)
            if step < _SETTLED:
                break
        residual = sqrt(max(products[3][3], 0.0) / products[2][2])
        if residual > smooth or hypot(x - before_x, y - before_y) < _WEIGHED * radius:
            break
    return (x, y, r), products, residual


def few_moments(segment: Segment, origin: float) -> Moments:
    """Moments as of `many_moments`, beam by beam: sooner done for few beams."""
    points, middle, step = [], segment.middle, segment.step
    for beam, depth in zip(segment.beams, segment.ranges):
        angle = (beam - middle) * step
        c, s = cos(angle), sin(angle)
        x, y = depth * c - origin, depth * s
        points.append((x, y, x * x + y * y, c, s))

    def moments(x: float, y: float, r: float) -> Products:
        pp = pq = p = ps = qq = q = qs = n = s = ss = 0.0
        for px, py, square, cosine, sine in points:
            incidence = ((origin + x) * sine - y * cosine) / r  # the sine of it
            weight = 1.0 / max(1.0 - incidence * incidence, MIN_COSINE**2)
            wx, wy, ws = weight * px, weight * py, weight * square
            n, p, q, s = n + weight, p + wx, q + wy, s + ws
            pp, pq, ps = pp + wx * px, pq + wx * py, ps + wx * square
            qq, qs, ss = qq + wy * py, qs + wy * square, ss + ws * square
        return [[pp, pq, p, ps], [pq, qq, q, qs], [p, q, n, s], [ps, qs, s, ss]]

    return moments


def many_moments(segment: Segment, origin: float) -> Moments:
    """A function of a circle (x, y, radius): sums of the basis times itself, each beam with its weight there.

    A beam passes from the centre as far as the sine of incidence, as a share of the radius, says.

    Args:
        segment: of the beams.
        origin: from where x counts [m].
    """
    directions = _directions(segment)
    basis = np.empty((4, len(segment.ranges)))
    points = np.multiply(segment.ranges, directions, out=basis[:2])
    points[0] -= origin
    basis[2] = 1.0
    np.add(points[0] * points[0], points[1] * points[1], out=basis[3])

    def moments(x: float, y: float, r: float) -> Products:
        incidence = ((origin + x) * directions[1] - y * directions[0]) / r
        weighted = basis / np.maximum(1.0 - incidence * incidence, MIN_COSINE**2)
        sums: Products = (weighted @ basis.T).tolist()
        return sums

    return moments


def _directions(segment: Segment) -> np.ndarray:
    """Unit vectors of the beams, (2, M)."""
    angles = segment.step * (np.array(segment.beams) - segment.middle)
    return np.stack([np.cos(angles), np.sin(angles)])


def _products(moments: Products, x: float, y: float, r: float) -> Products:
    """The products at a circle, from the weighted moments of the basis; linear forms in it, multiplied out.

    Those of a point's distance are (p_x - x) / -r, (p_y - y) / -r and -1 by the circle's numbers, and itself
    (|p|^2 / 2 - x p_x - y p_y) / r + k.
    """
    (pp, pq, p, ps), (_, qq, q, qs), (_, _, n, s), (_, _, _, ss) = moments
    k = (x * x + y * y - r * r) / (2.0 * r)
    pe = (0.5 * ps - x * pp - y * pq) / r + k * p
    qe = (0.5 * qs - x * pq - y * qq) / r + k * q
    e = (0.5 * s - x * p - y * q) / r + k * n
    se = (0.5 * ss - x * ps - y * qs) / r + k * s
    xx = (pp - x * (2.0 * p - x * n)) / (r * r)
    xy = (pq - x * q - y * (p - x * n)) / (r * r)
    yy = (qq - y * (2.0 * q - y * n)) / (r * r)
    xr, yr, xe, ye = (p - x * n) / r, (q - y * n) / r, (x * e - pe) / r, (y * e - qe) / r
    ee = (0.5 * se - x * pe - y * qe) / r + k * e
    return [[xx, xy, xr, xe], [xy, yy, yr, ye], [xr, yr, n, -e], [xe, ye, -e, ee]]


def _geometric_fit(segment: Segment, origin: float, radius: float) -> Tuple[Vector3, Products, float]:
    """The circle (x, y, radius) of any segment, by true distances, and its residual [m]; x from `origin`."""
    directions = _directions(segment)
    points = segment.ranges * directions
    circle, columns = (0.0, 0.0, radius), np.empty((4, len(segment.ranges)))
    columns[2] = -1.0
    for steps_left in range(MAX_STEPS, -1, -1):
        x, y, r = circle
        inwards = np.subtract(((origin + x,), (y,)), points, out=columns[:2])
        rho = np.maximum(np.hypot(inwards[0], inwards[1]), 1e-9)
        inwards /= rho
        error = np.subtract(rho, r, out=columns[3])
        cosine = np.einsum("ij,ij->j", inwards, directions)
        weighted = columns / np.maximum(cosine, MIN_COSINE)
        products = (weighted @ weighted.T).tolist()
        better, step = _improved(circle, products, radius)
        if step < _REFINED or steps_left == 0:
            break
        circle = better
    return circle, products, sqrt(float(error @ error) / len(error))


def _improved(circle: Vector3, products: Products, radius: float) -> Tuple[Vector3, float]:
    """Step of Gauss-Newton for centre and radius, expected at the origin, and its length [m]."""
    x, y, r = circle
    dx, dy, dr = fit_step(circle, products, radius)
    longest = max(abs(dx), abs(dy), abs(dr))
    share = min(1.0, radius / longest) if longest > 0.0 else 1.0
    return (x - share * dx, y - share * dy, max(r - share * dr, 0.1 * radius)), longest


def fit_step(circle: Row3[Number], products: Sequence[Sequence[Number]], radius: float) -> Row3[Number]:
    """The whole Gauss-Newton step of centre and radius, of one circle or of as many as the arrays hold."""
    x, y, r = circle
    (xx, xy, xr, xe), (_, yy, yr, ye), (_, _, rr, re), _ = products
    return _apply(
        _inverse(xx + _LEAST_WEIGHT, xy, xr, yy + _PLACE_WEIGHT, yr, rr + _RADIUS_WEIGHT),
        (xe + _LEAST_WEIGHT * x, ye + _PLACE_WEIGHT * y, re + _RADIUS_WEIGHT * (r - radius)),
    )


def _free_radius(products: Products, count: int, noise: float) -> Tuple[float, float]:
    """Change of the radius that the beams alone would make, and its standard error [m]."""
    (xx, xy, xr, xe), (_, yy, yr, ye), (_, _, rr, re), (_, _, _, ee) = products
    covariance = _inverse(xx + _LEAST_WEIGHT, xy, xr, yy + _FREE_WEIGHT, yr, rr + _FREE_WEIGHT)
    dx, dy, dr = _apply(covariance, (xe, ye, re))
    spare = max(count - 3, 1e-3)
    variance = max(ee - (dx * xe + dy * ye + dr * re), 0.0) / spare
    spread = sqrt((variance + noise**2) * max(covariance[2][2], 0.0))
    return -dr, (2.0 + 4.0 / spare) * spread  # the factor follows Student's distribution


def _inverse(a: Number, b: Number, c: Number, d: Number, e: Number, f: Number) -> Matrix3[Number]:
    """Inverse of the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]]."""
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    scale = 1.0 / (a * aa + b * ab + c * ac)
    aa, ab, ac, bb, bc, cc = aa * scale, ab * scale, ac * scale, bb * scale, bc * scale, cc * scale
    return (aa, ab, ac), (ab, bb, bc), (ac, bc, cc)


def _apply(matrix: Matrix3[Number], vector: Row3[Number]) -> Row3[Number]:
    """Matrix times vector."""
    x, y, z = vector
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


# ---------------------------------------------------------------------------- lines and corners

# The inverse range of a straight wall is linear in the cosine and sine of the beam, 1 / r = a cos + b sin.
# Times r^2, so that it counts along the beam: r = a r^2 cos + b r^2 sin.


def line_sum_squared_error(segment: Segment) -> float:
    """Sum of squares along the beams of the best line [m^2]."""
    terms = _terms(segment)
    u, v, w = (terms @ terms.T).tolist()
    return float(line_squared_error(np.array((u[0], u[1], v[1], u[2], v[2], w[2]))))


def corner_sum_squared_error(segment: Segment) -> float:
    """Sum of squares along the beams of the best two lines, one for each side of a cut [m^2]."""
    terms = _terms(segment)
    left = np.cumsum(terms[[0, 0, 1, 0, 1, 2]] * terms[[0, 1, 1, 2, 2, 2]], axis=1)
    right = left[:, -1:] - left
    return float((line_squared_error(left[:, :-1]) + line_squared_error(right[:, :-1])).min())


def _terms(segment: Segment) -> np.ndarray:
    """r^2 cos, r^2 sin and r, (3, M)."""
    ranges = np.array(segment.ranges)
    return np.vstack([_directions(segment) * (ranges * ranges), ranges])


def line_squared_error(sums: np.ndarray) -> np.ndarray:
    """Sum of squares left by r = a u + b v, from the sums of uu, uv, vv, ur, vr, rr, (6, ...)."""
    uu, uv, vv, ur, vr, rr = sums
    spread = np.maximum(uu * vv - uv * uv, 1e-9 * uu * vv)
    return np.maximum(rr - (vv * ur * ur - 2.0 * uv * ur * vr + uu * vr * vr) / spread, 0.0)
