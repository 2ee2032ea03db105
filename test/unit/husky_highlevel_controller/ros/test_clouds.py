"""Point clouds: thinned, finite, and of any layout."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from husky_highlevel_controller.ros.clouds import points_from_msg


def points_of(data, height, width, point_step, row_step, **more):
    fields = [PointField(axis, 4 * i, PointField.FLOAT32, 1) for i, axis in enumerate("xyz")]
    sizes = {"height": height, "width": width, "point_step": point_step, "row_step": row_step}
    return points_from_msg(PointCloud2(fields=fields, data=data, **sizes), **more).tolist()


def test_a_cloud_is_thinned_and_loses_what_is_not_finite():
    points = np.array([[0, 0, 0, 9], [np.nan, 0, 0, 9], [1, 2, 3, 9], [4, 5, 6, 9]], "<f4").tobytes()
    assert points_of(points, 1, 4, 16, 64) == [[0, 0, 0], [1, 2, 3], [4, 5, 6]]
    assert points_of(points, 1, 4, 16, 64, max_points=2) == [[0, 0, 0], [1, 2, 3]]
    assert points_of(b"", 1, 4, 16, 0) == []


@pytest.mark.parametrize("step", [0, 4, 11])
def test_a_cloud_whose_points_are_too_short_has_none(step):
    assert points_of(bytes(5 * step), 1, 5, step, 5 * step) == []


@pytest.mark.parametrize(("row_step", "count"), [(36, 4), (0, 4), (23, 0), (37, 0)])
def test_a_cloud_with_padded_rows_keeps_its_points(row_step, count):
    rows = np.array([[1, 2, 3, 4, 5, 6, 99, 99, 99], [7, 8, 9, 10, 11, 12, 99, 99, 99]], "<f4")
    data = (rows if row_step else rows[:, :6]).tobytes()
    expected = [[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]]
    assert points_of(data[:-13] if row_step == 37 else data, 2, 2, 12, row_step) == expected[:count]
