"""Files that a package names: the view of RViz is the student's own."""

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
