"""Ground, horizon and sky of the page's scene."""

import io

import numpy as np
import pytest
import trimesh

from husky_web import backdrop


@pytest.mark.parametrize("name", ["day", "night"])
def test_the_ground_reaches_to_a_horizon_below_a_closed_sky(name):
    (part,) = trimesh.load(io.BytesIO(backdrop.scenery(backdrop.LOOKS[name])), file_type="glb").dump()
    lengths = np.linalg.norm(part.vertices, axis=1)
    assert -0.02 < part.vertices[:, 2].min() <= 0.0
    assert lengths.max() == pytest.approx(backdrop.RADIUS)
    assert part.vertices[:, 2].max() == pytest.approx(backdrop.RADIUS)


def test_the_ground_shows_metres_near_the_robot_and_no_pattern_far_away():
    look = backdrop.LOOKS["day"]
    quads, colors = backdrop.checker(look)

    def contrast(x, y):
        from_middle = np.linalg.norm(quads.mean(axis=1) - (x + 0.5, y + 0.5, 0.0), axis=1)
        return colors[from_middle.argmin(), 0, 0] / look.ground[0] - 1.0

    assert np.sign([contrast(x, y) for x, y in ((1, 1), (1, 2), (2, 2), (2, 1))]).tolist() == [1, -1, 1, -1]
    assert abs(contrast(1, 1)) > 0.05
    assert abs(contrast(24, 7)) < 0.01
