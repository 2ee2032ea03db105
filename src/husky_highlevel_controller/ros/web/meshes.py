"""Mesh files of robots and markers: file:// and package:// URIs become triangles."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, List, Optional, Tuple
from urllib.parse import unquote, urlsplit

import numpy as np
import rospkg
import rospy
import trimesh

from husky_highlevel_controller.datatypes import HuskyError, Rgba
from husky_highlevel_controller.robot_mesh import CELL, coarser
from husky_highlevel_controller.ros.web import shapes
from husky_highlevel_controller.ros.web.markers import MeshFile, Solid
from husky_highlevel_controller.ros.web.shapes import Mesh

MISSING: Rgba = (0.9, 0.2, 0.7, 1.0)  # of the box that stands for a mesh that cannot be read
MISSING_SIZE = (0.2, 0.2, 0.2)  # [m]
PLAIN: Rgba = (0.7, 0.7, 0.7, 1.0)
# triangles of a part, from where on it is drawn with fewer: without a graphics card the Husky's own ones take
# a third of a picture's time; cells for each of its lengths, at least
MANY, CELLS = 500, 25.0


def load(file: MeshFile) -> List[Solid]:
    """The triangles of a mesh file; a box and a warning where it cannot be read."""
    try:
        parts = _read(file.uri, CELL / (max(map(abs, file.scale)) or 1.0))
    except HuskyError as error:
        rospy.logwarn_once(f"{error}; a box is drawn instead")
        return [Solid(shapes.cube(), MISSING, MISSING_SIZE)]
    return [Solid(mesh, file.rgba or rgba, file.scale) for mesh, rgba in parts]


@lru_cache(maxsize=64)
def _read(uri: str, cell: float) -> Tuple[Tuple[Mesh, Rgba], ...]:
    path = _path(uri)
    try:
        loaded: Any = trimesh.load(path, force="scene", process=False)
        parts = tuple(
            (_mesh(part, cell), _color(part)) for part in loaded.dump() if isinstance(part, trimesh.Trimesh)
        )
    except Exception as error:  # a mesh file may be broken in as many ways as its reader has errors
        raise HuskyError(f"mesh '{uri}' cannot be read: {type(error).__name__}: {error}") from None
    if not parts:
        raise HuskyError(f"mesh '{uri}' holds no triangles")
    return parts


def _mesh(part: trimesh.Trimesh, cell: float) -> Mesh:
    if len(part.faces) > MANY:
        smallest = min(cell, float(part.extents.max()) / CELLS)
        return shapes.triangles(coarser(part.triangles, smallest).reshape(-1, 3))
    return Mesh(part.vertices.astype(np.float32), part.faces.astype(np.uint32))


def _path(uri: str) -> Path:
    parts = urlsplit(uri)
    if parts.scheme == "package":
        try:
            return Path(rospkg.RosPack().get_path(parts.netloc)) / unquote(parts.path).lstrip("/")
        except rospkg.ResourceNotFound:
            raise HuskyError(f"mesh '{uri}': there is no package '{parts.netloc}'") from None
    if parts.scheme in ("file", ""):
        return Path(unquote(parts.path))
    raise HuskyError(f"mesh '{uri}' is neither file:// nor package://")


def _color(part: trimesh.Trimesh) -> Rgba:
    color: Optional[np.ndarray] = getattr(getattr(part.visual, "material", None), "main_color", None)
    if color is None:
        return PLAIN
    r, g, b, a = (float(value) / 255.0 for value in color)
    return (r, g, b, a)
