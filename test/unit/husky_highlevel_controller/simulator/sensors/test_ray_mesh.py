"""Rays against triangles: as against the closed forms, at every pose."""

from math import inf, pi

import numpy as np
import pytest
from trimesh import creation

from husky_highlevel_controller.datatypes import Box, Pose, even_beams
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.meshes import make_mesh
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene

LIDAR, ALL_ROUND = even_beams(-2.35619, 2.35619, 720), even_beams(-pi, pi, 721)
CUBE = creation.box((2.0, 1.0, 3.0))
MESH, BOX = make_mesh(CUBE.vertices, CUBE.faces), Box((2.0, 1.0, 3.0))


@pytest.mark.parametrize("beams", [LIDAR, ALL_ROUND], ids=["lidar", "all round"])
def test_a_box_of_triangles_reads_as_a_box(beams):
    rng = np.random.default_rng(0)
    for _ in range(200):
        shape = Pose(
            (*rng.uniform(-5.0, 5.0, 2), rng.uniform(-1.5, 1.5)), quat_from_rpy(*rng.uniform(-pi, pi, 3))
        )
        laser = Pose((0.0, 0.0, 0.4), quat_from_rpy(*rng.choice([0.0, pi], 1), *rng.uniform(-0.1, 0.1, 2)))
        expected = cast_rays(make_scene([(BOX, shape)]), laser, beams, 30.0)
        if expected.min() == 0.0:  # inside: a mesh is a surface
            continue
        read = cast_rays(make_scene([(MESH, shape)]), laser, beams, 30.0)
        # a beam along an edge may hit or miss
        assert (np.isfinite(read) != np.isfinite(expected)).sum() <= 1
        both = np.isfinite(read) & np.isfinite(expected)
        assert read[both] == pytest.approx(expected[both], abs=1e-9)


def test_a_mesh_is_seen_from_within_and_no_beam_slips_through():
    room = creation.icosphere(subdivisions=4, radius=3.0)
    mesh = make_mesh(room.vertices, room.faces)
    ranges = cast_rays(make_scene([(mesh, Pose())]), Pose((0.1, 0.2, 0.3)), ALL_ROUND, 30.0)
    assert ranges == pytest.approx(3.0, abs=0.5)


def test_a_mesh_that_moves_or_is_too_far_reads_so():
    scene = make_scene([(MESH, Pose((5.0, 0.0, 0.0)))])
    forward = even_beams(0.0, 0.0, 1)
    assert cast_rays(scene, Pose(), forward, 30.0) == pytest.approx([4.0])
    assert cast_rays(scene, Pose(), forward, 3.0) == inf
    scene.move_mesh(0, Pose((7.0, 0.0, 0.0), quat_from_rpy(0.0, 0.0, pi / 2.0)))
    assert cast_rays(scene, Pose(), forward, 30.0) == pytest.approx([6.5])
    scene.move_mesh(0, Pose((7.0, 0.0, 9.0)))
    assert cast_rays(scene, Pose(), forward, 30.0) == inf
