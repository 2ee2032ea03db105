"""Casts a planar lidar's rays at boxes, cylinders, spheres and planes, in closed form.

In: shapes with poses, where the laser stands, its beams' bearings. Out: distances.
Must not know: ROS, PyBullet, noise.

Bullet's own rays see a cylinder through its collision margin: a pillar of 0.2 m at 20 m is a beam too wide
and its flank 2 cm off. Here every shape is exact, and the time grows with the beams that may hit something,
not with beams times shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Sequence, Tuple

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
    origin = np.array(pose_laser_in_world.position)
    turn = matrix_from_quat(pose_laser_in_world.quat_xyzw)
    beams = np.column_stack([np.cos(bearings), np.sin(bearings)])
    distances = np.full(len(bearings), np.inf)
    for point, normal in scene.planes:
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (normal @ (point - origin)) / (beams @ (turn.T @ normal)[:2])
        np.minimum(distances, np.where(along >= 0.0, along, np.inf), out=distances)

    centers = (scene.positions - origin) @ turn  # in the laser's frame
    solid, beam = _pairs(centers, scene.bounds, bearings, reach)
    if len(solid):
        to_shape = np.einsum("mji,jk->mik", scene.rotations, turn)  # laser to shape
        starts = np.einsum("mij,mj->mi", to_shape, -centers)
        directions = np.einsum("pij,pj->pi", to_shape[solid][:, :, :2], beams[beam])
        entries = _enter(scene.kinds[solid], scene.sizes[solid], starts[solid], directions)
        np.minimum.at(distances, beam, entries)
    return np.where(distances <= reach, distances, np.inf)


def _pairs(
    centers: np.ndarray, bounds: np.ndarray, bearings: np.ndarray, reach: float
) -> Tuple[np.ndarray, np.ndarray]:
    """Indices (P,) of shapes and beams that may meet, judged by the ball around each shape."""
    across = np.abs(centers[:, 2])
    flat = np.hypot(centers[:, 0], centers[:, 1])
    near = np.flatnonzero((across <= bounds) & (flat - bounds <= reach))
    flat, radius = (
        flat[near],
        np.sqrt(bounds[near] ** 2 - across[near] ** 2),
    )  # the ball, cut by the scan plane
    middle = np.arctan2(centers[near, 1], centers[near, 0])
    half = np.where(flat > radius, np.arcsin(np.minimum(radius / np.maximum(flat, 1e-9), 1.0)), np.pi)
    # a ball behind the laser may reach over the seam at +-pi: look there too
    near = np.concatenate([near, near, near])
    middle = np.concatenate([middle, middle - 2.0 * np.pi, middle + 2.0 * np.pi])
    half = np.concatenate([half, half, half]) + 1e-9
    first = np.searchsorted(bearings, middle - half)
    count = np.searchsorted(bearings, middle + half, side="right") - first
    solid = np.repeat(near, count)
    offsets = np.arange(len(solid)) - np.repeat(np.cumsum(count) - count, count)
    return solid, np.repeat(first, count) + offsets


def _enter(kinds: np.ndarray, sizes: np.ndarray, starts: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Where each ray (P, 3) enters its shape, in the shape's own frame; (P,) [m], +inf for a miss."""
    enter, leave = np.full(len(kinds), -np.inf), np.full(len(kinds), np.inf)
    for axes, applies in (
        ((0,), kinds == BOX),
        ((1,), kinds == BOX),
        ((2,), kinds != SPHERE),
        ((0, 1), kinds == CYLINDER),
        ((0, 1, 2), kinds == SPHERE),
    ):
        chosen = np.flatnonzero(applies)
        if len(chosen):
            columns = list(axes)
            near, far = _inside(
                starts[chosen][:, columns], directions[chosen][:, columns], sizes[chosen, axes[0]]
            )
            enter[chosen] = np.maximum(enter[chosen], near)
            leave[chosen] = np.minimum(leave[chosen], far)
    return np.where((enter <= leave) & (leave >= 0.0), np.maximum(enter, 0.0), np.inf)


def _inside(start: np.ndarray, direction: np.ndarray, radius: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Between which t |start + t direction| <= radius: a slab, disc or ball, by the number of columns."""
    a = np.einsum("pi,pi->p", direction, direction)
    b = np.einsum("pi,pi->p", start, direction)
    # perpendicular offset from the middle rather than b^2 - ac, which loses its digits far away
    with np.errstate(divide="ignore", invalid="ignore"):
        closest = -b / a
        offset = start + closest[:, None] * direction
        square = radius**2 - np.einsum("pi,pi->p", offset, offset)
        half = np.sqrt(square / a)
    within = np.einsum("pi,pi->p", start, start) <= radius**2
    parallel = a < 1e-18
    miss = np.where(parallel, ~within, square < 0.0)
    near = np.where(miss, np.inf, np.where(parallel, -np.inf, closest - half))
    far = np.where(miss, -np.inf, np.where(parallel, np.inf, closest + half))
    return near, far
