"""Files that a package names: the view of RViz is the student's own."""

import pytest
from packages import put

from husky_grading.hand_in.package_files import find_rviz_config
from husky_grading.submission import Plan, RvizNode
from husky_highlevel_controller.paths import share_folder


def test_the_view_of_the_simulators_own_launch_file_is_nobody_elses(tmp_path):
    view = share_folder() / "rviz" / "controller.rviz"
    node = RvizNode("husky_rviz", f"-d {view}", ())
    assert not find_rviz_config(Plan(("a/b",), rviz=(node,), package_path=tmp_path)).started
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "package.xml").symlink_to(share_folder() / "package.xml")
    for place in (share_folder(), tmp_path / "links"):
        own = find_rviz_config(Plan(("a/b",), rviz=(node,), package_path=place))
        assert own.source == "its rviz node, controller.rviz"


@pytest.mark.parametrize(("place", "counts"), [("ws", True), ("copies", True), ("elsewhere", False)])
def test_a_configuration_in_a_copy_of_a_known_package_was_handed_in(place, counts, tmp_path):
    view = put(tmp_path / place / "src" / "husky_gazebo" / "view.rviz", "Visualization Manager: {}")
    (tmp_path / "package").mkdir()
    planned = Plan(("a/b",), rviz=(RvizNode("rviz", f"-d {view}", ()),), package_path=tmp_path / "package")
    config = find_rviz_config(planned, tmp_path / "ws")
    assert (config.source == "its rviz node, view.rviz") == counts
    assert bool(config.missing) != counts
