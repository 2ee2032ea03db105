"""Triangle meshes: corners are shared, many faces become fewer, volumes are right."""

import numpy as np
import pytest
from trimesh import creation

from husky_highlevel_controller.meshes import make_mesh, scaled_mesh, simplified, volume_of

BALL = creation.icosphere(subdivisions=4, radius=2.0)  # 5120 faces


def loose(solid):
    """Mesh of a solid whose triangles share no corner, as in a .stl file."""
    return make_mesh(solid.triangles.reshape(-1, 3), np.arange(3 * len(solid.faces)).reshape(-1, 3))


def test_triangles_share_their_corners_and_those_without_an_area_are_left_out():
    mesh = loose(BALL)
    assert mesh.vertices.shape == BALL.vertices.shape
    assert mesh.faces.shape == BALL.faces.shape
    assert mesh.size == pytest.approx(BALL.extents)
    line = [[0, 1, 1], [0, 1, 2], [2, 1, 0]]
    assert make_mesh(np.eye(3), np.array(line)).faces.tolist() == [[2, 1, 0]]


def test_a_mesh_of_many_triangles_becomes_one_of_few_that_is_hardly_another():
    few = simplified(loose(BALL), 1000)
    assert 500 < len(few.faces) <= 1000
    assert np.linalg.norm(few.vertices, axis=1) == pytest.approx(2.0, abs=0.4)
    assert volume_of(few)[0] == pytest.approx(BALL.volume, rel=0.05)
    mesh = loose(BALL)
    assert simplified(mesh, 5120) is mesh


def test_volume_and_centroid_are_those_of_the_solid_or_of_the_box_around_a_sheet():
    cone = creation.cone(1.0, 2.0).apply_translation((5.0, 0.0, 1.0))
    volume, centroid = volume_of(loose(cone))
    assert volume == pytest.approx(cone.volume)
    assert centroid == pytest.approx(cone.center_mass)
    sheet = make_mesh(np.array([(0, 0, 0), (2, 0, 0), (0, 2, 1)]), np.array([(0, 1, 2)]))
    assert volume_of(sheet) == (4.0, (1.0, 1.0, 0.5))


def test_a_mesh_is_scaled_along_its_axes():
    mesh = loose(BALL)
    assert scaled_mesh(mesh, (1.0, 2.0, -0.5)).size == pytest.approx((4.0, 8.0, 2.0))
    assert scaled_mesh(mesh, (1.0, 1.0, 1.0)) is mesh
