"""Meshes of shapes: closed, turned outwards, and not too many triangles."""

import numpy as np
import pytest
import trimesh

from husky_web import shapes
from husky_web.shapes import MeshFile


def test_a_mesh_with_more_triangles_than_are_seen_is_drawn_with_fewer(tmp_path):
    trimesh.creation.icosphere(subdivisions=5, radius=0.2).export(tmp_path / "fine.stl")
    (solid,) = shapes.solids_of(MeshFile((tmp_path / "fine.stl").as_uri(), (1.0, 1.0, 1.0), None))
    assert len(solid.mesh.faces) < 0.5 * 20 * 4**5
    assert solid.extents == pytest.approx([0.4, 0.4, 0.4], abs=0.02)


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (shapes.cube(), 1.0),
        (shapes.cylinder(), np.pi / 4.0),
        (shapes.sphere(), np.pi / 6.0),
        (shapes.arrow(1.0, 0.2, 0.5, 0.4), np.pi * (0.01 + 0.04 * 0.5 / 3.0)),
    ],
)
def test_shapes_are_closed_and_turn_outwards(mesh, expected):
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)  # its corners are shared
    assert solid.is_watertight
    assert solid.volume == pytest.approx(expected, rel=0.03), "negative where faces turn inwards"
