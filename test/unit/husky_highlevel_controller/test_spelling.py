"""A name is like another one if each of its parts is."""

import pytest

from husky_highlevel_controller.spelling import likeness, nearest


@pytest.mark.parametrize(
    ("name", "other", "separator", "is_like"),
    [
        ("sensor_msg", "sensor_msgs", "_", True),
        ("pcl_conversions", "kdl_conversions", "_", False),
        ("front_scan", "front/scan", "/", True),
        ("cmd_vel_raw", "cmd_vel", "/", False),
    ],
)
def test_the_least_part_decides(name, other, separator, is_like):
    assert (likeness(name, other, separator) >= 0.85) == is_like


def test_the_nearest_name_is_the_one_that_is_most_like():
    assert nearest("sensor_msg", ("sensor_msgs", "sensor_mags", "std_msgs"), "_", 0.8) == "sensor_msgs"
    assert nearest("boost", ("roscpp",), "_", 0.8) is None
    assert nearest("boost", (), "_", 0.8) is None
