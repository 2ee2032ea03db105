"""Where markers are drawn: reference point, nearest point to the pillar's axis, heights."""

from math import cos, pi, sin

import numpy as np
import pytest

from husky_grading.drive.marker_shape import draw, hull_distance
from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.geometry import quat_from_rpy

ARROW, CUBE, LINE_STRIP, SPHERE_LIST, POINTS = 0, 1, 4, 7, 8
AXIS = (10.0, 0.0)  # [m]


@pytest.mark.parametrize(
    ("pose", "size", "reach", "low", "high"),
    [
        (Pose((9.0, 0.0, 1.0)), (1.0, 0.2, 0.6), 0.5, 0.7, 1.3),  # by its nearest edge
        (Pose((9.0, 0.0, 0.0), quat_from_rpy(0, 0, pi / 4)), (1, 1, 1), 1.0 - np.sqrt(0.5), -0.5, 0.5),
        (Pose((10.2, 0.1, 0.0)), (1.0, 1.0, 1.0), 0.0, -0.5, 0.5),  # around the axis
    ],
)
def test_a_box_reaches_as_far_as_its_nearest_edge_or_corner(pose, size, reach, low, high):
    drawn = draw(CUBE, pose, size, [], AXIS)
    assert drawn.position == pose.position
    assert (drawn.reach, drawn.low, drawn.high) == pytest.approx((reach, low, high))


RING = [(10.0 + 0.2 * cos(a), 0.2 * sin(a), 0.0) for a in np.linspace(0.0, 2.0 * pi, 24, endpoint=False)]


@pytest.mark.parametrize(
    ("kind", "pose", "points", "position"),
    [
        (ARROW, Pose((10.0, 0.0, 2.5), quat_from_rpy(0.0, pi / 2.0, 0.0)), [], (10.0, 0.0, 1.5)),
        (ARROW, Pose(), [(0.0, 0.0, 0.0), (9.8, 0.0, 0.5)], (9.8, 0.0, 0.5)),
        (LINE_STRIP, Pose(), [(0.0, 0.0, 0.0), (9.9, 0.0, 0.0)], (9.9, 0.0, 0.0)),
        (POINTS, Pose(), RING, (10.0, 0.0, 0.0)),
    ],
    ids=["an arrow by its tip", "also from point to point", "a line by its end", "points by their mean"],
)
def test_what_a_marker_counts_by(kind, pose, points, position):
    assert draw(kind, pose, (1.0, 0.1, 0.1), points, AXIS).position == pytest.approx(position)


def test_points_on_both_sides_of_the_pillar_are_not_at_it():
    sides = [(10.0, -5.0, 0.0), (10.0, 5.0, 0.0)]
    grid = [(10.0 + x, float(y), 0.0) for x in range(-7, 8) for y in range(-7, 8)]
    for points in (sides, grid):
        x, y, _ = draw(SPHERE_LIST, Pose(), (0.4, 0.4, 0.4), points, AXIS).position
        assert np.hypot(x - 10.0, y) > 3.0


@pytest.mark.parametrize(
    ("points", "distance"),
    [([(1.0, 0.0)], 1.0), ([(1.0, -1.0), (1.0, 1.0)], 1.0), ([(-1.0, -1.0), (1.0, -1.0), (0.0, 2.0)], 0.0)],
)
def test_the_distance_to_a_hull(points, distance):
    assert hull_distance(np.array(points)) == pytest.approx(distance)
