"""Casts a planar lidar's rays at boxes, cylinders, spheres and planes, in closed form.

In: shapes with poses, where the laser stands, its beams' bearings. Out: distances.
Must not know: ROS, PyBullet, noise.

Bullet's own rays see a cylinder through its collision margin: a pillar of 0.2 m at 20 m is a beam too wide
and its flank 2 cm off. Here every shape is exact, and the time grows with the beams that may hit something,
not with beams times shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, pi
from typing import Iterable, List, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import Box, Cylinder, Plane, Pose, Shape, Sphere
from husky_highlevel_controller.geometry import matrix_from_quat

BOX, CYLINDER, SPHERE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Scene:
    """What rays can hit. The sizes never change; the poses may be moved."""

    kinds: np.ndarray  # (M,) BOX, CYLINDER or SPHERE
    sizes: np.ndarray  # (M, 3) [m], half the edges of the box around each shape, along its own axes
    bounds: np.ndarray  # (M,) [m], radius of the ball around each shape
    positions: np.ndarray  # (M, 3) [m], centres in the world
    rotations: np.ndarray  # (M, 3, 3), shape to world
    planes: Tuple[Tuple[np.ndarray, np.ndarray], ...]  # (point, unit normal) of each plane, in the world

    def move(self, index: int, pose_in_world: Pose) -> None:
        """Put a solid shape somewhere else."""
        self.positions[index] = pose_in_world.position
        self.rotations[index] = matrix_from_quat(pose_in_world.quat_xyzw)


def make_scene(shapes: Sequence[Tuple[Shape, Pose]]) -> Scene:
    """Gather shapes and their poses in the world; the solid ones keep their order, planes stand apart."""
    kinds, sizes, solids = [], [], []
    planes: List[Tuple[np.ndarray, np.ndarray]] = []
    for shape, pose in shapes:
        if isinstance(shape, Plane):
            planes.append((np.array(pose.position), matrix_from_quat(pose.quat_xyzw) @ shape.normal))
            continue
        kind, size = _kind_and_size(shape)
        kinds.append(kind)
        sizes.append(size)
        solids.append(pose)
    scene = Scene(
        kinds=np.array(kinds, dtype=int),
        sizes=np.array(sizes, dtype=float).reshape(-1, 3),
        bounds=np.array([size[0] if kind == SPHERE else np.hypot(*size[1:]) if kind == CYLINDER
                         else np.linalg.norm(size) for kind, size in zip(kinds, sizes)]),
        positions=np.zeros((len(solids), 3)),
        rotations=np.zeros((len(solids), 3, 3)),
        planes=tuple(planes),
    )  # fmt: skip
    for index, pose in enumerate(solids):
        scene.move(index, pose)
    return scene


def _kind_and_size(shape: Shape) -> Tuple[int, Tuple[float, float, float]]:
    if isinstance(shape, Box):
        x, y, z = shape.size
        return BOX, (x / 2.0, y / 2.0, z / 2.0)
    if isinstance(shape, Cylinder):
        return CYLINDER, (shape.radius, shape.radius, shape.length / 2.0)
    if isinstance(shape, Sphere):
        return SPHERE, (shape.radius,) * 3
    raise TypeError(f"{shape} is not solid")


def cast_rays(scene: Scene, pose_laser_in_world: Pose, bearings: np.ndarray, reach: float) -> np.ndarray:
    """Distance to the first thing each beam meets, (N,) [m]; +inf for nothing within `reach`.

    A laser inside a solid shape reads 0; a plane is seen from either side.

    Args:
        scene: what can be hit.
        pose_laser_in_world: the beams start here and lie in its xy plane.
        bearings: (N,) [rad], ascending, within [-pi, pi].
        reach: [m].
    """
    # parallel to a face: inf, or more than a float holds; beside a disc: nan
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return _cast_rays(scene, pose_laser_in_world, bearings, reach)


def _cast_rays(scene: Scene, pose_laser_in_world: Pose, bearings: np.ndarray, reach: float) -> np.ndarray:
    origin = np.array(pose_laser_in_world.position)
    turn = matrix_from_quat(pose_laser_in_world.quat_xyzw)
    distances = np.full(len(bearings), np.inf)
    for point, normal in scene.planes:
        height, (x, y, _) = float(normal @ (point - origin)), (normal @ turn).tolist()
        if abs(height) <= hypot(x, y) * reach:  # or no beam gets there, as none of a level laser to the floor
            along = height / (x * np.cos(bearings) + y * np.sin(bearings))
            np.minimum(distances, along, out=distances, where=along >= 0.0)

    centers = (scene.positions - origin) @ turn  # in the laser's frame
    near, first, count = _candidates(centers, scene.bounds, bearings, reach)
    kinds = scene.kinds[near]
    for kind in (BOX, CYLINDER, SPHERE):
        chosen = np.flatnonzero(kinds == kind)
        if len(chosen):
            solid, (owner, beam) = near[chosen], _pairs(first[chosen], count[chosen])
            entries = _enter(kind, scene, solid, centers[solid], turn, owner, bearings[beam])
            np.minimum.at(distances, beam, entries)
    distances[distances > reach] = np.inf
    return distances


Indices = np.ndarray


def _candidates(
    centers: np.ndarray, bounds: np.ndarray, bearings: np.ndarray, reach: float
) -> Tuple[Indices, Indices, Indices]:
    """Shapes that beams may meet (K,), judged by the ball around each, the first such beam, and how many."""
    x, y, across = centers.T
    flat, square = np.hypot(x, y), bounds * bounds - across * across  # the ball is cut by the scan plane
    near = np.flatnonzero((square >= 0.0) & (flat - bounds <= reach))
    flat, radius = flat[near], np.sqrt(square[near])
    half = np.arcsin(np.minimum(radius / flat, 1.0)) + 1e-9
    half[flat <= radius] = pi + 1e-9  # the laser is inside the ball
    middle = np.arctan2(y[near], x[near])
    low, high = middle - half, middle + half
    # a ball behind the laser may reach over the seam at +-pi: look there too
    for over, round_trip in ((np.flatnonzero(low < -pi), 2.0 * pi), (np.flatnonzero(high > pi), -2.0 * pi)):
        if len(over):
            near = np.concatenate([near, near[over]])
            low, high = (np.concatenate([end, end[over] + round_trip]) for end in (low, high))
    first = bearings.searchsorted(low)
    count = bearings.searchsorted(high, side="right") - first
    met = np.flatnonzero(count)
    return near[met], first[met], count[met]


def _pairs(first: Indices, count: Indices) -> Tuple[Indices, Indices]:
    """Every beam of every shape: the shape's row (P,), and the beam (P,)."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) + (first - count.cumsum() + count)[owner]


def _enter(
    kind: int,
    scene: Scene,
    solid: Indices,
    centers: np.ndarray,
    turn: np.ndarray,
    owner: Indices,
    bearings: np.ndarray,
) -> np.ndarray:
    """Where beams (P,) enter the solid shapes (K,) that they are paired with; (P,) [m], +inf for a miss."""
    sizes, beams = scene.sizes[solid].T, (np.cos(bearings), np.sin(bearings))
    if kind == SPHERE:  # is the same from everywhere: no need for a frame of its own
        across = centers[:, 2]
        enter, leave = _disc(-centers.T[:2, owner], beams, (sizes[0] ** 2 - across**2)[owner])
    else:
        to_shape = scene.rotations[solid].transpose(0, 2, 1) @ turn
        starts = (to_shape @ -centers[:, :, None])[:, :, 0].T[:, owner]
        axes = to_shape.transpose(2, 1, 0)[:2, :, owner]  # the laser's x and y, in each shape's frame
        directions = beams[0] * axes[0] + beams[1] * axes[1]
        flat = slice(0 if kind == BOX else 2, 3)  # axes along which the shape lies between two planes
        enter, leave = _slabs(starts[flat], directions[flat], sizes[flat, owner])
        if kind == CYLINDER:
            near, far = _disc(starts[:2], directions[:2], (sizes[0] ** 2)[owner])
            enter, leave = np.maximum(enter, near), np.minimum(leave, far)
    return np.where((enter <= leave) & (leave >= 0.0), np.maximum(enter, 0.0), np.inf)


Span = Tuple[np.ndarray, np.ndarray]  # (P,) between which t a ray is inside [m]; nan or reversed: nowhere


def _slabs(starts: np.ndarray, directions: np.ndarray, halves: np.ndarray) -> Span:
    """Between which t |start + t direction| <= half on every axis (A, P)."""
    inverse = 1.0 / directions
    middle, half = -starts * inverse, np.abs(halves * inverse)
    near, far = middle - half, middle + half
    parallel = np.abs(directions) < 1e-9
    if parallel.any():
        outside = np.where(np.abs(starts) <= halves, -np.inf, np.inf)
        near, far = np.where(parallel, outside, near), np.where(parallel, -outside, far)
    return near.max(axis=0), far.min(axis=0)


def _disc(start: Iterable[np.ndarray], direction: Iterable[np.ndarray], square: np.ndarray) -> Span:
    """Between which t (start + t direction)^2 <= square, in a plane."""
    (x, y), (dx, dy) = start, direction
    a = dx * dx + dy * dy
    aside = x * dy - y * dx  # this and not b^2 - ac, which loses its digits far away
    closest, half = -(x * dx + y * dy) / a, np.sqrt((square - aside * aside / a) / a)
    near, far = closest - half, closest + half
    parallel = a < 1e-18
    if parallel.any():
        outside = np.where(x * x + y * y <= square, -np.inf, np.inf)
        near, far = np.where(parallel, outside, near), np.where(parallel, -outside, far)
    return near, far
