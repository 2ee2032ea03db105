"""Ray intersection of a planar lidar with triangle meshes.

In: a mesh at a pose, the pose of the laser, its beams. Out: distances along the beams.

The scan plane cuts a mesh in line segments, one for each triangle whose corners lie on both sides of it. So a
scan computes one height for each corner, and its beams meet only the segments. The time grows with the number
of corners, not with beams times triangles, so no search tree is needed.
"""

from __future__ import annotations

from math import hypot, inf, pi
from typing import NamedTuple, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import Beams, Pose, TriangleMesh, Vector3
from husky_highlevel_controller.geometry import Axes, along_axes, axes_from_quat, minus

Indices = np.ndarray

# [rad] each segment gets this additional width, so that no beam passes between two neighbouring segments
_SLACK = 1e-9


class RayMesh(NamedTuple):
    """Mesh of a scene."""

    vertices: np.ndarray  # (V, 3) [m] corners in the mesh's frame
    faces: np.ndarray  # (3, F) corners of each triangle, as indices of rows of `vertices`
    centre: Vector3  # [m] centre of the ball around the mesh, in the mesh's frame
    bound: float  # [m] radius of the ball around the mesh
    position: Vector3  # [m] position of the mesh's frame in the world
    axes: Sequence[Vector3]  # directions of the mesh's x, y and z axes in the world


def make_ray_mesh(mesh: TriangleMesh, pose_in_world: Pose) -> RayMesh:
    """Return a mesh at a pose, with the ball around the mesh."""
    low, high = mesh.bounds
    x, y, z = ((low + high) / 2.0).tolist()
    return RayMesh(
        vertices=mesh.vertices,
        faces=np.ascontiguousarray(mesh.faces.T),
        centre=(x, y, z),
        bound=hypot(*mesh.size) / 2.0,
        position=pose_in_world.position,
        axes=axes_from_quat(pose_in_world.quat_xyzw),
    )


def meet_mesh(
    mesh: RayMesh, origin: Vector3, laser: Axes, beams: Beams, max_range: float, distances: np.ndarray
) -> float:
    """Shorten the distances (N,) [m] of the beams that meet a mesh, in place.

    Args:
        mesh: the mesh at its pose.
        origin: position of the laser in the world [m].
        laser: axes of the laser in the world.
        beams: beams in the laser's frame.
        max_range: a mesh that is farther is skipped [m].
        distances: distances of the beams.

    Returns:
        0 if no beam can meet the mesh, otherwise inf. `cast_rays` takes the result as the largest distance
        [m] that this mesh can have put into `distances`.
    """
    # 1. no beam meets a mesh if the ball around the mesh does not reach the scan plane, or is out of range
    (ax, ay, az), (cx, cy, cz) = mesh.axes, mesh.centre
    # centre of the ball in the world, and then in the laser's frame
    middle = (
        mesh.position[0] + cx * ax[0] + cy * ay[0] + cz * az[0],
        mesh.position[1] + cx * ax[1] + cy * ay[1] + cz * az[1],
        mesh.position[2] + cx * ax[2] + cy * ay[2] + cz * az[2],
    )
    x, y, z = along_axes(laser, minus(middle, origin))
    if abs(z) > mesh.bound or hypot(x, y) - mesh.bound > max_range:
        return 0.0
    # 2. heights of the corners above the scan plane: `turned` (3, 3) has the laser's axes in the mesh's
    # frame, and `offset` is the position of the mesh's frame in the laser's frame
    turned = np.array([along_axes(mesh.axes, axis) for axis in laser])
    offset = along_axes(laser, minus(mesh.position, origin))
    heights = mesh.vertices @ turned[2] + offset[2]
    # 3. the plane cuts the triangles that have corners on both sides
    a, b, c = (heights > 0.0)[mesh.faces]  # (F,) each: true if this corner of a triangle is above the plane
    cut = np.flatnonzero((a != b) | (b != c))
    if len(cut):
        ends = _segments(mesh, cut, heights, turned[:2], np.array(offset[:2]))
        _meet_segments(*ends, beams, distances)
    return inf


def _segments(
    mesh: RayMesh, cut: Indices, heights: np.ndarray, axes: np.ndarray, offset: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Return the ends of the segments in which the scan plane cuts triangles, (2, K) each [m].

    Args:
        mesh: the triangles.
        cut: indices of the K triangles that the plane cuts.
        heights: heights of the mesh's corners above the plane [m].
        axes: the laser's x and y axes in the mesh's frame.
        offset: x and y of the mesh's origin in the laser's frame [m].
    """
    corners = mesh.faces[:, cut]  # (3, K)
    above = heights[corners] > 0.0
    # one corner of each triangle is alone on its side of the plane; change the order so that this corner
    # comes first
    lone = np.where(above[1] == above[2], 0, np.where(above[0] == above[2], 1, 2))
    corners = corners[(lone + np.arange(3)[:, None]) % 3, np.arange(len(cut))]
    first, second, third = heights[corners]
    # x and y of the corners in the laser's frame, (3, K) each [m]
    x, y = (mesh.vertices[corners] @ axis + shift for axis, shift in zip(axes, offset))
    # the plane crosses the two edges that begin at the first corner, because this corner is alone on its
    # side; the crossings are at these fractions of the edges' length
    to_second, to_third = first / (first - second), first / (first - third)
    start = np.array([each[0] + to_second * (each[1] - each[0]) for each in (x, y)])
    end = np.array([each[0] + to_third * (each[2] - each[0]) for each in (x, y)])
    return start, end


def _meet_segments(start: np.ndarray, end: np.ndarray, beams: Beams, distances: np.ndarray) -> None:
    """Shorten the distances (N,) [m] of the beams that meet line segments, in place.

    Args:
        start: x and y of one end of each segment in the laser's frame, (2, K) [m].
        end: x and y of the other end, (2, K) [m].
        beams: beams in the laser's frame, by ascending bearing.
        distances: distances of the beams.
    """
    # bearings between which the beams may meet each segment [rad]
    start_bearing, end_bearing = np.arctan2(start[1], start[0]), np.arctan2(end[1], end[0])
    low, high = np.minimum(start_bearing, end_bearing), np.maximum(start_bearing, end_bearing)
    # A segment behind the laser may cross the bearing +-pi, so its beams are at both ends of the scan. Then
    # the segment is listed twice: for the beams from `high` to the last beam, and from the first beam to
    # `low`.
    is_over_seam = high - low > pi
    segment = np.concatenate([np.arange(len(low)), np.flatnonzero(is_over_seam)])
    low, high = (
        np.concatenate([np.where(is_over_seam, high, low), np.full(is_over_seam.sum(), -inf)]),
        np.concatenate([np.where(is_over_seam, inf, high), low[is_over_seam]]),
    )
    # bearings ascend, so the beams that may meet a segment are neighbours
    first = beams.bearings.searchsorted(low - _SLACK)
    count = beams.bearings.searchsorted(high + _SLACK, side="right") - first
    met = np.flatnonzero(count)
    if not len(met):
        return
    # P pairs of a beam and a segment that this beam may meet
    beam, segment = beams_of(first[met], count[met]), segment[met].repeat(count[met])
    (x, y), (along_x, along_y) = start[:, segment], (end - start)[:, segment]
    direction_x, direction_y = beams.directions[:, beam]
    # a beam meets the line of a segment at a distance t with t direction = start + s along; the cross product
    # of both sides with `along` removes s and gives t
    entries = (x * along_y - y * along_x) / (direction_x * along_y - direction_y * along_x)
    entries[entries < 0.0] = inf  # the line of the segment crosses the beam behind the laser
    # a beam on the line of its segment gives 0 / 0 = nan, which `fmin` ignores; `at` is needed because a beam
    # may be in several pairs
    np.fmin.at(distances, beam, entries)


def beams_of(first: Indices, count: Indices) -> Indices:
    """Return the beams of all shapes, shape by shape, (P,).

    Each shape has `count` neighbouring beams from its beam `first` on, (K,) each. For example, first = (5, 9)
    and count = (2, 3) give (5, 6, 9, 10, 11).
    """
    ends = count.cumsum()
    return np.arange(ends[-1]) + (first - ends + count).repeat(count)
