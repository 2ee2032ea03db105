"""Draws pieces with viser: a piece becomes a node of its scene, and one that cannot is left out."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any, Iterator, List, Optional, Sequence, Set, Tuple

import numpy as np
import rospy
import viser

from husky_highlevel_controller.datatypes import Pose, Rgba, Vector3
from husky_highlevel_controller.geometry import matrix_from_quat
from husky_highlevel_controller.ros.web import meshes
from husky_highlevel_controller.ros.web.markers import Label, Lines, MeshFile, Piece, Points, Solid
from husky_highlevel_controller.ros.web.viser_private import wxyz

LETTER_SCALE = 1.0  # of a text marker: 12 px whatever its size in the scene, sharp at any distance
LINE_WIDTH = 0.01  # [m], of a line without a width
DASH, MAX_DASHES = 0.25, 100.0  # [m], of a dash and of a gap; of all dashes
MIN_OPACITY = 0.02  # what is fainter is not drawn: RViz shows nothing either


class LeftOut:
    """Catches the errors of single items, so that none of them ends the page and its emergency stop."""

    def __init__(self) -> None:
        self._warned: Set[str] = set()

    @contextmanager
    def item(self, source: str) -> Iterator[None]:
        """Run a block that shows something of a source, such as a topic; log its first error as a warning."""
        try:
            yield
        except Exception as error:  # whatever a message holds, the page goes on
            self.warn(source, f"{type(error).__name__}: {error}")

    def warn(self, source: str, reason: str) -> None:
        """Log that something of a source is not shown, once for each source."""
        if source not in self._warned:
            self._warned.add(source)
            rospy.logwarn(f"{source} is not shown: {reason}")


def draw(scene: viser.SceneApi, parent: str, pieces: Sequence[Piece], pose: Pose) -> List[Any]:
    """Add nodes below `parent` for pieces that have this pose in it, one for each that is visible."""
    nodes: List[Any] = []
    for piece in pieces:
        name = f"{parent}/{len(nodes)}"
        where: Any = {"position": pose.position, "wxyz": wxyz(pose.quat_xyzw)}
        if isinstance(piece, MeshFile):
            nodes += draw(scene, f"{name}m", meshes.load(piece), pose)
        elif isinstance(piece, Solid) and piece.rgba[3] >= MIN_OPACITY:
            mesh, looks = (
                piece.mesh,
                {"color": rgb(piece.rgba), "opacity": _opacity(piece.rgba), "side": "double"},
            )
            where.update(looks, scale=piece.scale)
            nodes.append(scene.add_mesh_simple(name, mesh.vertices, mesh.faces, **where))
        elif isinstance(piece, Lines):
            width = piece.width or LINE_WIDTH
            nodes.append(scene.add_line_segments(name, piece.points, piece.colors, thickness=width, **where))
        elif isinstance(piece, Points):
            where.update(point_size=piece.size, precision="float32")
            nodes.append(scene.add_point_cloud(name, piece.points, piece.colors, **where))
        elif isinstance(piece, Label):
            where.update(font_size_mode="screen", font_screen_scale=LETTER_SCALE, anchor="bottom-center")
            nodes.append(scene.add_label(name, piece.text, **where))
    return nodes


def redraw(nodes: Sequence[Any], pieces: Sequence[Piece]) -> bool:
    """Change what `draw` has added into other pieces; False where that is not possible.

    It costs a tenth of drawing anew, here and in the browser.
    """
    if len(nodes) != len(pieces) or not all(map(_is_alike, nodes, pieces)):
        return False
    for node, piece in zip(nodes, pieces):
        if isinstance(piece, Solid):
            node.vertices, node.faces = piece.mesh.vertices, piece.mesh.faces
            node.color, node.opacity = rgb(piece.rgba), _opacity(piece.rgba)
            node.scale = piece.scale
        elif isinstance(piece, Lines):
            node.points, node.colors = piece.points, piece.colors
            node.thickness = piece.width or LINE_WIDTH
        elif isinstance(piece, Label):
            node.text = piece.text
    return True


def _is_alike(node: Any, piece: Piece) -> bool:
    if isinstance(piece, Solid):
        return isinstance(node, viser.MeshHandle) and piece.rgba[3] >= MIN_OPACITY
    if isinstance(piece, Lines):
        return isinstance(node, viser.LineSegmentsHandle)
    return isinstance(piece, Label) and isinstance(node, viser.LabelHandle)


def clickable(nodes: Sequence[Any]) -> List[Any]:
    """Nodes that the mouse can take hold of."""
    return [node for node in nodes if isinstance(node, viser.MeshHandle)]


def bounds(nodes: Sequence[Any]) -> Tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner (x, y, z) [m] of meshes, in the frame of their parent."""
    points = []
    for node in nodes:
        w, x, y, z = node.wxyz.tolist()
        points.append((node.vertices * node.scale) @ matrix_from_quat((x, y, z, w)).T + node.position)
    corners = np.concatenate(points)
    return corners.min(axis=0), corners.max(axis=0)


def rgb(rgba: Rgba) -> Tuple[int, int, int]:
    """A colour in bytes, without its opacity."""
    r, g, b = (round(255.0 * min(max(value, 0.0), 1.0)) for value in rgba[:3])
    return (r, g, b)


def _opacity(rgba: Rgba) -> Optional[float]:
    return None if rgba[3] >= 1.0 else rgba[3]


def dashes(start: Vector3, end: Vector3) -> np.ndarray:
    """Segments (N, 2, 3) of a dashed line [m]; counted from its start, they stay while its end moves."""
    way = np.array(end) - np.array(start)
    length = float(np.linalg.norm(way))
    count = int(min(length, MAX_DASHES) / DASH + 1.0) // 2
    marks = DASH * np.arange(2.0 * count).reshape(-1, 2, 1)
    segments: np.ndarray = (np.array(start) + marks * way / max(length, DASH)).astype(np.float32)
    return segments
