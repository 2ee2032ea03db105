"""A point cloud becomes a scan as pointcloud_to_laserscan makes it."""

from dataclasses import replace
from math import atan2, hypot

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.simulator.sensors.points_to_scan import FlattenConfig, flatten, parameters_of

COURSE = FlattenConfig(
    min_height=-0.2, max_height=1.0, angle_min=-1.5708, angle_max=1.5708, angle_increment=0.0087,
    range_min=0.45, range_max=50.0,
)  # fmt: skip


def test_each_direction_has_the_nearest_point_within_the_heights():
    points = [(5.0, 0.0, 0.1), (3.0, 0.0, 0.9), (2.0, 0.0, 1.1), (2.0, 0.0, -0.3), (0.0, 4.0, 0.0)]
    ranges = flatten(np.array(points), COURSE)
    assert len(ranges) == 362
    assert ranges[int(1.5708 / 0.0087)] == 3.0
    assert ranges[int((np.pi / 2.0 + 1.5708) / 0.0087)] == 4.0
    assert np.isfinite(ranges).sum() == 2


@pytest.mark.parametrize("point", [(0.4, 0.0, 0.0), (51.0, 0.0, 0.0), (-2.0, 0.0, 0.0)])
def test_what_is_too_near_too_far_or_behind_is_left_out(point):
    assert np.isinf(flatten(np.array([point]), COURSE)).all()
    far = FlattenConfig(range_max=1.0, range_min=0.9, use_inf=False)
    assert (flatten(np.array([point]), far) == 2.0).all(), "beyond range_max by inf_epsilon"


def test_no_point_and_no_direction():
    assert np.isinf(flatten(np.zeros((0, 3)), COURSE)).all()
    with pytest.raises(ConfigError, match=r"angle_min = 2.0 is not below angle_max = 1.0"):
        read_config({**vars(COURSE), "angle_min": 2.0, "angle_max": 1.0}, "~", FlattenConfig)


def test_directions_without_number_are_refused_by_name():
    with pytest.raises(ValueError, match=r"angle_increment = 0\.0001 makes 2000000"):
        FlattenConfig(angle_min=-100.0, angle_max=100.0, angle_increment=1e-4)


def test_an_argument_that_roslaunch_has_not_put_in_is_the_default():
    values = parameters_of(
        {"min_height": "$(arg min)", "max_height": 0.2, "target_frame": "rslidar", "other": 1}
    )
    (config,) = read_config(values, "", FlattenConfig)
    assert (config.min_height, config.max_height) == (FlattenConfig().min_height, 0.2)
    assert config.target_frame == "rslidar"


def point_by_point(points, config):
    """Ranges by the rules of pointcloud_to_laserscan 1.4, without our arrays."""
    nearest = {}
    for x, y, z in points:
        distance, angle = hypot(x, y), atan2(y, x)
        if (
            config.min_height <= z <= config.max_height
            and config.range_min <= distance <= config.range_max
            and config.angle_min <= angle <= config.angle_max
        ):
            direction = int((angle - config.angle_min) / config.angle_increment)
            nearest[direction] = min(distance, nearest.get(direction, distance))
    missing = np.inf if config.use_inf else config.range_max + config.inf_epsilon
    return [nearest.get(direction, missing) for direction in range(config.directions)]


METRES = st.floats(-60.0, 60.0, width=32)
HEIGHTS = st.floats(-0.5, 1.5, width=32)


@given(st.lists(st.tuples(METRES, METRES, HEIGHTS), min_size=1, max_size=40), st.booleans())
def test_any_cloud_gives_the_ranges_that_the_original_s_rules_give(points, use_inf):
    config = replace(COURSE, use_inf=use_inf)
    assert flatten(np.array(points), config) == pytest.approx(point_by_point(points, config))
