"""Triangles of a robot, few enough for a page: the Husky's meshes of PyBullet, and boxes."""

from __future__ import annotations

from pathlib import Path
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.paths import mesh_folder
from husky_highlevel_controller.robot import Robot

YELLOW, BLACK, TYRE, PLATE, STEEL, GREY = "#f2b80d", "#26272a", "#333436", "#4d4f54", "#80858c", "#b8bdc2"
# meshes of the body as in urdf/husky.urdf.xacro: file, colour, x and z in base_link [m], true if the mesh is
# turned to point backwards
BODY = (
    ("base_link.stl", BLACK, 0.0, 0.0, False),
    ("top_plate.stl", YELLOW, 0.0, 0.0, False),
    ("bumper.stl", BLACK, 0.48, 0.091, False),
    ("bumper.stl", BLACK, -0.48, 0.091, True),
    ("user_rail.stl", STEEL, 0.272, 0.245, False),
)
# [m] Space is divided into cubes (cells) with edges of this length. All corners in one cell become one
# corner, so that fewer triangles are left.
CELL = 0.012
# a triangle in a binary STL file
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class Part(NamedTuple):
    """Triangles of one colour."""

    color: str
    triangles: np.ndarray  # (N, 3, 3) [m] corners in base_link, or around the hub of a wheel


def robot_mesh(robot: Robot) -> Tuple[List[Part], List[Part]]:
    """Return the parts of the body in base_link, and the parts of one wheel around its hub.

    The meshes come from PyBullet. If PyBullet is not installed, all parts are boxes. A robot other than the
    Husky has the Husky's tyres at its own size, and a box as its body.
    """
    radius, width, mount, hull = robot.drive.wheel_radius, robot.wheels.width, robot.lidar_mount, robot.hull
    # boxes for the lidar: an upright plate behind it, its lower part and its upper part
    body = [
        Part(BLACK, _box((0.01, 0.1, 0.12), (mount.x - 0.06, 0.0, mount.z))),
        Part(BLACK, _box((0.08, 0.08, 0.05), (mount.x, 0.0, mount.z))),
        Part(GREY, _box((0.105, 0.1, 0.08), (mount.x, 0.0, mount.z + 0.045))),
    ]
    wheel = [Part(STEEL, _box((0.1, width + 0.01, 0.05), (0.0, 0.0, 0.0)))]
    folder = mesh_folder()
    if folder is not None:
        tyre = _mesh(folder / "wheel.stl")
        # largest |x|, |y| and |z| of the mesh; the axle of the tyre is the y axis
        _, mesh_half_width, mesh_radius = np.abs(tyre).max(axis=(0, 1))
        # the mesh is a tyre of the Husky, and is scaled to the radius and the width of this robot's wheels
        scale = (radius / mesh_radius, width / 2.0 / mesh_half_width, radius / mesh_radius)
        wheel.append(Part(TYRE, tyre * scale))
    if folder is None or robot.name != "husky":
        hull_box = _box((hull.length, hull.width - 2.0 * width, 0.2), (0.0, 0.0, 0.1))
        return [*body, Part(YELLOW, hull_box)], wheel
    for file, color, x, z, points_back in BODY:
        # half a turn about z changes the sign of x and y
        half_turn = (-1, -1, 1) if points_back else (1, 1, 1)
        body.append(Part(color, _mesh(folder / file) * half_turn + (x, 0.0, z)))
    # the plate on top of the Husky, which carries the lidar, is drawn as a box
    return [*body, Part(PLATE, _box((0.73, 0.59, 0.0063), (0.0812, 0.0, 0.248)))], wheel


def coarser(triangles: np.ndarray, cell: float = CELL) -> np.ndarray:
    """Return fewer triangles of about the same shape, (M, 3, 3) [m], for a page that must be small.

    Each corner is moved to the middle of its cell. Triangles that become flat, or equal to another triangle,
    are left out.

    Args:
        triangles: corners of the triangles (N, 3, 3) [m].
        cell: edge of a cell, see CELL [m].
    """
    cells = np.round(triangles / cell)  # cell of each corner, in whole numbers
    # each corner is compared with the corner before it in the triangle; a triangle with two equal corners is
    # flat
    is_equal_to_last = (cells == np.roll(cells, 1, axis=1)).all(axis=2)  # (N, 3)
    is_flat = is_equal_to_last.any(axis=1)
    coarse_triangles: np.ndarray = np.unique(cells[~is_flat], axis=0) * cell
    return coarse_triangles


def _mesh(path: Path) -> np.ndarray:
    """Return the triangles of a binary STL file, made coarser, (M, 3, 3) [m]."""
    # the file begins with 80 bytes of text and 4 bytes for the number of triangles
    triangles = np.frombuffer(path.read_bytes(), STL, offset=84)["corners"]
    return coarser(triangles.astype(float))


def _box(size: Sequence[float], centre: Sequence[float]) -> np.ndarray:
    """Return the triangles of a box with edges and a centre [m], (12, 3, 3) [m]."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    # each face has four corners, in order around the face, and becomes two triangles
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    corners_of_triangles = []
    for a, b, c, d in faces:
        corners_of_triangles += [(a, b, c), (a, c, d)]
    triangles: np.ndarray = (corners * size + centre)[corners_of_triangles]
    return triangles
