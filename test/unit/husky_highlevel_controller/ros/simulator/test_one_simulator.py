"""A launch file is read by programs with this master, or with one of their own."""

import pytest

from husky_highlevel_controller.ros.simulator.one_simulator import has_own_master


@pytest.mark.parametrize(
    ("command_line", "own"),
    [
        (["/usr/bin/python3", "/usr/bin/rostest", "my_husky", "drives.test"], True),
        (["/usr/bin/python3", "/usr/bin/rostest", "--reuse-master", "drives.test"], False),
        (["/usr/bin/python3", "/opt/ros/noetic/bin/roslaunch", "my_husky", "rostest.launch"], False),
    ],
)
def test_rostest_starts_a_master_of_its_own(command_line, own):
    assert has_own_master(command_line) is own
