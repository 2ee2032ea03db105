"""Draws pieces with viser: a piece becomes a node of its scene."""

from __future__ import annotations

from typing import Any, List, Sequence, Tuple

import viser

from husky_highlevel_controller.datatypes import Pose, Quaternion, Rgba
from husky_highlevel_controller.ros.web import meshes
from husky_highlevel_controller.ros.web.markers import Dots, Lines, MeshFile, Piece, Solid, Words

LETTER_HEIGHT = 0.45  # of a text marker's scale, as RViz's letters measure
MIN_OPACITY = 0.02  # what is fainter is not drawn: RViz shows nothing either


def wxyz(quat_xyzw: Quaternion) -> Tuple[float, float, float, float]:
    """Viser's order of a quaternion."""
    x, y, z, w = quat_xyzw
    return (w, x, y, z)


def place(node: Any, pose: Pose) -> None:
    """Put a node somewhere, if it is not there already: every change is sent to every page."""
    position, rotation = pose.position, wxyz(pose.quat_xyzw)
    if tuple(node.position) != position:
        node.position = position
    if tuple(node.wxyz) != rotation:
        node.wxyz = rotation


def draw(scene: viser.SceneApi, parent: str, pieces: Sequence[Piece], pose: Pose) -> List[Any]:
    """Add nodes below `parent` for pieces that have this pose in it; those that can be clicked."""
    nodes: List[Any] = []
    for piece in pieces:
        name = f"{parent}/{len(nodes)}"
        where: Any = {"position": pose.position, "wxyz": wxyz(pose.quat_xyzw)}
        if isinstance(piece, MeshFile):
            nodes += draw(scene, f"{name}m", meshes.load(piece), pose)
        elif isinstance(piece, Solid) and piece.rgba[3] >= MIN_OPACITY:
            nodes.append(_solid(scene, name, piece, where))
        elif isinstance(piece, Lines):
            scene.add_line_segments(name, piece.points, piece.colors, thickness=piece.width or 0.01, **where)
        elif isinstance(piece, Dots):
            scene.add_point_cloud(
                name, piece.points, piece.colors, point_size=piece.size, precision="float32", **where
            )
        elif isinstance(piece, Words):
            scene.add_label(
                name,
                piece.text,
                font_size_mode="scene",
                font_scene_height=LETTER_HEIGHT * piece.height,
                anchor="bottom-center",
                **where,
            )
    return nodes


def rgb(rgba: Rgba) -> Tuple[int, int, int]:
    """A colour in bytes, without its opacity."""
    r, g, b = (round(255.0 * min(max(value, 0.0), 1.0)) for value in rgba[:3])
    return (r, g, b)


def _solid(scene: viser.SceneApi, name: str, solid: Solid, where: Any) -> Any:
    alpha = solid.rgba[3]
    return scene.add_mesh_simple(
        name,
        solid.mesh.vertices,
        solid.mesh.faces,
        color=rgb(solid.rgba),
        opacity=None if alpha >= 1.0 else alpha,
        side="double",
        **where,
    )
