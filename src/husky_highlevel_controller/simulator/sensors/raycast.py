"""Ray casting of a planar lidar against boxes, cylinders, spheres, planes and meshes, in closed form.

In: shapes with poses, the pose of the laser, the bearings of its beams. Out: distances.

Bullet's own rays stop at a margin around a cylinder. So a pillar of 0.2 m at a distance of 20 m would be one
beam too wide, and its side would be 2 cm wrong. Here every shape is exact, and the time grows with the number
of beams that may hit something, not with the number of beams times the number of shapes.

A call of NumPy costs about the same for one number as for a hundred. So a few shapes are computed one by one,
in plain numbers, each with the slice of the beams that may meet it. Many shapes are computed all at once.
Both ways use the same formulas. Meshes are in `ray_mesh.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan2, hypot, inf, pi, sqrt
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import (
    Beams,
    Box,
    Cylinder,
    Plane,
    Pose,
    Shape,
    Sphere,
    TriangleMesh,
    Vector3,
)
from husky_highlevel_controller.geometry import Axes, along_axes, axes_from_quat, dot, minus, rotate
from husky_highlevel_controller.simulator.sensors.ray_mesh import (
    Indices,
    RayMesh,
    beams_of,
    make_ray_mesh,
    meet_mesh,
)
from husky_highlevel_controller.simulator.sensors.ray_shapes import (
    BOX,
    CYLINDER,
    FORMULAS,
    SPHERE,
    enter_flank,
)

# Up to this number of solid shapes, the shapes are computed one by one; if there are more, all at once, as
# arrays. In the course's world of few shapes, arrays would take three times as long. In a world of 1000
# shapes, one by one would take ten times as long.
MAX_ONE_BY_ONE = 10
KINDS = {Box: BOX, Cylinder: CYLINDER, Sphere: SPHERE}


class RaySolid(NamedTuple):
    """Solid shape of a scene, in plain numbers."""

    kind: int  # BOX, CYLINDER or SPHERE
    size: Vector3  # [m] half the edges of the box around the solid, along the solid's axes
    bound: float  # [m] radius of the ball around the solid
    position: Vector3  # [m] position of the solid's centre in the world
    axes: Sequence[Vector3]  # directions of the solid's x, y and z axes in the world


@dataclass(frozen=True, eq=False)
class RayScene:
    """Shapes that rays can hit; their sizes are fixed, their poses may change.

    The solids are stored twice: as a list, for few solids that beams meet one by one, and as arrays, for many
    solids that beams meet all at once. `move` updates only the form that this scene uses, see `has_many`.
    """

    solids: List[RaySolid]  # (M,)
    planes: Tuple[Tuple[Vector3, Vector3], ...]  # point and unit normal of each plane in the world
    # the following arrays describe the same solids, with one row for each
    kinds: np.ndarray  # (M,)
    sizes: np.ndarray  # (M, 3)
    bounds: np.ndarray  # (M,)
    positions: np.ndarray  # (M, 3)
    axes: np.ndarray  # (M, 3, 3), an axis in each row
    meshes: List[RayMesh]

    @property
    def has_many(self) -> bool:
        """Return whether the beams meet the solids of this scene all at once, as arrays."""
        return len(self.solids) > MAX_ONE_BY_ONE

    def move(self, index: int, pose_in_world: Pose) -> None:
        """Set the pose of a solid shape."""
        position, axes = pose_in_world.position, axes_from_quat(pose_in_world.quat_xyzw)
        if self.has_many:
            self.positions[index], self.axes[index] = position, axes
        else:
            self.solids[index] = self.solids[index]._replace(position=position, axes=axes)

    def move_mesh(self, index: int, pose_in_world: Pose) -> None:
        """Set the pose of a mesh."""
        axes = axes_from_quat(pose_in_world.quat_xyzw)
        self.meshes[index] = self.meshes[index]._replace(position=pose_in_world.position, axes=axes)


def make_scene(shapes: Sequence[Tuple[Shape, Pose]]) -> RayScene:
    """Build a scene of shapes and their poses in the world.

    Solid shapes and meshes keep their order. The index in `RayScene.move` counts only the solid shapes, and
    the index in `move_mesh` counts only the meshes.
    """
    solids: List[RaySolid] = []
    meshes: List[RayMesh] = []
    planes: List[Tuple[Vector3, Vector3]] = []
    for shape, pose in shapes:
        if isinstance(shape, Plane):
            planes.append((pose.position, rotate(pose.quat_xyzw, shape.normal)))
            continue
        if isinstance(shape, TriangleMesh):
            meshes.append(make_ray_mesh(shape, pose))
            continue
        x, y, z = shape.size
        kind, size = KINDS[type(shape)], (x / 2.0, y / 2.0, z / 2.0)
        # radius of the ball around the solid [m]: distance from its centre to a corner of the box, to the rim
        # of the cylinder, or to the surface of the sphere
        bounds = {BOX: hypot(*size), CYLINDER: hypot(*size[1:]), SPHERE: size[0]}
        solids.append(RaySolid(kind, size, bounds[kind], pose.position, axes_from_quat(pose.quat_xyzw)))
    return RayScene(
        solids,
        tuple(planes),
        kinds=np.array([solid.kind for solid in solids], dtype=int),
        sizes=np.array([solid.size for solid in solids], dtype=float).reshape(-1, 3),
        bounds=np.array([solid.bound for solid in solids], dtype=float),
        positions=np.array([solid.position for solid in solids], dtype=float).reshape(-1, 3),
        axes=np.array([solid.axes for solid in solids], dtype=float).reshape(-1, 3, 3),
        meshes=meshes,
    )


# numpy gives no warnings, because inf and nan are expected: a beam parallel to a face gives inf or overflows,
# and a beam beside a round shape gives nan
@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def cast_rays(scene: RayScene, pose_laser_in_world: Pose, beams: Beams, max_range: float) -> np.ndarray:
    """Return the distance at which each beam meets the first body, (N,) [m]; +inf beyond `max_range` [m].

    A laser inside a solid shape reads 0; a plane or a mesh is seen from either side. Beams lie in the xy
    plane of the laser, at bearings within [-pi, pi].
    """
    origin, laser = pose_laser_in_world.position, axes_from_quat(pose_laser_in_world.quat_xyzw)
    distances = np.empty(len(beams.bearings))
    distances.fill(inf)
    # [m] upper bound of all finite distances; only if it is above `max_range`, the end of this function
    # searches for distances beyond `max_range`
    farthest = 0.0
    for point, normal in scene.planes:
        height, (x, y, _) = dot(minus(point, origin), normal), along_axes(laser, normal)
        # no beam reaches a plane that is farther, for example the floor below a level laser
        if abs(height) <= hypot(x, y) * max_range:
            # distance along each beam: distance to the plane along its normal, divided by the beam's
            # component along the normal
            along = height / np.dot((x, y), beams.directions)
            along[along < 0.0] = inf  # the plane is behind the laser
            np.fmin(distances, along, out=distances)
            farthest = inf
    if scene.has_many:  # many solids are met all at once, in arrays; a few are met faster one after the other
        _meet_many(scene, np.array(origin), np.array(laser), beams, max_range, distances)
        farthest = inf
    else:
        for solid in scene.solids:
            farthest = max(farthest, _meet_one(solid, origin, laser, beams, max_range, distances))
    for mesh in scene.meshes:
        farthest = max(farthest, meet_mesh(mesh, origin, laser, beams, max_range, distances))
    if farthest > max_range:
        distances[distances > max_range] = inf
    return distances


# ---------------------------------------------------------------------------- few shapes


def _meet_one(
    solid: RaySolid, origin: Vector3, laser: Axes, beams: Beams, max_range: float, distances: np.ndarray
) -> float:
    r"""Shorten the distances (N,) [m] of the beams that meet a solid, in place.

    The result is an upper bound of the distances at which beams meet the solid [m]; 0 if no beam can meet it.

    The ball around the shape, seen from above: the scan plane cuts it in a circle round (x, y)::

                          ___
                        /     \         flat    distance from the laser to (x, y)
        laser o--------(   +   )---     radius  of the circle, sqrt(bound^2 - z^2)
                spread  \_____/         spread  asin(radius / flat), on either side of atan2(y, x)
    """
    # 1. the ball around the solid, in the laser's frame, and the circle in which the scan plane cuts the
    # ball
    center = along_axes(laser, minus(solid.position, origin))
    x, y, z = center
    flat, square = hypot(x, y), solid.bound * solid.bound - z * z
    # 2. no beam meets a ball that is above, below or beyond the scan
    if square < 0.0 or flat - solid.bound > max_range:
        return 0.0
    farthest, radius = flat + solid.bound, sqrt(square)
    # 3. `prepare` computes once the rows and numbers that are the same for all beams; for each beam, `enter`
    # computes the distance from them. See the module `ray_shapes`
    needed_axes, prepare, enter = FORMULAS[solid.kind]
    axes = [along_axes(laser, axis) for axis in solid.axes[needed_axes]]
    row_terms, number_terms = prepare(center, axes, solid.size)
    rows, numbers = np.array(row_terms), np.array(number_terms)[:, None]
    if solid.kind == CYLINDER and flat > radius:
        ((u, v, w),) = axes  # the formula of a cylinder needs one axis, along its length
        # The ends of the cylinder need no test if no point of a beam up to `farthest` lies beyond an end. The
        # sum is the largest possible distance of such a point from the cylinder's middle, along its axis.
        if abs(dot(center, (u, v, w))) + hypot(u, v) * farthest <= solid.size[2]:
            enter = enter_flank
    # 4. only the beams towards the circle are computed, or all beams if the laser is inside the circle
    for first, last in _spans(beams, atan2(y, x), asin(radius / flat) if flat > radius else pi):
        entries = enter(np.dot(rows, beams.directions[:, first:last]), numbers)
        met = distances[first:last]
        np.fmin(met, entries, out=met)  # nan means that the beam misses; `fmin` ignores nan
    return farthest


def _spans(beams: Beams, middle: float, spread: float) -> List[Tuple[int, int]]:
    """Return ranges of beams within `spread` of `middle` [rad]: first beam, and last beam plus 1."""
    # 1e-9 rad are added, so that rounding loses no beam that touches an edge
    low, high = middle - spread - 1e-9, middle + spread + 1e-9
    ends = [(low, high)]
    # a ball behind the laser may reach over the angle +-pi, so the beams on the other side of this angle are
    # computed, too
    if low < -pi:
        ends.append((low + 2.0 * pi, high + 2.0 * pi))
    if high > pi:
        ends.append((low - 2.0 * pi, high - 2.0 * pi))
    return [(first, last) for first, last in beams.bearings.searchsorted(ends).tolist() if first < last]


# ---------------------------------------------------------------------------- many shapes


def _meet_many(
    scene: RayScene,
    origin: np.ndarray,
    laser: np.ndarray,
    beams: Beams,
    max_range: float,
    distances: np.ndarray,
) -> None:
    """Shorten the distances of the beams that meet any solid of a scene, all solids of a kind at once.

    Args:
        scene: the solids.
        origin: position of the laser in the world [m].
        laser: axes of the laser in the world, one in each row.
        beams: beams in the laser's frame.
        max_range: farther solids are skipped [m].
        distances: distances of the beams (N,) [m], changed in place.
    """
    centers = (scene.positions - origin) @ laser.T  # (M, 3) centres in the laser's frame
    # each candidate is a solid, with the first beam and the number of beams that may meet it
    solids, first_beams, beam_counts = _candidates(centers, scene.bounds, beams.bearings, max_range)
    kinds = scene.kinds[solids]
    # the formula of each kind of shape: indices of the axes that it needs, and the functions `prepare` and
    # `enter`, see the module `ray_shapes`
    for kind, (needed_axes, prepare, enter) in enumerate(FORMULAS):
        chosen = np.flatnonzero(kinds == kind)  # (K,) candidates of this kind
        if len(chosen):
            solid, beams_each = solids[chosen], beam_counts[chosen]
            # the K candidates have P pairs of a solid and a beam in all; `beam` has the beam of each pair
            beam = beams_of(first_beams[chosen], beams_each)
            # axes in the laser's frame, from (K, axis, xyz) to (axis, xyz, K), as `prepare` takes them
            axes = (scene.axes[solid, needed_axes] @ laser.T).transpose(1, 2, 0)
            prepared = prepare(centers[solid].T, axes, scene.sizes[solid].T)
            # the terms of each solid are repeated for each of its beams, from (..., K) to (..., P)
            rows, numbers = (np.array(part).repeat(beams_each, axis=-1) for part in prepared)
            x, y = beams.directions[:, beam]
            # each row is multiplied by the direction (x, y) of its beam. nan means that the beam misses, and
            # `fmin` ignores nan; `at` is needed because a beam may be in several pairs
            np.fmin.at(distances, beam, enter(rows[:, 0] * x + rows[:, 1] * y, numbers))


def _candidates(
    centers: np.ndarray, bounds: np.ndarray, bearings: np.ndarray, max_range: float
) -> Tuple[Indices, Indices, Indices]:
    """Find the pairs of solids and beams that may meet, judged by the ball around each solid.

    Args:
        centers: centres of the solids in the laser's frame, (M, 3) [m].
        bounds: radii of the balls, (M,) [m].
        bearings: bearings of the beams, ascending (N,) [rad].
        max_range: farther balls are skipped [m].

    Returns:
        Three arrays with an entry for each candidate: the solid, the first beam that may meet it, and the
        number of neighbouring beams that may meet it. A solid behind the laser may be two candidates, because
        it has beams at both ends of the scan.
    """
    # `square` is the squared radius of the circle in which the scan plane cuts a ball; it is negative if the
    # plane misses the ball
    x, y, height = centers.T
    distance, square = np.hypot(x, y), bounds * bounds - height * height
    near = np.flatnonzero((square >= 0.0) & (distance - bounds <= max_range))  # indices of solids
    distance, radius = distance[near], np.sqrt(square[near])
    # angle from the middle of each circle to its edges, seen from the laser [rad]; 1e-9 rad are added, so
    # that rounding loses no beam that touches an edge
    half_angle = np.arcsin(np.minimum(radius / distance, 1.0)) + 1e-9
    half_angle[distance <= radius] = pi + 1e-9  # the laser is inside the ball
    middle = np.arctan2(y[near], x[near])
    low, high = middle - half_angle, middle + half_angle
    # a ball behind the laser may reach over the bearing +-pi, so it becomes a second candidate, with bearings
    # that are turned by 2 pi
    for over, turn in ((np.flatnonzero(low < -pi), 2.0 * pi), (np.flatnonzero(high > pi), -2.0 * pi)):
        if len(over):
            near = np.concatenate([near, near[over]])
            low, high = (np.concatenate([edge, edge[over] + turn]) for edge in (low, high))
    # bearings ascend, so the beams from `low` to `high` are neighbours
    first = bearings.searchsorted(low)
    count = bearings.searchsorted(high, side="right") - first
    met = np.flatnonzero(count)  # candidates with at least one beam
    return near[met], first[met], count[met]
