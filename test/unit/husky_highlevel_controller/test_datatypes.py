"""Records that are compared by their content."""

import pickle

import numpy as np

from husky_highlevel_controller.datatypes import TriangleMesh

VERTICES, FACES = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]), np.array([[0, 1, 2]])


def test_meshes_with_the_same_triangles_are_equal_so_that_they_share_a_shape():
    mesh = TriangleMesh(VERTICES, FACES)
    sent = pickle.loads(pickle.dumps(mesh))
    assert sent == mesh
    assert len({mesh, sent, TriangleMesh(VERTICES.copy(), FACES.copy(), "poster.dae")}) == 1
    assert mesh != TriangleMesh(VERTICES + 1.0, FACES)
    assert mesh != TriangleMesh(VERTICES, FACES[:, ::-1])
    assert mesh != "mesh"
