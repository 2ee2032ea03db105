"""Triangle meshes of simple shapes.

In: sizes [m]. Out: vertices (V, 3) float32 and faces (F, 3) uint32.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi
from typing import NamedTuple, Sequence

import numpy as np
import trimesh
from trimesh import creation

SIDES = 24  # of a cylinder, a cone, and of a sphere's equator


class Mesh(NamedTuple):
    """Triangles; each face lists its corners counter-clockwise as seen from outside."""

    vertices: np.ndarray  # (V, 3) float32 [m]
    faces: np.ndarray  # (F, 3) uint32, rows of `vertices`


def copies(unit: Mesh, size: Sequence[float], points: np.ndarray) -> Mesh:
    """Mesh of copies of a unit shape, stretched along x, y and z, at points (N, 3) [m]."""
    corners = points[:, None] + unit.vertices * np.asarray(size)
    faces = np.arange(len(points))[:, None, None] * len(unit.vertices) + unit.faces
    return Mesh(corners.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.uint32))


@lru_cache(maxsize=None)
def cube() -> Mesh:
    """A cube of edge length 1 about the origin; corners are not shared, so that edges look sharp."""
    box = creation.box()
    box.unmerge_vertices()
    return _mesh(box)


@lru_cache(maxsize=None)
def cylinder() -> Mesh:
    """A cylinder of diameter 1 and length 1 about the origin, along z."""
    return _turned([(0.0, -0.5), (0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (0.5, 0.5), (0.0, 0.5)])


@lru_cache(maxsize=None)
def sphere() -> Mesh:
    """A sphere of diameter 1 about the origin."""
    angles = np.linspace(-pi / 2.0, pi / 2.0, SIDES // 2 + 1)
    return _turned([(0.5 * np.cos(angle), 0.5 * np.sin(angle)) for angle in angles])


def arrow(shaft_length: float, shaft_diameter: float, head_length: float, head_diameter: float) -> Mesh:
    """An arrow from the origin along x."""
    shaft, head, length = shaft_diameter / 2.0, head_diameter / 2.0, shaft_length + head_length
    rim, step, tip = (shaft, 0.0), (head, shaft_length), (0.0, length)
    along_z = _turned([(0.0, 0.0), rim, rim, (shaft, shaft_length), step, step, tip])
    return Mesh(np.ascontiguousarray(along_z.vertices[:, [2, 0, 1]]), along_z.faces)


def triangles(points: np.ndarray) -> Mesh:
    """Mesh of triangles: three points (3 N, 3) each."""
    count = len(points) // 3
    return Mesh(
        np.asarray(points[: 3 * count], np.float32).reshape(-1, 3),
        np.arange(3 * count, dtype=np.uint32).reshape(-1, 3),
    )


def _turned(profile: Sequence[Sequence[float]]) -> Mesh:
    """Solid of revolution about z of a profile (radius, z) from bottom to top; a doubled point is an edge."""
    return _mesh(creation.revolve(np.array(profile, float), sections=SIDES, process=False))


def _mesh(solid: trimesh.Trimesh) -> Mesh:
    mesh = Mesh(solid.vertices.astype(np.float32), solid.faces.astype(np.uint32))
    for array in mesh:
        array.setflags(write=False)
    return mesh
