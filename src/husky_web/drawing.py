"""Drawing of pieces with viser: a piece becomes a node of its scene, or is left out with a warning."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any, Dict, Iterator, List, Sequence, Set, Tuple

import numpy as np
import rospy
import viser

from husky_highlevel_controller.datatypes import Pose, Rgba, Vector3
from husky_highlevel_controller.geometry import matrix_from_quat
from husky_web.shapes import Label, Lines, MeshFile, Piece, Points, Solid, solids_of
from husky_web.viser_private import wxyz

# scale of the text of a marker; the text is 12 px high at any distance, even if the marker gives another size
LETTER_SCALE = 1.0
LINE_WIDTH = 0.01  # [m] width of a line whose marker gives no width
# [m] length of each dash and of each gap; largest length of a dashed line
DASH, LONGEST_DASHED = 0.25, 100.0
MIN_OPACITY = 0.02  # a piece with less opacity is not drawn, as in RViz
# topics and other sources whose first error has been logged; later errors are not logged
_warned: Set[str] = set()


@contextmanager
def on_error_log_and_skip(source: str) -> Iterator[None]:
    """Run a block that shows something of a source, such as a topic, and end the block at an error.

    The first error of each source is logged as a warning, and the program continues after the block, so no
    error of a single item ends the page and its emergency stop.
    """
    try:
        yield
    except Exception as error:
        warn_left_out(source, f"{type(error).__name__}: {error}")


def warn_left_out(source: str, reason: str) -> None:
    """Log that something of a source is not shown, once for each source."""
    if source not in _warned:
        _warned.add(source)
        rospy.logwarn(f"{source} is not shown: {reason}")


def add_pieces(scene: viser.SceneApi, parent: str, pieces: Sequence[Piece], pose: Pose) -> List[Any]:
    """Add a node below `parent` for each visible piece, with this pose in `parent`, and return the nodes."""
    nodes: List[Any] = []
    for piece in pieces:
        name = f"{parent}/{len(nodes)}"
        if isinstance(piece, MeshFile):
            # A mesh file may have several solids. Their nodes have names such as parent/0m/0 and parent/0m/1,
            # in which "m" stands for the mesh file.
            nodes += add_pieces(scene, f"{name}m", solids_of(piece), pose)
        elif _is_visible(piece):
            add, _ = _KINDS[type(piece)]
            where = {"position": pose.position, "wxyz": wxyz(pose.quat_xyzw)}
            nodes.append(add(scene, name, **_properties(piece), **where))
    return nodes


def redraw(nodes: Sequence[Any], pieces: Sequence[Piece]) -> bool:
    """Change the nodes of `add_pieces` to other pieces; return False if that is not possible.

    A change takes a tenth of the time of new nodes, in this program and in the browser.
    """
    if len(nodes) != len(pieces) or not all(map(_is_alike, nodes, pieces)):
        return False
    for node, piece in zip(nodes, pieces):
        for name, value in _properties(piece).items():
            setattr(node, name, value)
    return True


# for each kind of piece: function of viser that adds it to the scene, and the type that this function returns
_KINDS: Any = {
    Solid: (viser.SceneApi.add_mesh_simple, viser.MeshHandle),
    Lines: (viser.SceneApi.add_line_segments, viser.LineSegmentsHandle),
    Points: (viser.SceneApi.add_point_cloud, viser.PointCloudHandle),
    Label: (viser.SceneApi.add_label, viser.LabelHandle),
}


def _properties(piece: Any) -> Dict[str, Any]:
    """Return the properties of the viser node of a piece, by name."""
    if isinstance(piece, Solid):
        (vertices, faces), alpha = piece.mesh, piece.rgba[3]
        opacity = None if alpha >= 1.0 else alpha  # viser draws a solid as opaque if this is None
        looks: Any = {"color": rgb(piece.rgba), "opacity": opacity, "scale": piece.scale, "side": "double"}
        return {"vertices": vertices, "faces": faces, **looks}
    if isinstance(piece, Lines):
        return {"points": piece.points, "colors": piece.colors, "thickness": piece.width or LINE_WIDTH}
    if isinstance(piece, Points):
        looks = {"point_size": piece.size, "precision": "float32"}
        return {"points": piece.points, "colors": piece.colors, **looks}
    # the piece is a Label
    looks = {"font_size_mode": "screen", "font_screen_scale": LETTER_SCALE, "anchor": "bottom-center"}
    return {"text": piece.text, **looks}


def _is_alike(node: Any, piece: Piece) -> bool:
    """Return whether a node can be changed to this piece."""
    if type(piece) not in _KINDS:  # a mesh file, which becomes several nodes
        return False
    _, type_of_node = _KINDS[type(piece)]
    return isinstance(node, type_of_node) and _is_visible(piece)


def _is_visible(piece: Piece) -> bool:
    """Return whether a piece is opaque enough to be drawn."""
    return not isinstance(piece, Solid) or piece.rgba[3] >= MIN_OPACITY


def clickable(nodes: Sequence[Any]) -> List[Any]:
    """Return the nodes that the mouse can grasp."""
    return [node for node in nodes if isinstance(node, viser.MeshHandle)]


def bounds(nodes: Sequence[Any]) -> Tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner (x, y, z) [m] of meshes, in the frame of their parent."""
    points = []
    for node in nodes:
        w, x, y, z = node.wxyz.tolist()
        points.append((node.vertices * node.scale) @ matrix_from_quat((x, y, z, w)).T + node.position)
    corners = np.concatenate(points)
    return corners.min(axis=0), corners.max(axis=0)


def rgb(rgba: Rgba) -> Tuple[int, int, int]:
    """Return a colour in bytes, without its opacity."""
    r, g, b = (round(255.0 * min(max(value, 0.0), 1.0)) for value in rgba[:3])
    return (r, g, b)


def dashes(start: Vector3, end: Vector3) -> np.ndarray:
    """Return the dashes (N, 2, 3) of a line [m]; a dash stays in place if only the end of the line moves."""
    line = np.array(end) - np.array(start)
    length = float(np.linalg.norm(line))
    # dashes and gaps take turns, and each of them is DASH long; a dash comes first, so at least half of them
    # are dashes
    dashes_and_gaps = int(min(length, LONGEST_DASHED) / DASH)
    count = (dashes_and_gaps + 1) // 2
    # [m] distances from `start` to both ends of each dash: 0 and 1 times DASH, 2 and 3 times DASH ...
    distances = DASH * np.arange(2.0 * count).reshape(-1, 2, 1)
    # a line that is shorter than DASH has no dashes, so its direction does not matter
    direction = line / max(length, DASH)
    segments: np.ndarray = (np.array(start) + distances * direction).astype(np.float32)
    return segments
