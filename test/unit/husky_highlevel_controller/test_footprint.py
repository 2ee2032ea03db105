"""Footprint of a robot: clearances of points from its outline."""

import numpy as np
import pytest

from husky_highlevel_controller.footprint import Footprint

HUSKY = Footprint(hull=(0.5, 0.25), wheels=(0.42, 0.23, 0.34))


@pytest.mark.parametrize(
    ("point", "clearance"),
    [((0.0, 0.0), 0.0), ((0.8, 0.0), 0.3), ((0.0, -0.44), 0.1), ((-0.45, 0.38), 0.05), ((0.53, 0.29), 0.05)],
)
def test_the_clearance_of_a_point_is_the_same_alone_and_in_an_array(point, clearance):
    assert HUSKY.clearance_at(*point) == pytest.approx(clearance, abs=1e-9)
    assert HUSKY.clearance(np.array([point])) == pytest.approx([clearance], abs=1e-9)
