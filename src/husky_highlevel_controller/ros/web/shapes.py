"""Triangle meshes of simple shapes.

In: sizes [m]. Out: vertices (V, 3) float32 and faces (F, 3) uint32.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi
from typing import Any, List, NamedTuple, Sequence, Tuple

import numpy as np

SIDES = 24  # of a cylinder, a cone, and of a sphere's equator


class Mesh(NamedTuple):
    """Triangles; each face lists its corners counter-clockwise as seen from outside."""

    vertices: np.ndarray  # (V, 3) float32 [m]
    faces: np.ndarray  # (F, 3) uint32, rows of `vertices`


def scaled(mesh: Mesh, size: Sequence[float]) -> Mesh:
    """The mesh stretched along x, y and z."""
    return Mesh((mesh.vertices * np.asarray(size)).astype(np.float32), mesh.faces)


def moved(mesh: Mesh, offset: Sequence[float]) -> Mesh:
    """The mesh shifted by `offset` [m]."""
    return Mesh((mesh.vertices + np.asarray(offset)).astype(np.float32), mesh.faces)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([np.zeros((0, 3), np.float32), *(mesh.vertices for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts)]
    return Mesh(vertices, np.concatenate([np.zeros((0, 3), np.uint32), *faces]).astype(np.uint32))


@lru_cache(maxsize=None)
def cube() -> Mesh:
    """A cube of edge length 1 about the origin; corners are not shared, so that edges look sharp."""
    corners: List[List[float]] = []
    faces: List[Tuple[int, int, int]] = []
    for axis in range(3):
        for sign in (-0.5, 0.5):
            start = len(corners)
            for u, v in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)):
                corner = [0.0, 0.0, 0.0]
                corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3] = sign, u, v
                corners.append(corner)
            a, b, c, d = range(start, start + 4)
            faces += [(a, b, c), (a, c, d)] if sign > 0.0 else [(a, c, b), (a, d, c)]
    return _mesh(corners, faces)


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
    profile = [
        (0.0, 0.0),
        (shaft, 0.0),
        (shaft, 0.0),
        (shaft, shaft_length),
        (head, shaft_length),
        (head, shaft_length),
        (0.0, length),
    ]
    along_z = _turned(profile)
    return Mesh(np.ascontiguousarray(along_z.vertices[:, [2, 0, 1]]), along_z.faces)


def triangles(points: np.ndarray) -> Mesh:
    """Each three points (3 N, 3) are one triangle."""
    count = len(points) // 3
    return Mesh(
        np.asarray(points[: 3 * count], np.float32).reshape(-1, 3),
        np.arange(3 * count, dtype=np.uint32).reshape(-1, 3),
    )


def _turned(profile: Sequence[Sequence[float]]) -> Mesh:
    """The solid of revolution about z of a profile (radius, z), from bottom to top."""
    angles = np.linspace(0.0, 2.0 * pi, SIDES, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.concatenate([np.column_stack([radius * ring, np.full(SIDES, z)]) for radius, z in profile])
    faces = []
    for level in range(len(profile) - 1):
        if profile[level] == profile[level + 1]:  # a sharp edge: the next ring has its own normals
            continue
        for side in range(SIDES):
            a, b = level * SIDES + side, level * SIDES + (side + 1) % SIDES
            faces += [(a, b, b + SIDES), (a, b + SIDES, a + SIDES)]
    return _mesh(vertices, faces)


def _mesh(vertices: Any, faces: Any) -> Mesh:
    mesh = Mesh(np.array(vertices, np.float32), np.array(faces, np.uint32))
    for array in mesh:
        array.setflags(write=False)
    return mesh
