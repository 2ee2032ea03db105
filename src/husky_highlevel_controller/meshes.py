"""Triangle meshes: made of loose triangles, made coarser, and measured.

In: corners and faces as arrays. Out: `TriangleMesh` records, points, volumes.
"""

from __future__ import annotations

from typing import Tuple

import numpy as np

from husky_highlevel_controller.datatypes import TriangleMesh, Vector3

# a mesh becomes coarser by merging the corners in each cell of a grid; the first grid has this many cells
# along the mesh's longest edge
_CELLS = 2048.0
_COARSER = 1.25  # the cells grow by this factor while the mesh still has too many faces
_SOLID = 0.01  # a mesh counts as closed only if its volume is more than this fraction of the box around it


def make_mesh(vertices: np.ndarray, faces: np.ndarray, source: str = "") -> TriangleMesh:
    """Return a mesh in which equal corners are one corner; faces without an area are omitted.

    Args:
        vertices: (V, 3) [m], which may repeat.
        faces: (F, 3), rows of `vertices`.
        source: file of the mesh, for messages.
    """
    corners, rows = np.unique(np.asarray(vertices, float), axis=0, return_inverse=True)
    # `rows` has the row in `corners` of each vertex; some versions of NumPy return it as a column
    return _without_flat(corners, rows.reshape(-1)[np.asarray(faces, int)], source)


def simplified(mesh: TriangleMesh, most: int) -> TriangleMesh:
    """Return the mesh, or a coarser mesh if it has more than `most` faces.

    Space is divided into cubic cells, and all corners in one cell become one corner.
    """
    cell = max(mesh.size) / _CELLS  # [m] edge of a cell
    coarse = mesh
    while len(coarse.faces) > most:
        # `cells` has a row for each cell that contains a corner: x, y and z of the cell as multiples of its
        # edge. For each corner, `rows` has the row of its cell.
        cells, rows = np.unique(np.round(mesh.vertices / cell), axis=0, return_inverse=True)
        coarse = _without_flat(cells * cell, rows.reshape(-1)[mesh.faces], mesh.source)
        cell *= _COARSER
    return coarse


def scaled_mesh(mesh: TriangleMesh, scale: Vector3) -> TriangleMesh:
    """Return the mesh, larger by a factor along each of its axes."""
    if scale == (1.0, 1.0, 1.0):
        return mesh
    return _frozen(mesh.vertices * scale, mesh.faces, mesh.source)


def volume_of(mesh: TriangleMesh) -> Tuple[float, Vector3]:
    """Return volume [m^3] and centroid [m] of a mesh in its frame.

    A mesh that is not closed has no volume, so the box around it counts.
    """
    low, high = mesh.bounds
    # first, second and third corner of each face, (F, 3) [m], measured from the lowest corner of the box
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2) - low
    # signed volumes of the tetrahedra from each face to the lowest corner of the box, (F,)
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    volume, box_volume = float(parts.sum()), float(np.prod(high - low))
    # the signed volumes of an open mesh may add up to any number, so only a plausible sum counts
    is_closed = _SOLID * box_volume < abs(volume) <= box_volume
    if not is_closed:
        x, y, z = ((low + high) / 2.0).tolist()
        return box_volume, (x, y, z)
    # the centroid of a tetrahedron is the mean of its four corners, one of which is `low`
    x, y, z = (low + parts @ (a + b + c) / 4.0 / volume).tolist()
    return abs(volume), (x, y, z)


def _without_flat(vertices: np.ndarray, faces: np.ndarray, source: str) -> TriangleMesh:
    """Return a mesh without duplicate faces and without faces that have two equal corners."""
    # each corner of a face is compared with the next corner of the same face
    has_equal_corners = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    faces = faces[~has_equal_corners]
    # the first of equal faces is kept; faces are equal if they have the same corners in any order
    _, first_of_each = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(first_of_each)]
    # keep only the corners that a face uses
    used, rows = np.unique(faces, return_inverse=True)
    return _frozen(vertices[used], rows.reshape(-1, 3), source)


def _frozen(vertices: np.ndarray, faces: np.ndarray, source: str) -> TriangleMesh:
    """Return a mesh of these arrays, which become read-only."""
    vertices, faces = np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces)
    for array in (vertices, faces):
        array.setflags(write=False)
    return TriangleMesh(vertices, faces, source)
