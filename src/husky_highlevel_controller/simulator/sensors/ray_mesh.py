"""Ray intersection of a planar lidar with triangle meshes.

In: a mesh at a pose, the pose of the laser, its beams. Out: distances along the beams.

All beams lie in one plane, the scan plane. If a triangle has corners on both sides of this plane, the
triangle and the plane share a line segment. Beams can meet the mesh only on these segments. So a scan
computes the height of each corner over the scan plane, and then the points where its beams meet the few
segments. The time grows with the number of corners, not with beams times triangles, so no search tree is
needed.
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
    if not _ball_reaches_scan(mesh, origin, laser, max_range):
        return 0.0
    # 1. heights of the corners above the scan plane [m], which are their z in the laser's frame
    axes = np.array([along_axes(mesh.axes, axis) for axis in laser])  # the laser's axes in the mesh's frame
    offset = np.array(along_axes(laser, minus(mesh.position, origin)))  # mesh's origin in the laser's frame
    heights = mesh.vertices @ axes[2] + offset[2]
    # 2. the plane cuts the triangles that have corners on both sides
    a, b, c = (heights > 0.0)[mesh.faces]  # (F,) each: true if this corner of a triangle is above the plane
    cut = np.flatnonzero((a != b) | (b != c))
    if len(cut):
        start, end = _segments(mesh, cut, heights, axes[:2], offset[:2])
        _meet_segments(start, end, beams, distances)
    return inf


def _ball_reaches_scan(mesh: RayMesh, origin: Vector3, laser: Axes, max_range: float) -> bool:
    """Return whether the ball around a mesh reaches the scan plane and is in range; if not, no beam meets it.

    Args:
        mesh: the mesh at its pose.
        origin: position of the laser in the world [m].
        laser: axes of the laser in the world.
        max_range: a ball that is farther from the laser is out of range [m].
    """
    (ax, ay, az), (cx, cy, cz) = mesh.axes, mesh.centre
    # position of the mesh, plus the centre of the ball along the mesh's axes
    centre_in_world = (
        mesh.position[0] + cx * ax[0] + cy * ay[0] + cz * az[0],
        mesh.position[1] + cx * ax[1] + cy * ay[1] + cz * az[1],
        mesh.position[2] + cx * ax[2] + cy * ay[2] + cz * az[2],
    )
    x, y, height = along_axes(laser, minus(centre_in_world, origin))
    return abs(height) <= mesh.bound and hypot(x, y) - mesh.bound <= max_range


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
    corners = _lone_corner_first(mesh.faces[:, cut], heights)
    # x and y of the corners in the laser's frame, (2, 3, K) [m]
    points = np.array([mesh.vertices[corners] @ axis + shift for axis, shift in zip(axes, offset)])
    lone, second, third = points[:, 0], points[:, 1], points[:, 2]  # (2, K) each
    # The plane crosses the two edges that begin at the lone corner. For example, if the lone corner is 3 m
    # above the plane and the second corner is 1 m below, the crossing is at 3 / 4 of this edge.
    lone_height, second_height, third_height = heights[corners]
    start = lone + lone_height / (lone_height - second_height) * (second - lone)
    end = lone + lone_height / (lone_height - third_height) * (third - lone)
    return start, end


def _lone_corner_first(corners: Indices, heights: np.ndarray) -> Indices:
    """Return the corners of each triangle, rotated so that the corner that is alone on its side is first.

    The plane cuts each triangle, so one corner is on one side of the plane, and two are on the other side.

    Args:
        corners: three corners of each of the K triangles, (3, K).
        heights: heights of the mesh's corners above the plane [m].
    """
    above = heights[corners] > 0.0
    # number of the lone corner: 0 if corners 1 and 2 are on the same side, 1 if corners 0 and 2 are on the
    # same side, otherwise 2
    lone = np.full(corners.shape[1], 2)
    lone[above[0] == above[2]] = 1
    lone[above[1] == above[2]] = 0
    order = (lone + np.arange(3)[:, None]) % 3  # (3, K), such as 1, 2, 0 if corner 1 is alone
    rotated: Indices = corners[order, np.arange(corners.shape[1])]
    return rotated


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
    # The beams of a segment are from `low` to `high`. But a segment behind the laser, whose ends are for
    # example at 170 and -160 degrees, crosses the direction pi, which is the same as -pi. This segment has
    # two entries: from `high` to the last beam, and from the first beam to `low`.
    crosses_pi = high - low > pi
    crossing = np.flatnonzero(crosses_pi)
    segments = np.concatenate([np.arange(len(low)), crossing])
    from_bearings = np.concatenate([np.where(crosses_pi, high, low), np.full(len(crossing), -inf)])
    to_bearings = np.concatenate([np.where(crosses_pi, inf, high), low[crossing]])
    # bearings ascend, so the beams that may meet a segment are neighbours
    first_beams = bearings.searchsorted(from_bearings - _SLACK)
    counts = bearings.searchsorted(to_bearings + _SLACK, side="right") - first_beams
    has_beams = np.flatnonzero(counts)
    return segments[has_beams], first_beams[has_beams], counts[has_beams]


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
