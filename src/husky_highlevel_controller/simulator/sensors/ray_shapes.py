"""Ray intersection of a planar lidar with boxes, cylinders and spheres, in closed form.

In: numbers of one shape, or arrays of many shapes; the formulas are the same. Out: distances along the beams.

`prepare` takes the centre, the axes and the size of a shape in the laser's frame: numbers, or arrays (K,) for
K shapes. It returns rows (F, 2[, K]), to be multiplied by the direction of each beam, and numbers (G[, K]),
which are the same for all beams. `enter` takes these products (F, P) and the numbers (G, 1 or P), and returns
the distance at which each beam enters the shape, (P,) [m]; inf or nan if the beam misses the shape.
"""

from __future__ import annotations

from math import inf
from typing import Any, Callable, NamedTuple, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.geometry import dot

BOX, CYLINDER, SPHERE = 0, 1, 2

Number = Any  # a number of one shape, or an array with a number for each shape
Number3 = Tuple[Number, Number, Number]
Prepared = Tuple[Sequence[Any], Sequence[Number]]


def _prepare_box(center: Number3, axes: Sequence[Number3], size: Number3) -> Prepared:
    """Rows and numbers of a box for `_enter_box`, three of each kind, one for each axis of the box.

    A box is the intersection of three slabs. The rows are the x and y of the axes. The numbers are the centre
    along each axis, half of each edge, and how deep the laser is inside each slab (negative outside).
    """
    x, y, z = axes
    a, b, c = size  # halves of the edges
    i, j, k = dot(center, x), dot(center, y), dot(center, z)
    return (x[:2], y[:2], z[:2]), (i, j, k, a, b, c, a - abs(i), b - abs(j), c - abs(k))


def _enter_box(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter a box, because from there on they are inside all three slabs."""
    near, far = _slab(along, numbers[:3], numbers[3:6], numbers[6:])
    return _entries(np.maximum.reduce(near), np.minimum.reduce(far))


def _prepare_cylinder(center: Number3, axes: Sequence[Number3], size: Number3) -> Prepared:
    """Rows and numbers of a cylinder for `_enter_cylinder`, with the centre c and the axis e = (u, v, w).

    A beam d meets the side of the cylinder at the distances t with |(t d - c) x e| = radius. With m = c x e =
    (i, j, k) and s = d x e, this is (s.s) t^2 - 2 (s.m) t + m.m - radius^2 = 0. `_flank` solves it as
    t = (s.m -+ sqrt(radius^2 s.s - (d.m)^2)) / s.s. Each row gives a number for each d = (d_x, d_y, 0).
    """
    (x, y, z), ((u, v, w),), (radius, _, half) = center, axes, size  # `half` is half the length
    i, j, k = y * w - z * v, z * u - x * w, x * v - y * u  # m
    middle, square = x * u + y * v + z * w, radius * radius
    rows = (
        (i, j),  # d.m, for the root
        (v * k - w * j, w * i - u * k),  # s.m, which is d.(e x m)
        (v, -u),  # z of s; s.s is w^2 plus the square of this, because d is a unit vector
        (u, v),  # d.e, for the ends
    )
    depth = square - i * i - j * j - k * k  # negative if the laser is outside of the endless cylinder
    # the last three numbers are for the ends: centre along the axis, and depth of the laser between the ends
    return rows, (w * w, square, depth, middle, half, half - abs(middle))


def _enter_cylinder(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter the part of the endless cylinder (see `_flank`) between its ends."""
    a, ahead, root = _flank(along, numbers)
    # the numbers from 2 on are depth, middle, half, and depth between the ends, see `_prepare_cylinder`
    enter, leave = _span((ahead - root) / a, (ahead + root) / a, a < 1e-18, numbers[2])
    near, far = _slab(along[3], numbers[3], numbers[4], numbers[5])
    return _entries(np.maximum(enter, near), np.minimum(leave, far))


def enter_flank(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter a cylinder that is ahead of them, if no beam can meet its ends.

    This is `_enter_cylinder` without the steps that have no effect in this case. The case is an upright
    pillar and a level lidar, as in each scan of the course, where these steps would take a fifth of the time.
    """
    a, ahead, root = _flank(along, numbers)
    return (ahead - root) / a


def _flank(along: np.ndarray, numbers: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (a, ahead, root) of the cylinder without ends, which beams cross at t = (ahead -+ root) / a.

    The square of the root is ahead^2 - a (m.m - radius^2), computed as radius^2 a - (d.m)^2, because this is
    precise for a cylinder far away, too.
    """
    aside, ahead, cross, _ = along
    a = numbers[0] + cross * cross  # squared sine of the angle between beam and axis
    return a, ahead, np.sqrt(numbers[1] * a - aside * aside)


def _prepare_sphere(center: Number3, axes: Sequence[Number3], size: Number3) -> Prepared:
    """Terms of |t d - c| = radius, for a beam d = (d_x, d_y, 0) and the centre c = (x, y, z).

    With ahead = d.c and aside = d_x y - d_y x, ahead^2 + aside^2 = x^2 + y^2, so the equation becomes
    (t - ahead)^2 = radius^2 - z^2 - aside^2. The rows give aside and ahead, and the number is radius^2 - z^2.
    """
    x, y, z = center
    return ((y, -x), (x, y)), (size[0] * size[0] - z * z,)


def _enter_sphere(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances t = ahead - root at which beams enter a sphere; they leave it at ahead + root.

    The point of a beam that is nearest to the centre is at the distance `ahead`, and half of the beam's way
    through the sphere is `root`, by the equation of `_prepare_sphere`. The root is nan if the beam misses.
    """
    aside, ahead = along
    root = np.sqrt(numbers[0] - aside * aside)
    return _entries(ahead - root, ahead + root)


class Formula(NamedTuple):
    """Intersection formula of one kind of shape; see the module's docstring for `prepare` and `enter`."""

    axes: slice  # indices of the shape's axes that the formula needs
    prepare: Callable[[Number3, Sequence[Number3], Number3], Prepared]
    enter: Callable[[np.ndarray, np.ndarray], np.ndarray]


FORMULAS = (  # formulas in the order of the numbers BOX, CYLINDER and SPHERE
    Formula(slice(0, 3), _prepare_box, _enter_box),
    Formula(slice(2, 3), _prepare_cylinder, _enter_cylinder),
    Formula(slice(0, 0), _prepare_sphere, _enter_sphere),
)

# a ray is inside the shape from the first to the second distance [m]; if it misses the shape, a distance is
# nan or the first is larger
Span = Tuple[np.ndarray, np.ndarray]


def _slab(directions: np.ndarray, middles: np.ndarray, halves: np.ndarray, depths: np.ndarray) -> Span:
    """Span in which a ray is inside a slab: the interval of t with |t direction - middle| <= half.

    `depths` is half - |middle|, which is negative if the laser is outside the slab.
    """
    steep = np.abs(directions)
    middle, half = middles / directions, halves / steep
    return _span(middle - half, middle + half, steep < 1e-9, depths)


def _span(near: np.ndarray, far: np.ndarray, is_parallel: np.ndarray, depths: np.ndarray) -> Span:
    """Span from `near` to `far`, except for rays that are parallel to the surface.

    A parallel ray is inside everywhere, from -inf to inf, if the laser is inside (`depths` is not negative).
    Otherwise it is outside everywhere, and its span is empty, from inf to -inf.
    """
    if is_parallel.any():
        near_of_parallel = np.where(depths >= 0.0, -inf, inf)
        near = np.where(is_parallel, near_of_parallel, near)
        far = np.where(is_parallel, -near_of_parallel, far)
    return near, far


def _entries(enter: np.ndarray, leave: np.ndarray) -> np.ndarray:
    """Return the first distance from 0 on between `enter` and `leave`; +inf if there is no such distance."""
    enter = np.maximum(enter, 0.0)
    return np.where(enter <= leave, enter, inf)
