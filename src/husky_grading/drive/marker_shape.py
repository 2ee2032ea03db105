"""Shape of a drawn marker: reference point and extent, seen from the pillar's axis.

Source: visualization_msgs/Marker and RViz's marker display, which define what each kind draws in which frame.
"""

from __future__ import annotations

from math import atan2, hypot, pi
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import Pose, Vector3
from husky_highlevel_controller.geometry import transform_point

# constants of visualization_msgs/Marker
ARROW, LINE_STRIP, LINE_LIST, CUBE_LIST, SPHERE_LIST, POINTS = 0, 4, 5, 6, 7, 8
TEXT, MESH, TRIANGLES = 9, 10, 11
LINES = {LINE_STRIP, LINE_LIST}
LISTS = {*LINES, CUBE_LIST, SPHERE_LIST, POINTS, TRIANGLES}
MAX_POINTS = 1000  # only the first points of a marker are evaluated, at most this number
# [m] the mean of a marker's points counts as the marker's position only if the median distance of the points
# from the mean is at most this
MAX_SPREAD = 0.5
# corners of a cube with edges of 1 m around the marker's origin
_CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class Drawn(NamedTuple):
    """Place of a drawn marker in the world, and its distance from the pillar's vertical axis."""

    # [m] position of the marker: tip of an arrow, centre of a solid, mean of points, or end of a line
    position: Vector3
    # [m] horizontal distance from the pillar's axis to the nearest drawn point; 0 if the marker covers the
    # axis
    reach: float
    low: float  # [m] height of the lowest drawn point
    high: float  # [m] height of the highest drawn point


def draw(
    kind: int,
    pose_in_world: Pose,
    scale: Sequence[float],
    points: Sequence[Sequence[float]],
    axis: Tuple[float, float],
) -> Drawn:
    """Return the position and the extent of the shape that RViz draws of a marker, in the world.

    Args:
        kind: type of the marker, a constant of visualization_msgs/Marker.
        pose_in_world: pose of the marker.
        scale: sizes of the marker along its x, y and z [m].
        points: points of a list or an arrow, relative to the pose [m].
        axis: vertical axis of the pillar, x and y in the world [m].
    """
    # points that can be the marker's position, and corners of the space that the marker covers
    references, corners = _references_and_outline(kind, scale, points)
    placed = [transform_point(pose_in_world, point) for point in references]
    # the point that is nearest to the pillar counts as the marker's position
    position = min(placed, key=lambda point: hypot(point[0] - axis[0], point[1] - axis[1]))
    outline = np.array([transform_point(pose_in_world, corner) for corner in corners])
    low, high = float(outline[:, 2].min()), float(outline[:, 2].max())
    reach = hull_distance(outline[:, :2] - np.asarray(axis))
    return Drawn(position, reach, low, high)


def _references_and_outline(
    kind: int, scale: Sequence[float], points: Sequence[Sequence[float]]
) -> Tuple[Sequence[Sequence[float]], Sequence[Sequence[float]]]:
    """Return the points that can count as the position of a marker, and the corners of the space it covers.

    Of the points that can count, the point nearest to the pillar becomes the position. The covered space is
    the convex hull of the corners. All points are in the marker's frame [m].
    """
    origin = (0.0, 0.0, 0.0)
    if kind == ARROW:
        # an arrow with points leads from the first to the second point; without points, it begins at the
        # marker's origin and points along x, and its length is scale.x
        tip = points[1] if len(points) >= 2 else (float(scale[0]), 0.0, 0.0)
        return [tip], [tip]  # a student shows the pillar with the tip, so only the tip counts
    if kind in LISTS and len(points):
        measured = list(points[:MAX_POINTS])
        # a student may draw a line from the robot to the pillar, so each end of a line can be its position,
        # too
        ends = [measured[0], measured[-1]] if kind in LINES else []
        middle = _middle(np.array(measured, dtype=float))
        # the other points do not count as corners; otherwise far points on all sides of a pillar would cover
        # it
        return [middle, *ends], [middle, *ends]
    # a text turns with the camera, and the size of a mesh is only in its file, so only their origin counts
    if kind in (TEXT, MESH):
        return [origin], [origin]
    # any other shape, such as a cylinder, covers the box of its scale around the origin
    return [origin], (_CORNERS * np.asarray(scale, dtype=float)).tolist()


def _middle(points: np.ndarray) -> List[float]:
    """Return the middle of a marker's points, (N, 3) [m]: their mean, if most points are near it.

    Otherwise the mean may be where no point is drawn, so the point with the median distance from the mean is
    returned.
    """
    mean = points.mean(axis=0)
    distances = np.linalg.norm(points - mean, axis=1)
    if np.median(distances) <= MAX_SPREAD:
        middle = mean
    else:
        nearest_first = np.argsort(distances)  # indices of the points
        middle = points[nearest_first[len(points) // 2]]
    return [float(number) for number in middle]


def hull_distance(points: np.ndarray) -> float:
    """Return the distance from the origin to the convex hull of points, (N, 2) [m]; 0 inside the hull."""
    # The origin is inside the hull if it has points all around it. Then the angle from each point to the next
    # one, seen from the origin, is less than half a turn. The tolerance of 1e-9 rad is for rounding.
    bearings = sorted(atan2(y, x) for x, y in points)
    angles_to_next = np.diff([*bearings, bearings[0] + 2.0 * pi])
    if len(points) > 2 and angles_to_next.max() < pi - 1e-9:
        return 0.0
    # The nearest point of the hull lies on a line between two of the points, so the lines of all pairs are
    # tried. A point is also paired with itself, because a single point has no other pair.
    first_indices, second_indices = np.triu_indices(len(points))
    first, second = points[first_indices], points[second_indices]
    along = second - first
    # [m^2] never 0, because it is a divisor below
    squared_length = np.maximum((along**2).sum(axis=1), 1e-12)
    # The foot of the perpendicular from the origin to each line, as a fraction of the way from `first` (0) to
    # `second` (1). If the foot lies beyond an end of the line, this end is the nearest point.
    fraction = np.clip(-(first * along).sum(axis=1) / squared_length, 0.0, 1.0)
    nearest = first + fraction[:, np.newaxis] * along
    return float(np.sqrt((nearest**2).sum(axis=1)).min())
