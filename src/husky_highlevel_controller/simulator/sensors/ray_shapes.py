"""Ray intersection of a planar lidar with boxes, cylinders and spheres, in closed form.

In: numbers of one shape, or arrays of many shapes; the formulas are the same. Out: distances along the beams.

The beam with the direction d = (d_x, d_y, 0) has the points t d, with the distance t >= 0 from the laser. A
formula finds the t at which the beam enters a shape. It has two functions:

- `prepare` computes once what does not depend on the beam. It takes the centre, the axes and the size of a
  shape in the laser's frame: numbers, or arrays (K,) for K shapes. It returns rows (F, 2[, K]) and numbers
  (G[, K]). The caller multiplies each row by the d of each beam.
- `enter` takes these products (F, P) and the numbers (G, 1 or P), and returns the distance at which each beam
  enters the shape, (P,) [m]; inf or nan if the beam misses the shape.
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
    """Return the rows and numbers of a box.

    A box is the intersection of three slabs, one across each axis. There are three rows, the x and y of each
    axis; d times a row is the component of d along the axis. There are three numbers of each kind: the centre
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
    """Return the rows and numbers of a cylinder with the centre c and the axis e = (u, v, w).

    A beam meets the side of the cylinder if its point t d is `radius` away from the axis. With m = c x e =
    (i, j, k) and s = d x e, this is an equation for t, which `_flank` solves::

        |(t d - c) x e| = radius
        (s.s) t^2 - 2 (s.m) t + m.m - radius^2 = 0
        t = (s.m -+ sqrt(radius^2 s.s - (d.m)^2)) / s.s
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
    # `_flank` needs the first two numbers. The last three describe the slab between the ends: its middle and
    # half of its thickness along the axis, and how deep the laser is inside it.
    return rows, (w * w, square, depth, middle, half, half - abs(middle))


def _enter_cylinder(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter the part of the endless cylinder (see `_flank`) between its ends."""
    a, ahead, root = _flank(along, numbers)
    # a beam parallel to the axis has a = 0; number 2 is the laser's depth in the endless cylinder, and
    # numbers 3 to 5 describe the slab between the ends, see `_prepare_cylinder`
    enter, leave = _span((ahead - root) / a, (ahead + root) / a, a < 1e-18, numbers[2])
    near, far = _slab(along[3], numbers[3], numbers[4], numbers[5])
    return _entries(np.maximum(enter, near), np.minimum(leave, far))


def enter_flank(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter a cylinder that is ahead of them, if no beam can meet its ends.

    The result is the same as of `_enter_cylinder`, which also checks the ends, parallel beams and a laser
    inside the cylinder. An upright pillar and a level lidar, as in each scan of the course, do not need these
    checks, which would take a fifth of the time.
    """
    a, ahead, root = _flank(along, numbers)
    return (ahead - root) / a


def _flank(along: np.ndarray, numbers: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (a, ahead, root): beams cross the cylinder without ends at the distances (ahead -+ root) / a.

    In the last equation of `_prepare_cylinder`, a is s.s, ahead is s.m, and root is the square root. This
    form of the root is precise for a cylinder far away, too; the usual ahead^2 - a (m.m - radius^2) is not.
    """
    aside, ahead, cross, _ = along  # products of the rows: d.m, s.m, z of s, d.e
    a = numbers[0] + cross * cross  # squared sine of the angle between beam and axis
    return a, ahead, np.sqrt(numbers[1] * a - aside * aside)


def _prepare_sphere(center: Number3, axes: Sequence[Number3], size: Number3) -> Prepared:
    """Return the rows and the number of a sphere with the centre c = (x, y, z).

    A beam meets the sphere if its point t d is `radius` away from c. The rows give two distances of c in the
    scan plane: `ahead` along the beam, and `aside` to the side of the beam. The number is radius^2 - z^2::

        (t - ahead)^2 + aside^2 + z^2 = radius^2
    """
    x, y, z = center
    return ((y, -x), (x, y)), (size[0] * size[0] - z * z,)


def _enter_sphere(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter a sphere, from the equation of `_prepare_sphere`.

    A beam is nearest to the centre at the distance `ahead`. `root` is half of the beam's way through the
    sphere; nan if the beam misses.
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

    `directions` are the components of the rays along the slab's axis, and `middles` is its middle on this
    axis. `depths` is half - |middle|, which is negative if the laser is outside the slab.
    """
    speeds = np.abs(directions)  # way along the axis per distance t; 0 for a ray parallel to the slab
    middle, half = middles / directions, halves / speeds
    return _span(middle - half, middle + half, speeds < 1e-9, depths)


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
