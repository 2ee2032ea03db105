"""Ray intersection of a planar lidar with boxes, cylinders and spheres, in closed form.

In: numbers of one shape, or arrays of many shapes; the formulas are the same. Out: distances along the beams.

The laser is the origin of all coordinates. A beam has the direction d = (d_x, d_y, 0), a unit vector, and the
points t d, with the distance t >= 0 from the laser. A formula finds the t at which the beam enters a shape.
Most of the work does not depend on the beam, so a formula has two functions: `prepare` is called once for a
shape, and `enter` for all beams at once, see `Formula`.
"""

from __future__ import annotations

from math import inf
from typing import Any, Callable, NamedTuple, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.geometry import cross, dot

BOX, CYLINDER, SPHERE = 0, 1, 2

Number = Any  # a number of one shape, or an array with a number for each shape
Number3 = Tuple[Number, Number, Number]
# What a formula needs to know of a shape: F rows and G numbers, which do not depend on the beam. A row (u, v)
# is the x and y of a vector. `enter` gets the scalar product of this vector with the direction d of each
# beam, u d_x + v d_y; the vector's z is not needed, because d_z is 0. For K shapes at once, u, v and each
# number are arrays (K,).
Prepared = Tuple[Sequence[Any], Sequence[Number]]


def _prepare_box(center: Number3, axes: Sequence[Number3], size: Number3) -> Prepared:
    """Return the rows and numbers of a box with its centre, axes and half edges in the laser's frame.

    A box is the intersection of three slabs. A slab is the space between two opposite faces of the box.

    - rows: x and y of each axis of the box. The scalar product with a beam's direction d is the component of
      d along this axis.
    - numbers, each for all three axes: the component of the centre along the axis, half of the edge, and the
      distance from the laser to the nearer face of the slab, negative if the laser is outside of the slab
    """
    x_axis, y_axis, z_axis = axes
    half_x, half_y, half_z = size
    along_x, along_y, along_z = dot(center, x_axis), dot(center, y_axis), dot(center, z_axis)
    depths = half_x - abs(along_x), half_y - abs(along_y), half_z - abs(along_z)
    rows = (x_axis[:2], y_axis[:2], z_axis[:2])
    return rows, (along_x, along_y, along_z, half_x, half_y, half_z, *depths)


def _enter_box(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter a box.

    A beam is inside the box where it is inside all three slabs: from the last of its three entries to the
    first of its three exits.

    Args:
        along: component of each beam's direction along each axis of the box, (3, P).
        numbers: middles and half thicknesses of the three slabs, and depths of the laser in them, (9, ...).
    """
    middles, halves, depths = numbers[:3], numbers[3:6], numbers[6:]  # a row for each slab
    entries, exits = _slab(along, middles, halves, depths)  # (3, P) each
    return _entry_or_inf(np.maximum.reduce(entries), np.minimum.reduce(exits))


def _prepare_cylinder(center: Number3, axes: Sequence[Number3], size: Number3) -> Prepared:
    """Return the rows and numbers of a cylinder with the centre c, and its axis as the unit vector e.

    The laser is the origin. A beam has the points t d, where d is a unit vector with d_z = 0. It meets
    the side of the cylinder where its point t d is `radius` away from the axis. The distance of a point p
    from the axis is |(p - c) x e|. For p = t d, with s = d x e and m = c x e, this is |t s - m|. So the
    equation for t, squared and solved, is::

        |t s - m| = radius
        (s.s) t^2 - 2 (s.m) t + m.m - radius^2 = 0
        t = (s.m -+ sqrt((s.m)^2 - s.s (m.m - radius^2))) / s.s
          = (s.m -+ sqrt(radius^2 s.s - (d.m)^2)) / s.s

    The last line is used, because the root in the line above it is not precise for a cylinder far away. The
    two lines are equal: s and m are at right angles to e, so s x m = (d.m) e. The squared length of this
    vector is (d.m)^2, and it is also s.s m.m - (s.m)^2. `_flank` computes s.s and the root.

    - rows: for the terms that depend on d.
    - numbers: e_z^2 and radius^2, for `_flank`; the depth of the laser in the cylinder without ends; and of
      the slab between the two ends, along the axis: its middle, half of its thickness, and the depth of the
      laser in it. A depth is negative if the laser is outside.
    """
    (axis,) = axes  # e
    radius, _, half_length = size  # half the edges of the box around the cylinder along x, y and z
    m = cross(center, axis)
    e_cross_m = cross(axis, m)
    (ex, ey, ez), (mx, my, mz) = axis, m
    rows = (
        (mx, my),  # the product with d is d.m
        e_cross_m[:2],  # the product with d is d.(e x m), which is equal to s.m
        (ey, -ex),  # the product with d is s_z, from which `_flank` computes s.s
        (ex, ey),  # the product with d is d.e, for the slab between the two ends
    )
    square_of_ez, square_of_radius = ez * ez, radius * radius
    # only the sign of this depth is needed, so it may be in m^2; m.m is the squared distance of the laser
    # from the axis
    depth_in_side = square_of_radius - mx * mx - my * my - mz * mz
    middle = dot(center, axis)
    depth_between_ends = half_length - abs(middle)
    numbers = (square_of_ez, square_of_radius, depth_in_side, middle, half_length, depth_between_ends)
    return rows, numbers


def _enter_cylinder(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter a cylinder.

    A beam is inside the cylinder where it is inside the cylinder without ends, and also inside the slab
    between the two ends. As in `_prepare_cylinder`, d is the direction of a beam, c the centre of the
    cylinder, e the unit vector along its axis, s = d x e, and m = c x e.

    Args:
        along: d.m, s.m, s_z and d.e of each beam, (4, P).
        numbers: e_z^2, radius^2, depth of the laser in the cylinder without ends; middle and half thickness
            of the slab, and depth of the laser in it, (6, ...). A depth is negative if the laser is outside.
    """
    d_m, s_m, s_z, d_e = along
    square_of_ez, square_of_radius, depth_in_side, middle, half_length, depth_between_ends = numbers
    s_s, root = _flank(d_m, s_z, square_of_ez, square_of_radius)
    is_parallel = s_s < 1e-18  # beam along the axis of the cylinder
    side_entry, side_exit = _span((s_m - root) / s_s, (s_m + root) / s_s, is_parallel, depth_in_side)
    slab_entry, slab_exit = _slab(d_e, middle, half_length, depth_between_ends)
    return _entry_or_inf(np.maximum(side_entry, slab_entry), np.minimum(side_exit, slab_exit))


def enter_flank(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter the side of a cylinder, for a faster scan of upright pillars.

    The result is the same as that of `_enter_cylinder` if no beam can meet the ends, if no beam is parallel
    to the axis, if the cylinder is not around the laser, and if no beam begins beyond the cylinder. Each scan
    of the course is such a case, because its pillar is upright and the lidar level. The omitted checks would
    take a fifth of the time.
    """
    d_m, s_m, s_z, _ = along
    s_s, root = _flank(d_m, s_z, square_of_ez=numbers[0], square_of_radius=numbers[1])
    return (s_m - root) / s_s


def _flank(
    d_m: np.ndarray, s_z: np.ndarray, square_of_ez: np.ndarray, square_of_radius: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Return s.s and root: beams meet the side of a cylinder at the distances (s.m -+ root) / s.s.

    A beam has the direction d. The cylinder has the centre c, and its axis is the unit vector e. With
    s = d x e and m = c x e, `_prepare_cylinder` finds root = sqrt(radius^2 s.s - (d.m)^2). The root is nan if
    the beam misses the cylinder.
    """
    # s_x = d_y e_z and s_y = -d_x e_z, because d_z = 0. So s_x^2 + s_y^2 = e_z^2, because d has the length 1.
    s_s = square_of_ez + s_z * s_z
    return s_s, np.sqrt(square_of_radius * s_s - d_m * d_m)


def _prepare_sphere(center: Number3, axes: Sequence[Number3], size: Number3) -> Prepared:
    """Return the rows and the number of a sphere with the centre c = (x, y, z).

    A beam meets the sphere where its point t d is `radius` away from c. The rows give two distances of c in
    the scan plane: `aside` to the side of the beam, and `ahead` along the beam. The number is
    radius^2 - z^2::

        (t - ahead)^2 + aside^2 + z^2 = radius^2
    """
    x, y, z = center
    radius, _, _ = size
    row_of_aside = (y, -x)  # the product with d is d_x y - d_y x
    row_of_ahead = (x, y)  # the product with d is d.c
    return (row_of_aside, row_of_ahead), (radius * radius - z * z,)


def _enter_sphere(along: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Distances at which beams enter a sphere, from the equation of `_prepare_sphere`.

    A beam is inside the sphere from `half_way` before the point that is nearest to the centre to `half_way`
    behind this point. `half_way` is nan if the beam misses.
    """
    aside, ahead = along
    half_way = np.sqrt(numbers[0] - aside * aside)
    return _entry_or_inf(ahead - half_way, ahead + half_way)


class Formula(NamedTuple):
    """Intersection formula of one kind of shape, for beams in the xy plane of the laser's frame.

    `prepare` computes what is the same for all beams of a shape: F rows, which are vectors (x, y), and G
    numbers. `enter` takes the scalar product of each row with the direction of each beam, and the numbers,
    and returns the distance at which each of the P beams enters the shape.
    """

    needed_axes: slice  # places of the axes that the formula needs among the shape's x, y and z axes
    # takes the centre, the needed axes and the half edges of the shape in the laser's frame; returns the rows
    # and the numbers
    prepare: Callable[[Number3, Sequence[Number3], Number3], Prepared]
    # takes the scalar products (F, P), and the numbers, (G, 1) for one shape or (G, P) for the shape of each
    # beam; returns the distances (P,) [m], inf or nan if a beam misses the shape
    enter: Callable[[np.ndarray, np.ndarray], np.ndarray]


_ALL_AXES, _ONLY_Z_AXIS, _NO_AXIS = slice(0, 3), slice(2, 3), slice(0, 0)
FORMULAS = (  # formulas in the order of the numbers BOX, CYLINDER and SPHERE
    Formula(_ALL_AXES, _prepare_box, _enter_box),
    Formula(_ONLY_Z_AXIS, _prepare_cylinder, _enter_cylinder),
    Formula(_NO_AXIS, _prepare_sphere, _enter_sphere),
)

# distances [m] at which a ray enters and leaves a shape; if the ray misses the shape, a distance is nan, or
# the first is larger than the second
Span = Tuple[np.ndarray, np.ndarray]


def _slab(directions: np.ndarray, middles: np.ndarray, halves: np.ndarray, depths: np.ndarray) -> Span:
    """Return the distances at which rays enter and leave a slab, the space between two parallel planes.

    All values are along the normal of the planes.

    Args:
        directions: component of each ray's direction.
        middles: middle of the slab, seen from the laser [m].
        halves: half of the slab's thickness [m].
        depths: depth of the laser in the slab [m], negative if the laser is outside.
    """
    speeds = np.abs(directions)  # way along the normal for each metre of the ray; 0 for a parallel ray
    middle, half = middles / directions, halves / speeds
    return _span(middle - half, middle + half, speeds < 1e-9, depths)


def _span(near: np.ndarray, far: np.ndarray, is_parallel: np.ndarray, depths: np.ndarray) -> Span:
    """Return the distances `near` and `far`, but replace them for rays that are parallel to the surface.

    A parallel ray never crosses the surface. If the laser is inside (`depths` is not negative), the whole ray
    is inside, from -inf to inf. Otherwise no part of the ray is inside, which is written as inf to -inf.
    """
    if is_parallel.any():
        near_of_parallel = np.where(depths >= 0.0, -inf, inf)
        near = np.where(is_parallel, near_of_parallel, near)
        far = np.where(is_parallel, -near_of_parallel, far)
    return near, far


def _entry_or_inf(enter: np.ndarray, leave: np.ndarray) -> np.ndarray:
    """Return the distance at which each ray enters a shape; 0 if the laser is inside; inf if the ray misses.

    A ray misses the shape if `enter` is larger than `leave`, if one of them is nan, or if the shape is behind
    the laser (`leave` is negative).
    """
    enter = np.maximum(enter, 0.0)
    return np.where(enter <= leave, enter, inf)
