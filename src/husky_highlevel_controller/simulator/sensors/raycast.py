"""Ray casting of a planar lidar against boxes, cylinders, spheres, planes and meshes, in closed form.

In: shapes with poses, the pose of the laser, the bearings of its beams. Out: distances.

Bullet's own rays are not used, because they stop at a margin around a cylinder. A pillar of 0.2 m at a
distance of 20 m would be one beam too wide, and its side would be 2 cm wrong. Here every shape is exact. Only
the beams that may meet a shape are computed, which are few for most shapes.

A call of NumPy takes about the same time for one number as for a hundred. So few shapes are computed one
after the other: a shape in plain numbers, with an array of the beams that may meet it. Many shapes are
computed all at once, in arrays with an entry for each pair of a shape and a beam that may meet. Both ways use
the same formulas, which are in `ray_shapes.py`. Meshes are in `ray_mesh.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan2, hypot, inf, pi, sqrt
from typing import Callable, List, NamedTuple, Sequence, Tuple

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
    Formula,
    Number3,
    enter_flank,
)

# Up to this number of solid shapes, the shapes are computed one after the other; more shapes are computed all
# at once, as arrays. In the course's world of few shapes, arrays would take three times as long. In a world
# of 1000 shapes, one after the other would take ten times as long.
MAX_ONE_BY_ONE = 10
KINDS = {Box: BOX, Cylinder: CYLINDER, Sphere: SPHERE}


class RaySolid(NamedTuple):
    """Solid shape of a scene at its pose, in plain numbers."""

    kind: int  # BOX, CYLINDER or SPHERE
    size: Vector3  # [m] half the edges of the box around the solid, along the solid's axes
    bound: float  # [m] radius of the ball around the solid
    position: Vector3  # [m] position of the solid's centre in the world
    axes: Sequence[Vector3]  # directions of the solid's x, y and z axes in the world


@dataclass(frozen=True, eq=False)
class RayScene:
    """Shapes that rays can hit; their sizes are fixed, their poses may change.

    The solids are stored twice: as a list, for scenes of few solids, which are computed one after the other,
    and as arrays, for scenes of many solids, which are computed all at once. `has_many` says which of the two
    forms is used. `move` updates only this form.
    """

    solids: List[RaySolid]  # (M,)
    planes: Tuple[Tuple[Vector3, Vector3], ...]  # point and unit normal of each plane in the world
    # the following arrays have the fields of `RaySolid` for the same solids, with one row for each solid
    kinds: np.ndarray  # (M,)
    sizes: np.ndarray  # (M, 3) [m]
    bounds: np.ndarray  # (M,) [m]
    positions: np.ndarray  # (M, 3) [m]
    axes: np.ndarray  # (M, 3, 3), an axis in each row
    meshes: List[RayMesh]

    @property
    def has_many(self) -> bool:
        """Return whether the solids of this scene are computed all at once, as arrays."""
        return len(self.solids) > MAX_ONE_BY_ONE

    def move(self, index: int, pose_in_world: Pose) -> None:
        """Set the pose of the solid shape with an index, see `make_scene`."""
        position, axes = pose_in_world.position, axes_from_quat(pose_in_world.quat_xyzw)
        if self.has_many:
            self.positions[index], self.axes[index] = position, axes
        else:
            self.solids[index] = self.solids[index]._replace(position=position, axes=axes)

    def move_mesh(self, index: int, pose_in_world: Pose) -> None:
        """Set the pose of the mesh with an index, see `make_scene`."""
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
        if kind == BOX:
            bound = hypot(*size)  # distance from the centre to a corner
        elif kind == CYLINDER:
            radius, _, half_length = size
            bound = hypot(radius, half_length)  # distance from the centre to the rim of an end
        else:
            bound = size[0]  # radius of the sphere
        solids.append(RaySolid(kind, size, bound, pose.position, axes_from_quat(pose.quat_xyzw)))
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


# NumPy's warnings are switched off, because inf and nan are usual results here: a beam parallel to a face
# gives inf or overflows, and a beam beside a round shape gives nan
@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def cast_rays(scene: RayScene, pose_laser_in_world: Pose, beams: Beams, max_range: float) -> np.ndarray:
    """Return the distance at which each beam meets the first body, (N,) [m]; +inf beyond `max_range` [m].

    A beam that begins inside a solid shape has the distance 0. A plane or a mesh has no inside: it is met
    from either side. The beams lie in the xy plane of the laser, at bearings within [-pi, pi].
    """
    origin, laser = pose_laser_in_world.position, axes_from_quat(pose_laser_in_world.quat_xyzw)
    # each shape below shortens the distances of the beams that meet this shape first
    distances = np.empty(len(beams.bearings))
    distances.fill(inf)
    # [m] no finite distance is larger than this bound, which is inf if no bound is known
    farthest = 0.0
    for point, normal in scene.planes:
        farthest = max(farthest, _meet_plane(point, normal, origin, laser, beams, max_range, distances))
    if scene.has_many:
        _meet_many(scene, np.array(origin), np.array(laser), beams, max_range, distances)
        farthest = inf
    else:
        for solid in scene.solids:
            farthest = max(farthest, _meet_one(solid, origin, laser, beams, max_range, distances))
    for mesh in scene.meshes:
        farthest = max(farthest, meet_mesh(mesh, origin, laser, beams, max_range, distances))
    if farthest > max_range:  # this saves time, because most scans of few shapes have no such distance
        distances[distances > max_range] = inf
    return distances


def _meet_plane(
    point: Vector3,
    normal: Vector3,
    origin: Vector3,
    laser: Axes,
    beams: Beams,
    max_range: float,
    distances: np.ndarray,
) -> float:
    """Shorten the distances (N,) [m] of the beams that meet a plane, in place.

    The result is 0 if no beam reaches the plane, such as the floor below a level laser. Otherwise the result
    is inf, because a beam may meet the plane at any distance.

    Args:
        point: a point of the plane in the world [m].
        normal: unit normal of the plane in the world.
        origin: position of the laser in the world [m].
        laser: axes of the laser in the world.
        beams: beams in the laser's frame.
        max_range: a plane that no beam reaches within this range is skipped [m].
        distances: distances of the beams.
    """
    height = dot(minus(point, origin), normal)  # [m] way from the laser to the plane along the normal
    x, y, _ = along_axes(laser, normal)  # the normal in the laser's frame
    # a beam has no z component, so it moves along the normal by at most hypot(x, y) for each metre
    if abs(height) > hypot(x, y) * max_range:
        return 0.0
    # For each metre of its length, a beam moves along the normal by the scalar product of its direction and
    # the normal. The beam meets the plane where its whole motion along the normal is `height`.
    to_plane = height / np.dot((x, y), beams.directions)
    to_plane[to_plane < 0.0] = inf  # the plane is behind the laser
    np.fmin(distances, to_plane, out=distances)
    return inf


# ------------------------------------------------------------ scenes of few shapes, one after the other


def _meet_one(
    solid: RaySolid, origin: Vector3, laser: Axes, beams: Beams, max_range: float, distances: np.ndarray
) -> float:
    r"""Shorten the distances (N,) [m] of the beams that meet a solid, in place.

    The result is an upper bound of the distances at which beams meet the solid [m]; 0 if no beam can meet it.
    If it is below `max_range`, the caller need not look for distances above `max_range`.

    Most beams cannot meet the solid, because they do not meet the ball around it. The scan plane cuts this
    ball in a circle round (x, y), which is drawn here from above. Only the beams within `half_angle` of the
    centre of the circle are computed::

                              ___
                            /     \         to_middle   distance from the laser to (x, y)
            laser o--------(   +   )---     radius      of the circle, sqrt(bound^2 - z^2)
                half_angle  \_____/         half_angle  asin(radius / to_middle)
    """
    # 1. the centre of the solid in the laser's frame
    center = along_axes(laser, minus(solid.position, origin))
    x, y, z = center
    to_middle, radius_squared = hypot(x, y), solid.bound * solid.bound - z * z
    # 2. no beam meets a ball that is above or below the scan plane, or farther than `max_range`
    if radius_squared < 0.0 or to_middle - solid.bound > max_range:
        return 0.0
    farthest, radius = to_middle + solid.bound, sqrt(radius_squared)
    # 3. only the beams towards the circle are computed, or all beams if the laser is inside the circle
    is_inside_circle = to_middle <= radius
    half_angle = pi if is_inside_circle else asin(radius / to_middle)
    enter_solid = _entry_function(solid, center, laser, farthest, is_inside_circle)
    for first, end in _beams_around(beams, atan2(y, x), half_angle):
        entries = enter_solid(beams.directions[:, first:end])
        distances_there = distances[first:end]  # a view, so that the next line changes `distances`
        # a beam that misses has inf or nan; `fmin` ignores nan
        np.fmin(distances_there, entries, out=distances_there)
    return farthest


def _entry_function(
    solid: RaySolid, center: Vector3, laser: Axes, farthest: float, may_be_inside: bool
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that computes the distances at which beams enter a solid.

    The returned function takes x and y of the directions of P beams in the laser's frame, (2, P). It returns
    the distances, (P,) [m]; inf or nan for a beam that misses the solid. The work that is the same for all
    beams is done before, once.

    Args:
        solid: the solid.
        center: centre of the solid in the laser's frame [m].
        laser: axes of the laser in the world.
        farthest: largest distance at which a beam can meet the solid [m].
        may_be_inside: true if the laser may be inside the solid.
    """
    formula: Formula = FORMULAS[solid.kind]
    axes = [along_axes(laser, axis) for axis in solid.axes[formula.needed_axes]]  # axes in the laser's frame
    rows, numbers = formula.prepare(center, axes, solid.size)
    enter = formula.enter
    if solid.kind == CYLINDER and not may_be_inside:
        (axis,), (_, _, half_length) = axes, solid.size
        if _stays_between_ends(center, axis, half_length, farthest):
            enter = enter_flank  # faster, because it leaves out the ends; the laser must be outside
    rows_array, numbers_column = np.array(rows), np.array(numbers)[:, None]
    return lambda directions: enter(np.dot(rows_array, directions), numbers_column)


def _stays_between_ends(center: Vector3, axis: Vector3, half_length: float, length: float) -> bool:
    """Return whether all beams of a length stay between the planes of a cylinder's two ends.

    So these beams can meet only the side of the cylinder.

    Args:
        center: centre of the cylinder in the laser's frame [m].
        axis: unit vector along the cylinder in the laser's frame.
        half_length: half of the cylinder's length [m].
        length: length of the beams [m].
    """
    x, y, _ = axis
    laser_offset = abs(dot(center, axis))  # [m] distance of the cylinder's middle along the axis
    # a beam has no z component, so it moves along the axis by at most hypot(x, y) for each metre
    return laser_offset + hypot(x, y) * length <= half_length


def _beams_around(beams: Beams, middle: float, half_angle: float) -> List[Tuple[int, int]]:
    """Return the ranges of beams whose bearings differ from `middle` by at most `half_angle` [rad].

    A range is the index of its first beam, and the index behind its last beam. There may be two ranges, at
    both ends of the scan, because the bearings pi and -pi are the same direction.
    """
    # 1e-9 rad are added, so that rounding loses no beam that touches an edge
    low, high = middle - half_angle - 1e-9, middle + half_angle + 1e-9
    limits = [(low, high)]
    if low < -pi:
        limits.append((low + 2.0 * pi, high + 2.0 * pi))
    if high > pi:
        limits.append((low - 2.0 * pi, high - 2.0 * pi))
    # bearings ascend, so the beams between two limits are neighbours
    return [(first, end) for first, end in beams.bearings.searchsorted(limits).tolist() if first < end]


# ------------------------------------------------------------ scenes of many shapes, all at once


def _meet_many(
    scene: RayScene,
    origin: np.ndarray,
    laser: np.ndarray,
    beams: Beams,
    max_range: float,
    distances: np.ndarray,
) -> None:
    """Shorten the distances of the beams that meet any solid of a scene, for all solids of a kind at once.

    A pair is a solid and a beam that may meet. All pairs of one kind of solid are computed in one array.

    Args:
        scene: the solids.
        origin: position of the laser in the world [m].
        laser: axes of the laser in the world, one in each row.
        beams: beams in the laser's frame.
        max_range: farther solids are skipped [m].
        distances: distances of the beams (N,) [m], changed in place.
    """
    centers = (scene.positions - origin) @ laser.T  # (M, 3) centres in the laser's frame
    # a candidate is a solid with neighbouring beams that may meet it: the first beam, and their number
    solids, first_beams, beam_counts = _candidates(centers, scene.bounds, beams.bearings, max_range)
    kinds = scene.kinds[solids]
    for kind, formula in enumerate(FORMULAS):  # FORMULAS[kind] is the formula of BOX, CYLINDER or SPHERE
        of_kind = np.flatnonzero(kinds == kind)  # indices of the K candidates of this kind
        if not len(of_kind):
            continue
        # for each candidate: its solid, and the number of its beams, (K,) each
        solids_of_kind, counts = solids[of_kind], beam_counts[of_kind]
        # for each pair: its beam (P,); the pairs of one candidate come one after the other
        beams_of_pairs = beams_of(first_beams[of_kind], counts)
        # the A axes that the formula needs, in the laser's frame: (K, A, 3), and then (A, 3, K)
        axes = (scene.axes[solids_of_kind, formula.needed_axes] @ laser.T).transpose(1, 2, 0)
        entries = _entries_of_pairs(
            formula,
            centers[solids_of_kind].T,
            axes,
            scene.sizes[solids_of_kind].T,
            counts,
            beams.directions[:, beams_of_pairs],
        )
        # A beam that misses has inf or nan; `fmin` ignores nan. A beam may be in several pairs; without `at`,
        # only one of them would count.
        np.fmin.at(distances, beams_of_pairs, entries)


def _entries_of_pairs(
    formula: Formula,
    center: Number3,
    axes: Sequence[Number3],
    size: Number3,
    count: Indices,
    direction: np.ndarray,
) -> np.ndarray:
    """Return the distance at which the beam of each pair enters the solid of the pair, (P,) [m].

    A beam that misses the solid has inf or nan.

    Args:
        formula: formula of the kind of the K solids.
        center: x, y and z of the solids' centres in the laser's frame, (3, K) [m].
        axes: the A axes of the solids that the formula needs, in the laser's frame, (A, 3, K).
        size: half edges of the solids, (3, K) [m].
        count: number of pairs of each solid, (K,); the pairs of one solid come one after the other.
        direction: x and y of the direction of each pair's beam, (2, P).
    """
    # For each solid: F vectors (x, y), of which the formula needs the scalar products with the beams'
    # directions, and G numbers, which are the same for all beams. The shapes are (F, 2, K) and (G, K).
    rows_of_solids, numbers_of_solids = formula.prepare(center, axes, size)
    # the values of a solid are repeated for each of its pairs
    rows = np.array(rows_of_solids).repeat(count, axis=-1)  # (F, 2, P)
    numbers = np.array(numbers_of_solids).repeat(count, axis=-1)  # (G, P)
    x, y = direction
    products = rows[:, 0] * x + rows[:, 1] * y  # scalar product of each row with the beam's direction (F, P)
    return formula.enter(products, numbers)


def _candidates(
    centers: np.ndarray, bounds: np.ndarray, bearings: np.ndarray, max_range: float
) -> Tuple[Indices, Indices, Indices]:
    """Find the beams that may meet each solid: those towards the ball around the solid.

    The scan plane cuts the ball in a circle, which is drawn in `_meet_one`.

    Args:
        centers: centres of the solids in the laser's frame, (M, 3) [m].
        bounds: radii of the balls, (M,) [m].
        bearings: bearings of the beams, ascending (N,) [rad].
        max_range: farther balls are skipped [m].

    Returns:
        Three arrays with an entry for each candidate: the index of the solid, the first beam that may meet
        it, and the number of neighbouring beams that may meet it. A solid behind the laser may be two
        candidates, because it has beams at both ends of the scan.
    """
    x, y, z = centers.T
    # distance from the laser to the middle of each circle, and its squared radius, which is negative if the
    # scan plane misses the ball
    to_middle, radius_squared = np.hypot(x, y), bounds * bounds - z * z
    # indices of the K solids whose circles are within `max_range`
    near = np.flatnonzero((radius_squared >= 0.0) & (to_middle - bounds <= max_range))
    middle = np.arctan2(y[near], x[near])  # bearing of the middle of each circle
    half_angle = _half_angles(to_middle[near], np.sqrt(radius_squared[near]))
    solids, low, high = _with_other_end(near, middle - half_angle, middle + half_angle)
    # bearings ascend, so the beams from `low` to `high` are neighbours
    first_beams = bearings.searchsorted(low)
    counts = bearings.searchsorted(high, side="right") - first_beams
    has_beams = np.flatnonzero(counts)
    return solids[has_beams], first_beams[has_beams], counts[has_beams]


def _half_angles(to_middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the angle from the middle of each circle to its edge, seen from the laser, (K,) [rad].

    The angle is pi if the laser is inside the circle, because all beams may meet the solid then. In addition,
    1e-9 rad are added, so that rounding loses no beam that touches an edge.

    Args:
        to_middle: distances from the laser to the middles of the circles (K,) [m].
        radius: radii of the circles (K,) [m].
    """
    # if the laser is inside, the ratio is above 1, for which `arcsin` would give nan
    sine = np.minimum(radius / to_middle, 1.0)
    return np.where(to_middle <= radius, pi, np.arcsin(sine)) + 1e-9


def _with_other_end(
    solids: Indices, low: np.ndarray, high: np.ndarray
) -> Tuple[Indices, np.ndarray, np.ndarray]:
    """Add each solid behind the laser a second time, for its beams at the other end of the scan.

    The bearings pi and -pi are the same direction. So a solid from 170 to 190 degrees has beams at the left
    end of the scan, up to 180 degrees, and also at the right end, from -180 degrees on. The solid is added
    again, from -190 to -170 degrees. In the same way, a solid from -190 to -170 degrees is added from 170 to
    190 degrees.

    Args:
        solids: index of each solid (K,).
        low: right edge of each solid, seen from the laser (K,) [rad].
        high: left edge of each solid (K,) [rad].

    Returns:
        The same three arrays, with an additional entry for each solid that reaches over the direction pi.
    """
    over_right, over_left = np.flatnonzero(low < -pi), np.flatnonzero(high > pi)
    if not len(over_right) and not len(over_left):
        return solids, low, high
    return (
        np.concatenate([solids, solids[over_right], solids[over_left]]),
        np.concatenate([low, low[over_right] + 2.0 * pi, low[over_left] - 2.0 * pi]),
        np.concatenate([high, high[over_right] + 2.0 * pi, high[over_left] - 2.0 * pi]),
    )
