"""Ray intersection of a planar lidar with triangle meshes.

In: a mesh at a pose, the pose of the laser, its beams. Out: distances along the beams.

All beams lie in one plane, the scan plane. It cuts each triangle that has corners on both sides of the plane
in a line segment, and beams can meet the mesh only on these segments. So a scan computes the height of each
corner over the scan plane, and then meets its beams with the few segments. The time grows with the number of
corners, not with beams times triangles, so no search tree is needed.
"""

from __future__ import annotations

from math import hypot, inf, pi
from typing import NamedTuple, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import Beams, Pose, TriangleMesh, Vector3
from husky_highlevel_controller.geometry import Axes, along_axes, axes_from_quat, minus

Indices = np.ndarray

# [rad] each segment is treated as wider by this angle at both ends; otherwise rounding could let a beam pass
# between two neighbouring segments
_SLACK = 1e-9


class RayMesh(NamedTuple):
    """Mesh at a pose, with the ball around the mesh for a quick test whether beams can meet it."""

    vertices: np.ndarray  # (V, 3) [m] corners in the mesh's frame
    faces: np.ndarray  # (3, F) three corners of each triangle, as row numbers of `vertices`
    centre: Vector3  # [m] centre of the ball around the mesh, in the mesh's frame
    bound: float  # [m] radius of the ball around the mesh
    position: Vector3  # [m] position of the mesh's frame in the world
    axes: Sequence[Vector3]  # directions of the mesh's x, y and z axes in the world


def make_ray_mesh(mesh: TriangleMesh, pose_in_world: Pose) -> RayMesh:
    """Return a mesh at a pose in the form that `meet_mesh` takes."""
    low, high = mesh.bounds  # opposite corners of the box around the mesh
    x, y, z = ((low + high) / 2.0).tolist()
    return RayMesh(
        vertices=mesh.vertices,
        faces=np.ascontiguousarray(mesh.faces.T),
        centre=(x, y, z),
        bound=hypot(*mesh.size) / 2.0,  # half the diagonal of the box
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
        0 if no beam can meet the mesh, otherwise inf. `cast_rays` takes the result as an upper bound of the
        distances at which beams meet the mesh. The real bound is not computed, so inf stands for it.
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
    # 2. heights of the corners above the scan plane [m]
    laser_in_mesh = np.array([along_axes(mesh.axes, axis) for axis in laser])  # axes of the laser (3, 3)
    mesh_in_laser = along_axes(laser, minus(mesh.position, origin))  # position of the mesh's frame [m]
    heights = mesh.vertices @ laser_in_mesh[2] + mesh_in_laser[2]
    # 3. the plane cuts the triangles that have corners on both sides
    a, b, c = (heights > 0.0)[mesh.faces]  # (F,) each: true if this corner of a triangle is above the plane
    cut = np.flatnonzero((a != b) | (b != c))
    if len(cut):
        start, end = _segments(mesh, cut, heights, laser_in_mesh[:2], np.array(mesh_in_laser[:2]))
        _meet_segments(start, end, beams, distances)
    return inf


def _segments(
    mesh: RayMesh, cut: Indices, heights: np.ndarray, axes: np.ndarray, offset: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Return the two ends of the line segments in which the scan plane cuts triangles, (2, K) each [m].

    An end is given by its x and y in the laser's frame.

    Args:
        mesh: the triangles.
        cut: indices of the K triangles that the plane cuts.
        heights: heights of the mesh's corners above the plane [m].
        axes: the laser's x and y axes in the mesh's frame.
        offset: x and y of the mesh's origin in the laser's frame [m].
    """
    corners = mesh.faces[:, cut]  # (3, K)
    above = heights[corners] > 0.0
    # number of the corner that is alone on its side of the plane: 0 if corners 1 and 2 are on the same side,
    # 1 if corners 0 and 2 are on the same side, otherwise 2
    lone = np.full(len(cut), 2)
    lone[above[0] == above[2]] = 1
    lone[above[1] == above[2]] = 0
    # rotate the corners of each triangle, so that the lone corner comes first; for example, if corner 1 is
    # alone, its triangle has the order 1, 2, 0
    order = (lone + np.arange(3)[:, None]) % 3  # (3, K)
    corners = corners[order, np.arange(len(cut))]
    first, second, third = heights[corners]
    # x and y of the corners in the laser's frame, (3, K) each [m]
    x, y = (mesh.vertices[corners] @ axis + shift for axis, shift in zip(axes, offset))
    # the plane crosses the two edges that begin at the lone corner, at these fractions of their lengths
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
    segments, first_beams, beam_counts = _segments_and_beams(start, end, beams.bearings)
    if not len(segments):
        return
    # beam and segment of each of the P pairs that may meet
    beam, segment = beams_of(first_beams, beam_counts), segments.repeat(beam_counts)
    (x, y), (along_x, along_y) = start[:, segment], (end - start)[:, segment]
    direction_x, direction_y = beams.directions[:, beam]
    # A beam meets the line of a segment at the distance t if t * direction = start + s * along, for some
    # number s. The cross product of both sides with `along` removes s, because along x along is 0, and gives
    # t.
    entries = (x * along_y - y * along_x) / (direction_x * along_y - direction_y * along_x)
    entries[entries < 0.0] = inf  # the line of the segment crosses the beam behind the laser
    # A beam along its segment gives 0 / 0 = nan, which `fmin` ignores. A beam may be in several pairs;
    # without `at`, only one of them would count.
    np.fmin.at(distances, beam, entries)


def _segments_and_beams(
    start: np.ndarray, end: np.ndarray, bearings: np.ndarray
) -> Tuple[Indices, Indices, Indices]:
    """Find the beams that may meet each line segment: those between the bearings of its two ends.

    Args:
        start: x and y of one end of each segment in the laser's frame, (2, K) [m].
        end: x and y of the other end, (2, K) [m].
        bearings: bearings of the beams, ascending (N,) [rad].

    Returns:
        Three arrays with an entry for each segment that has such beams: the index of the segment, its first
        beam, and the number of its neighbouring beams. A segment behind the laser may have two entries,
        because it has beams at both ends of the scan.
    """
    start_bearing, end_bearing = np.arctan2(start[1], start[0]), np.arctan2(end[1], end[0])
    low, high = np.minimum(start_bearing, end_bearing), np.maximum(start_bearing, end_bearing)
    # A segment behind the laser may cross the direction pi, which is the same as -pi. Its beams are then from
    # `high` to the last beam, and from the first beam to `low`. For example, the ends may be at 170 and -160
    # degrees. For the beams up to `low`, the segment gets a second entry, which is appended.
    behind = np.flatnonzero(high - low > pi)
    segment = np.concatenate([np.arange(len(low)), behind])
    from_bearing = np.concatenate([low, np.full(len(behind), -inf)])
    to_bearing = np.concatenate([high, low[behind]])
    from_bearing[behind], to_bearing[behind] = high[behind], inf
    # bearings ascend, so the beams that may meet a segment are neighbours
    first_beam = bearings.searchsorted(from_bearing - _SLACK)
    count = bearings.searchsorted(to_bearing + _SLACK, side="right") - first_beam
    has_beams = np.flatnonzero(count)
    return segment[has_beams], first_beam[has_beams], count[has_beams]


def beams_of(first: Indices, count: Indices) -> Indices:
    """Return the indices of the beams of several shapes in one array, shape by shape, (P,).

    Each shape has `count` neighbouring beams from its beam `first` on, (K,) each. For example, first = (5, 9)
    and count = (2, 3) give (5, 6, 9, 10, 11).
    """
    ends = count.cumsum()  # number of results up to the end of each shape
    place_of_first = ends - count  # place of the first beam of each shape among the results
    # The beams of a shape are numbered one by one, like the places of the results. So the beam at a place is
    # the place plus `first - place_of_first`, which is the same number for all beams of a shape.
    return np.arange(ends[-1]) + (first - place_of_first).repeat(count)
