"""The records that know something: scans know their bearings, pillars their distance."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.controller.pillar_detection import Pillar
from husky_highlevel_controller.datatypes import Scan

LAW = settings(derandomize=True, deadline=None, max_examples=60)


def scan(ranges, angle_min=-2.35619, angle_max=2.35619):
    return Scan(0.0, "front_laser", angle_min, angle_max, 0.1, 30.0, np.array(ranges, dtype=float))


@LAW
@given(st.integers(2, 2000), st.floats(-3.1, 0.0), st.floats(0.1, 3.1))
def test_the_first_and_last_beam_point_at_the_scan_s_limits_and_the_rest_lie_evenly_between(
    beams, angle_min, angle_max
):
    it = scan(np.ones(beams), angle_min, angle_max)
    assert len(it.bearings) == beams
    assert (it.bearings[0], it.bearings[-1]) == (angle_min, angle_max)
    assert np.diff(it.bearings) == pytest.approx(it.angle_increment, abs=1e-12)


@pytest.mark.parametrize("beams", [0, 1])
def test_fewer_than_two_beams_have_no_step(beams):
    assert scan(np.ones(beams), -1.0, 1.0).angle_increment == 0.0


def test_valid_beams_are_those_within_the_range_limits_and_range_max_is_a_miss():
    ranges = [0.1, 1.0, 29.999, 30.0, 0.0999, 30.001, inf, -inf, nan, 0.0, -1.0]
    assert scan(ranges).valid.tolist() == [True] * 3 + [False] * 8


def test_a_pillar_s_distance_is_to_its_near_surface_and_its_bearing_grows_to_the_left():
    pillar = Pillar(x=3.0, y=4.0, radius=0.5, beams=10, residual=0.0)
    assert pillar.distance == pytest.approx(4.5)
    assert pillar.bearing == pytest.approx(0.9272952)
