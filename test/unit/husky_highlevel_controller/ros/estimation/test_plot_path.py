"""`plot_path`: what is no bag is named."""

import pytest

pytest.importorskip("rosbag")

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.ros.estimation.plot_path import paths_of_bag


@pytest.mark.parametrize("content", [b"", b"a text", b"\xff\xfea text of another kind", b"#ROSBAG V2.0\n"])
def test_a_file_that_is_no_bag_is_named(content, tmp_path):
    file = tmp_path / "drive.bag"
    file.write_bytes(content)
    with pytest.raises(HuskyError, match=str(file)):
        paths_of_bag(file)
