"""Markers as RViz draws them: the pieces of a Marker message, and the set of markers that are shown.

In: visualization_msgs. Out: meshes, lines, points and texts in the marker's own frame.
"""

from __future__ import annotations

from math import isfinite
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from nav_msgs.msg import Path
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from husky_highlevel_controller.datatypes import Pose, Rgba
from husky_highlevel_controller.geometry import matrix_from_quat, quat_between
from husky_highlevel_controller.ros.conversions import pose_from_msg
from husky_web import shapes
from husky_web.shapes import Label, Lines, Mesh, MeshFile, Piece, Points, Solid

# largest number of copies of a cube or sphere in a list; a view with more copies does not turn smoothly
MAX_COPIES = 2000
# largest number of different colours of one marker's triangles or copies; more colours are rounded
MAX_COLORS = 64
# largest number of points of one marker, and largest cost of all markers, so that the browser is fast enough
# for the page's emergency stop; a cost of 1 is the time to draw one point of a point cloud
MAX_POINTS, MAX_COST = 100_000, 300_000
# cost of each copy in a list; smallest cost of a solid, and also of lines and points; cost of a text
COPY_COST, SOLID_COST, TEXT_COST = 30, 150, 600
MAX_LETTERS = 500  # largest number of characters of a text
# length of an arrow's head as a fraction of the arrow's length, if the marker does not give the length of the
# head
ARROW_HEAD = 0.23
# colour and width [m] of a nav_msgs/Path; green, as in RViz
PATH_COLOR, PATH_WIDTH = ColorRGBA(0.1, 0.8, 0.1, 1.0), 0.03


class MarkerKey(NamedTuple):
    """Name of a marker on the network; a new marker replaces the earlier marker of this name."""

    topic: str
    namespace: str
    id: int


def primitives(marker: Marker) -> List[Piece]:
    """Return the shapes of a marker in its own frame; empty if RViz would reject it."""
    # size [m] of a shape, or factors of a mesh file; for lines, x is the width; for points, x and y are the
    # size
    size = (marker.scale.x, marker.scale.y, marker.scale.z)
    if not all(isfinite(value) for value in size):
        return []
    kind = marker.type
    if kind in _UNIT_SHAPES:
        return [Solid(_UNIT_SHAPES[kind](), _rgba(marker.color), size)]
    if kind == Marker.ARROW:
        return _arrow(marker, size)
    if kind == Marker.TEXT_VIEW_FACING:
        return [Label(marker.text)] if marker.text.strip() else []
    if kind == Marker.MESH_RESOURCE:
        own_colors = marker.mesh_use_embedded_materials
        return [MeshFile(marker.mesh_resource, size, None if own_colors else _rgba(marker.color))]
    points = points_of(marker)
    if not np.isfinite(points).all():
        return []
    colors = _colors(marker, len(points))  # (N, 4) red, green, blue and opacity of each point, 0 to 1
    if kind in (Marker.LINE_STRIP, Marker.LINE_LIST):
        return _lines(kind, points, colors, size[0])
    if kind == Marker.POINTS and len(points):
        return [Points(points, _bytes(colors[:, :3]), max(size[0], size[1]))]
    if kind == Marker.TRIANGLE_LIST:
        whole = 3 * (len(points) // 3)  # number of points that form complete triangles
        # axes (triangle, corner, coordinate); the points of a TRIANGLE_LIST are scaled, as in RViz
        corners = points[:whole].reshape(-1, 3, 3) * np.array(size)
        colors_of_first_corners = colors[:whole:3]  # a triangle has the colour of its first corner
        return _by_color(
            corners, colors_of_first_corners, lambda group: shapes.triangles(np.concatenate(group))
        )
    if kind in (Marker.CUBE_LIST, Marker.SPHERE_LIST):
        # a copy of the shape at each of the first MAX_COPIES points, stretched to the marker's size
        unit = shapes.cube() if kind == Marker.CUBE_LIST else shapes.sphere()
        return _by_color(
            points[:MAX_COPIES],
            colors[:MAX_COPIES],
            lambda group: shapes.copies(unit, size, np.array(group)),
        )
    return []


_UNIT_SHAPES = {Marker.CUBE: shapes.cube, Marker.SPHERE: shapes.sphere, Marker.CYLINDER: shapes.cylinder}


def appearance(marker: Marker) -> Tuple[Any, ...]:
    """Return the values of a marker from which `primitives` makes its shapes, for a comparison.

    A marker whose appearance has not changed is not drawn again. The scale is rounded to whole millimetres,
    because the controller measures the width of its pillar's cylinder, so the width changes a little with
    each scan.
    """
    scale, color = marker.scale, marker.color
    return (
        marker.type,
        (round(scale.x, 3), round(scale.y, 3), round(scale.z, 3)),
        (color.r, color.g, color.b, color.a),
        tuple((p.x, p.y, p.z) for p in marker.points),
        tuple((c.r, c.g, c.b, c.a) for c in marker.colors),
        marker.text,
        marker.mesh_resource,
        marker.mesh_use_embedded_materials,
    )


def frame_of_message(msg: Any) -> str:
    """Return the frame of a message, without a leading slash."""
    return str(msg.header.frame_id).lstrip("/")


def points_of(marker: Marker) -> np.ndarray:
    """Return the points (N, 3) float32 [m] of a marker, in its own frame."""
    return np.array([(p.x, p.y, p.z) for p in marker.points], np.float32).reshape(-1, 3)


def markers_of(msg: Any) -> Sequence[Marker]:
    """Return the markers of a Marker, a MarkerArray or a Path.

    A path becomes a marker with a line. An empty path becomes a marker that deletes this line.
    """
    if isinstance(msg, Marker):
        return [msg]
    if not isinstance(msg, Path):
        return list(msg.markers)
    line = Marker(header=msg.header, type=Marker.LINE_STRIP, color=PATH_COLOR)
    line.action = Marker.ADD if msg.poses else Marker.DELETE
    line.scale.x, line.pose.orientation.w = PATH_WIDTH, 1.0
    line.points = [stamped.pose.position for stamped in msg.poses]
    return [line]


def pose_of(marker: Marker) -> Optional[Pose]:
    """Return the marker's pose in its frame, or None if a number is not finite.

    A quaternion of zeros means no rotation, as in RViz.
    """
    position, quat = pose_from_msg(marker.pose)
    if not all(isfinite(value) for value in (*position, *quat)):
        return None
    length = sum(value * value for value in quat) ** 0.5
    if length < 1e-6:
        return Pose(position)
    x, y, z, w = (value / length for value in quat)  # a sender's quaternion may have another length than 1
    return Pose(position, (x, y, z, w))


def cost(marker: Marker) -> int:
    """Return the cost of drawing a marker; a cost of 1 is the time to draw one point of a cloud."""
    if marker.type in (Marker.CUBE_LIST, Marker.SPHERE_LIST):
        copies = min(len(marker.points), MAX_COPIES)
        return max(COPY_COST * copies, _least_cost_of_colors(marker))
    if marker.type == Marker.TEXT_VIEW_FACING:
        return TEXT_COST
    if marker.type == Marker.TRIANGLE_LIST:
        return max(len(marker.points), _least_cost_of_colors(marker))
    return max(SOLID_COST, len(marker.points))


def _least_cost_of_colors(marker: Marker) -> int:
    """Return the least cost of a marker that is drawn as one solid for each of its colours.

    Each solid costs at least SOLID_COST, even if it has only a few triangles.
    """
    colors = min(len(marker.colors), MAX_COLORS)
    return SOLID_COST * max(colors, 1)  # a marker without a list of colours has a single colour


class Markers:
    """Markers that are shown: they are added, replaced, deleted and expire, and their cost is limited."""

    def __init__(self) -> None:
        self.shown: Dict[MarkerKey, Marker] = {}  # the marker whose message came last is the last one
        self.is_full = False  # true if a marker was left out, because the cost would exceed MAX_COST
        self._cost = 0
        # [s] ROS time of the end of the lifetime, of each marker that has a lifetime
        self._ends: Dict[MarkerKey, float] = {}
        self._last_time = 0.0  # [s] ROS time of the last call of `expire`

    def apply(self, topic: str, marker: Marker, now: float) -> None:
        """Apply a message that came at the ROS time `now` [s]."""
        key = MarkerKey(topic, marker.ns, marker.id)
        if marker.action in (Marker.ADD, Marker.MODIFY):
            # the new marker replaces the old one with the same key, so the cost of the old one no longer
            # counts
            self._remove(key)
            # a marker that is too long for the browser is shown without its end
            del marker.points[MAX_POINTS:], marker.colors[MAX_POINTS:]
            marker.text = marker.text[:MAX_LETTERS]
            if self._cost + cost(marker) > MAX_COST:
                self.is_full = True
                return
            self.shown[key] = marker
            self._cost += cost(marker)
            lifetime = marker.lifetime.to_sec()
            if lifetime > 0.0:
                self._ends[key] = now + lifetime
        elif marker.action == Marker.DELETE:
            self._remove(key)
        elif marker.action == Marker.DELETEALL:
            for key in list(self.shown):
                if key.topic == topic:
                    self._remove(key)

    def expire(self, now: float) -> None:
        """Remove markers whose lifetime has ended at the ROS time `now` [s].

        If ROS time has jumped back, for example after a reset of the simulation, all markers with a lifetime
        are removed, because they belong to the time before.
        """
        has_jumped_back = now < self._last_time
        self._last_time = now
        for key in [key for key, end in self._ends.items() if has_jumped_back or now >= end]:
            self._remove(key)

    def clear(self) -> None:
        """Remove all markers."""
        self.shown.clear()
        self._ends.clear()
        self._cost, self.is_full = 0, False

    def _remove(self, key: MarkerKey) -> None:
        """Remove a marker, its cost and its lifetime, if the marker is shown."""
        if key in self.shown:
            self._cost -= cost(self.shown.pop(key))
        self._ends.pop(key, None)


def _arrow_along_x(size: Sequence[float]) -> Mesh:
    """Return an arrow from the origin along x; the size is (length, width, height) [m].

    Its head is twice as thick as its shaft.
    """
    length, thick = size[0], max(size[1], size[2])
    return shapes.arrow(
        shaft_length=(1.0 - ARROW_HEAD) * length,
        shaft_diameter=0.5 * thick,
        head_length=ARROW_HEAD * length,
        head_diameter=thick,
    )


def _arrow(marker: Marker, size: Sequence[float]) -> List[Piece]:
    """Return an arrow from the marker's first point to its second one, or without points along its x axis."""
    if len(marker.points) < 2:
        return [Solid(_arrow_along_x(size), _rgba(marker.color))]
    start, end = (np.array([p.x, p.y, p.z]) for p in marker.points[:2])
    length = float(np.linalg.norm(end - start))
    if not 0.0 < length < np.inf:  # the points are equal, or a coordinate is infinite or NaN
        return []
    # if the marker has two points, its scale is (diameter of the shaft, diameter of the head, length of the
    # head)
    shaft_diameter, head_diameter, given_length = size
    head_length = given_length if given_length > 0.0 else ARROW_HEAD * length
    mesh = shapes.arrow(
        shaft_length=max(length - head_length, 0.0),
        shaft_diameter=shaft_diameter,
        head_length=min(head_length, length),
        head_diameter=head_diameter,
    )
    # the arrow lies along x from the origin, so it is turned into its direction and moved to its start
    rotation = matrix_from_quat(quat_between((1.0, 0.0, 0.0), (end - start) / length))
    vertices = mesh.vertices @ rotation.T + start
    return [Solid(Mesh(vertices.astype(np.float32), mesh.faces), _rgba(marker.color))]


def _lines(kind: int, points: np.ndarray, colors: np.ndarray, width: float) -> List[Piece]:
    """Return the lines of a LINE_LIST, which join pairs of points, or of a LINE_STRIP, which join all points.

    `points` is (N, 3) [m], `colors` is (N, 4) from 0 to 1, and `width` is in m.
    """
    if len(points) < 2:
        return []
    # (lines,) index of the first point of each line; the line ends at the next point
    starts = np.arange(0, len(points) - 1, 2 if kind == Marker.LINE_LIST else 1)
    ends = np.stack([starts, starts + 1], axis=1)  # (lines, 2) indices of the two points of each line
    return [Lines(points[ends], _bytes(colors[ends][..., :3]), width)]


def _by_color(parts: Iterable[Any], colors: np.ndarray, make: Callable[[List[Any]], Mesh]) -> List[Piece]:
    """Return one solid for each colour, because a browser draws few large meshes faster than many small ones.

    Args:
        parts: parts of the solids, such as the positions of spheres.
        colors: colour of each part, (N, 4) from 0 to 1; there may be more colours than parts.
        make: function that returns the mesh of a list of parts.
    """
    parts_by_color: Dict[Rgba, List[Any]] = {}
    for part, color in zip(parts, _few_colors(colors)):
        r, g, b, a = (float(value) for value in color)
        parts_by_color.setdefault((r, g, b, a), []).append(part)
    return [Solid(make(members), rgba) for rgba, members in parts_by_color.items()]


def _few_colors(colors: np.ndarray) -> np.ndarray:
    """Return colours (N, 4) from 0 to 1, rounded so far that at most MAX_COLORS of them differ."""
    rounded = colors
    for steps in (31, 15, 7, 3, 1):  # numbers of steps between 0 and 1
        if len(np.unique(rounded, axis=0)) <= MAX_COLORS:
            break
        rounded = np.round(np.clip(colors, 0.0, 1.0) * steps) / steps
    return rounded


def _colors(marker: Marker, count: int) -> np.ndarray:
    """Return a colour for each point (count, 4), or the marker's own if the number of colours differs."""
    if count and len(marker.colors) == count:
        return np.array([(c.r, c.g, c.b, c.a) for c in marker.colors])
    return np.tile(_rgba(marker.color), (count, 1))


def _rgba(color: Any) -> Rgba:
    """Return a ColorRGBA as a tuple."""
    return (color.r, color.g, color.b, color.a)


def _bytes(colors: np.ndarray) -> np.ndarray:
    """Return colours from 0 to 1 as bytes, of the same shape."""
    clipped: np.ndarray = (np.clip(np.nan_to_num(colors), 0.0, 1.0) * 255.0).round().astype(np.uint8)
    return clipped
