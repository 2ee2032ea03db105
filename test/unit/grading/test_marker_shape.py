"""Where markers are drawn: reference point, nearest point to the pillar's axis, heights."""

from math import cos, pi, sin

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.grading.drive.marker_shape import draw, hull_distance

ARROW, CUBE, LINE_STRIP, SPHERE_LIST, POINTS = 0, 1, 4, 7, 8
AXIS = (10.0, 0.0)  # [m]


def test_a_box_is_seen_by_its_nearest_edge():
    drawn = draw(CUBE, Pose((9.0, 0.0, 1.0)), (1.0, 0.2, 0.6), [], AXIS)
    assert drawn.position == (9.0, 0.0, 1.0)
    assert drawn.reach == pytest.approx(0.5)
    assert (drawn.low, drawn.high) == pytest.approx((0.7, 1.3))


def test_a_turned_box_reaches_as_far_as_its_corner():
    turned = Pose((9.0, 0.0, 0.0), quat_from_rpy(0.0, 0.0, pi / 4.0))
    assert draw(CUBE, turned, (1.0, 1.0, 1.0), [], AXIS).reach == pytest.approx(1.0 - np.sqrt(0.5))


def test_a_box_around_the_axis_covers_it():
    assert draw(CUBE, Pose((10.2, 0.1, 0.0)), (1.0, 1.0, 1.0), [], AXIS).reach == 0.0


def test_an_arrow_counts_by_its_tip():
    down = Pose((10.0, 0.0, 2.5), quat_from_rpy(0.0, pi / 2.0, 0.0))
    assert draw(ARROW, down, (1.0, 0.1, 0.1), [], AXIS).position == pytest.approx((10.0, 0.0, 1.5))
    from_to = draw(ARROW, Pose(), (0.1, 0.2, 0.0), [(0.0, 0.0, 0.0), (9.8, 0.0, 0.5)], AXIS)
    assert from_to.position == pytest.approx((9.8, 0.0, 0.5))


def test_a_line_to_the_pillar_counts_by_its_end_and_points_by_their_mean():
    line = draw(LINE_STRIP, Pose(), (0.1, 0.0, 0.0), [(0.0, 0.0, 0.0), (9.9, 0.0, 0.0)], AXIS)
    assert line.position == pytest.approx((9.9, 0.0, 0.0))
    ring = [(10.0 + 0.2 * cos(a), 0.2 * sin(a), 0.0) for a in np.linspace(0.0, 2.0 * pi, 24, endpoint=False)]
    assert draw(POINTS, Pose(), (0.1, 0.1, 0.0), ring, AXIS).position == pytest.approx((10.0, 0.0, 0.0))


def test_points_on_both_sides_of_the_pillar_are_not_at_it():
    sides = [(10.0, -5.0, 0.0), (10.0, 5.0, 0.0)]
    assert abs(draw(SPHERE_LIST, Pose(), (0.4, 0.4, 0.4), sides, AXIS).position[1]) == pytest.approx(5.0)
    grid = [(10.0 + x, float(y), 0.0) for x in range(-7, 8) for y in range(-7, 8)]
    x, y, _ = draw(SPHERE_LIST, Pose(), (0.4, 0.4, 0.4), grid, AXIS).position
    assert np.hypot(x - 10.0, y) > 3.0


@pytest.mark.parametrize(
    ("points", "distance"),
    [([(1.0, 0.0)], 1.0), ([(1.0, -1.0), (1.0, 1.0)], 1.0), ([(-1.0, -1.0), (1.0, -1.0), (0.0, 2.0)], 0.0)],
)
def test_the_distance_to_a_hull(points, distance):
    assert hull_distance(np.array(points)) == pytest.approx(distance)
