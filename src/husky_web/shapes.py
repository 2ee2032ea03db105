"""Shapes that are drawn: triangles, lines, points and texts; mesh files as triangles."""

from __future__ import annotations

from functools import lru_cache
from math import pi
from pathlib import Path
from typing import Any, List, NamedTuple, Optional, Sequence, Tuple, Union
from urllib.parse import unquote, urlsplit

import numpy as np
import rospkg
import rospy
import trimesh
from trimesh import creation

from husky_highlevel_controller.datatypes import HuskyError, Rgba, Vector3
from husky_highlevel_controller.drawing.robot_mesh import CELL, coarser

SIDES = 24  # number of sides of a cylinder, of a cone, and of a sphere's equator
MISSING: Rgba = (0.9, 0.2, 0.7, 1.0)  # colour of the box that replaces an unreadable mesh
MISSING_SIZE = (0.2, 0.2, 0.2)  # [m]
PLAIN: Rgba = (0.7, 0.7, 0.7, 1.0)
# A mesh file consists of parts. A part that has more than MANY triangles is simplified, but keeps details
# larger than 1 / CELLS of its length. Without this, a browser that has no graphics card would spend a third
# of its time on the triangles of the Husky.
MANY, CELLS = 500, 25.0


class Mesh(NamedTuple):
    """Triangles; each face lists its corners counter-clockwise as seen from outside."""

    vertices: np.ndarray  # (V, 3) float32 [m]
    faces: np.ndarray  # (F, 3) uint32; each number is the row of a corner in `vertices`


class Solid(NamedTuple):
    """Triangles of one colour."""

    mesh: Mesh
    rgba: Rgba
    # factors along x, y and z; a change of the factors costs less than a new mesh
    scale: Vector3 = (1.0, 1.0, 1.0)

    @property
    def extents(self) -> np.ndarray:
        """Return the size [m] along x, y and z."""
        extents: np.ndarray = np.ptp(self.mesh.vertices, axis=0) * np.abs(self.scale)
        return extents


class Lines(NamedTuple):
    """Straight lines."""

    points: np.ndarray  # (N, 2, 3) float32 [m], two ends of each of N lines
    colors: np.ndarray  # (N, 2, 3) uint8, red, green and blue at both ends of each line
    width: float  # [m]


class Points(NamedTuple):
    """Square points."""

    points: np.ndarray  # (N, 3) float32 [m]
    colors: np.ndarray  # (N, 3) uint8, red, green and blue of each point
    size: float  # [m]


class Label(NamedTuple):
    """Text that faces the camera."""

    text: str


class MeshFile(NamedTuple):
    """Mesh that is loaded from a file."""

    uri: str
    scale: Vector3
    rgba: Optional[Rgba]  # colour of the mesh; None for the colours in the mesh file


Piece = Union[Solid, Lines, Points, Label, MeshFile]


def copies(unit: Mesh, size: Sequence[float], points: np.ndarray) -> Mesh:
    """Return a mesh of copies of a unit shape, stretched along x, y and z, at points (N, 3) [m]."""
    # corners (N, V, 3) of N copies of a unit with V corners
    corners = points[:, None] + unit.vertices * np.asarray(size)
    # faces (N, F, 3) of N copies of a unit with F faces; a face gives the rows of its corners in the array of
    # all corners, in which the corners of each copy begin at its first row
    first_rows = np.arange(len(points)) * len(unit.vertices)
    faces = first_rows[:, None, None] + unit.faces
    return Mesh(corners.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.uint32))


@lru_cache(maxsize=None)
def cube() -> Mesh:
    """Return a cube of edge length 1 around the origin; faces share no corners, so the edges look sharp."""
    box = creation.box()
    box.unmerge_vertices()
    return _mesh(box)


@lru_cache(maxsize=None)
def cylinder() -> Mesh:
    """Return a cylinder of diameter 1 and length 1 around the origin, along z."""
    return _turned([(0.0, -0.5), (0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (0.5, 0.5), (0.0, 0.5)])


@lru_cache(maxsize=None)
def sphere() -> Mesh:
    """Return a sphere of diameter 1 around the origin."""
    # trimesh's own sphere is not used, because it has twice as many sides, and no equator if the number of
    # rings is even
    angles = np.linspace(-pi / 2.0, pi / 2.0, SIDES // 2 + 1)
    return _turned([(0.5 * np.cos(angle), 0.5 * np.sin(angle)) for angle in angles])


def arrow(shaft_length: float, shaft_diameter: float, head_length: float, head_diameter: float) -> Mesh:
    """Return an arrow from the origin along x."""
    shaft_radius, head_radius = shaft_diameter / 2.0, head_diameter / 2.0
    shaft_rim, head_rim = (shaft_radius, 0.0), (head_radius, shaft_length)
    tip = (0.0, shaft_length + head_length)
    # each corner is (radius, distance along the arrow); the rims are there twice, so that they look sharp
    profile = [(0.0, 0.0), shaft_rim, shaft_rim, (shaft_radius, shaft_length), head_rim, head_rim, tip]
    along_z = _turned(profile)
    # z becomes x, x becomes y, and y becomes z
    return Mesh(np.ascontiguousarray(along_z.vertices[:, [2, 0, 1]]), along_z.faces)


def triangles(points: np.ndarray) -> Mesh:
    """Return a mesh of triangles, each with three of the points (3 N, 3)."""
    count = len(points) // 3
    return Mesh(
        np.asarray(points[: 3 * count], np.float32).reshape(-1, 3),
        np.arange(3 * count, dtype=np.uint32).reshape(-1, 3),
    )


def _turned(profile: Sequence[Sequence[float]]) -> Mesh:
    """Return the solid of revolution of a profile (radius, z), upwards; a doubled point is a sharp edge."""
    return _mesh(creation.revolve(np.array(profile, float), sections=SIDES, process=False))


def _mesh(solid: trimesh.Trimesh) -> Mesh:
    """Return the triangles of a trimesh; they are read-only, because many solids share them."""
    mesh = Mesh(solid.vertices.astype(np.float32), solid.faces.astype(np.uint32))
    for array in mesh:
        array.setflags(write=False)
    return mesh


def solids_of(file: MeshFile) -> List[Solid]:
    """Return the triangles of a mesh file, or a box with a warning if it cannot be read."""
    try:
        # if all factors are 0, the value is 1, because CELL cannot be divided by 0
        metres_per_unit = max(map(abs, file.scale)) or 1.0
        parts = _read(file.uri, CELL / metres_per_unit)  # CELL [m] becomes a length in the file's unit
    except HuskyError as error:
        rospy.logwarn_once(f"{error}; a box is drawn instead")
        return [Solid(cube(), MISSING, MISSING_SIZE)]
    return [Solid(mesh, file.rgba or rgba, file.scale) for mesh, rgba in parts]


@lru_cache(maxsize=64)
def _read(uri: str, cell: float) -> Tuple[Tuple[Mesh, Rgba], ...]:
    """Return the parts of a mesh file with their colours; a part with many triangles is simplified.

    Args:
        uri: file:// or package:// address of the file.
        cell: largest size of a detail that may be lost, in the file's unit.

    Raises:
        HuskyError: the file cannot be read, or has no triangles.
    """
    path = _path(uri)
    try:
        # trimesh returns a scene, also for a file with only one part; `dump` returns the parts at their
        # positions in the scene
        loaded: Any = trimesh.load(path, force="scene", process=False)
        parts = tuple(
            (_mesh_of(part, cell), _color(part))
            for part in loaded.dump()
            if isinstance(part, trimesh.Trimesh)
        )
    except Exception as error:  # the reader may raise any error if the mesh file is broken
        raise HuskyError(f"mesh '{uri}' cannot be read: {type(error).__name__}: {error}") from None
    if not parts:
        raise HuskyError(f"mesh '{uri}' has no triangles")
    return parts


def _mesh_of(part: trimesh.Trimesh, cell: float) -> Mesh:
    """Return the triangles of a part of a mesh file; if there are many, details up to `cell` are lost."""
    if len(part.faces) > MANY:
        # a small part keeps details that are larger than 1 / CELLS of its length
        cell = min(cell, float(part.extents.max()) / CELLS)
        return triangles(coarser(part.triangles, cell).reshape(-1, 3))
    return Mesh(part.vertices.astype(np.float32), part.faces.astype(np.uint32))


def _path(uri: str) -> Path:
    """Return the path of a mesh file.

    Raises:
        HuskyError: the package does not exist, or the address has another scheme.
    """
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
    """Return the main colour of a part of a mesh file, 0 to 1; PLAIN if it has none."""
    color: Optional[np.ndarray] = getattr(getattr(part.visual, "material", None), "main_color", None)
    if color is None:
        return PLAIN
    r, g, b, a = (float(value) / 255.0 for value in color)
    return (r, g, b, a)
