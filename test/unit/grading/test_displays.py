"""RViz by its configuration and the frames of a drive: which file it is, and what would be shown."""

from dataclasses import replace

import pytest
import yaml

from husky_highlevel_controller.grading.displays import STANDING, FrameTree, RvizConfig, read_config, view_of
from husky_highlevel_controller.grading.hand_in.package_files import find_setup
from husky_highlevel_controller.grading.submission import Plan, RvizNode
from husky_highlevel_controller.paths import share_folder

OFF = {"Enabled": False}
TF = {"Class": "rviz/TF"}
SCAN = {"Class": "rviz/LaserScan", "Topic": "/front/scan"}
MODEL = {"Class": "rviz/RobotModel"}
MARKER = {"Class": "rviz/Marker", "Marker Topic": "/marker"}


def shown(*displays, frame="odom", tree=STANDING, **more):
    options = {"Displays": list(displays), "Global Options": {"Fixed Frame": frame}}
    return view_of(read_config("a.rviz", {"Visualization Manager": options}, **more), tree)


def parts(view):
    return view.tf, view.robot, view.scan


def test_our_own_configuration_shows_everything():
    text = (share_folder() / "rviz" / "controller.rviz").read_text()
    view = view_of(read_config("controller.rviz", yaml.safe_load(text)), STANDING)
    assert parts(view) == (True, True, True)
    assert "/front/scan" in view.topics
    assert not view.problem


def test_a_cloud_is_known_by_topic_colour_and_size_even_where_no_transform_shows_it():
    cloud = {"Class": "rviz/PointCloud2", "Topic": "/points", "Color Transformer": "AxisColor", "Axis": "Z"}
    view = shown({**cloud, "Size (m)": 0.05}, frame="nowhere")
    assert view.problem
    (display,) = view.clouds
    assert (display.source, display.colouring, display.size) == ("/points", "AxisColor Z", 0.05)
    assert not shown({**cloud, "Size (m)": 0}).clouds
    assert not shown({**cloud, **OFF}).clouds


@pytest.mark.parametrize(
    ("display", "is_shown"),
    [
        ({**TF, **OFF}, False),
        ({**TF, "Marker Scale": 0}, False),
        ({**TF, "Show Axes": False, "Show Names": False, "Show Arrows": False}, False),
        ({**TF, "Frames": {"All Enabled": False, "odom": {"Value": False}}}, False),
        ({**TF, "Frames": {"All Enabled": False, "odom": {"Value": True}}}, True),  # in part
        ({**SCAN, "Alpha": 0}, False),
        ({**SCAN, "Style": "Points", "Size (Pixels)": 0}, False),
        ({**SCAN, "Style": "Points", "Size (m)": 0}, True),
        ({**SCAN, "Style": "Flat Squares", "Size (m)": 0}, False),
        ({**MODEL, "Alpha": 0.0}, False),
        ({**MODEL, "Visual Enabled": False}, False),
        ({**MODEL, "Links": {"base_link": {"Value": False}}}, False),
        ({**MODEL, "Links": {"base_link": {"Value": False}, "top": {"Value": True}}, "Alpha": "x"}, True),
        ({**MODEL, "Robot Description": "my_robot"}, False),
        ({**MODEL, "Robot Description": "/smb_description"}, True),  # the SMB's own
        ({"Class": "rviz/Group", "Displays": [{"Class": "rviz/Group", "Displays": [TF]}]}, True),
        ({"Class": "rviz/Group", "Displays": [SCAN, MODEL, TF], **OFF}, False),
        ({"Class": "rviz/PointCloud2"}, False),
        ({"Class": ["rviz/TF"]}, False),
        (7, False),
    ],
)
def test_a_display_without_size_colour_or_parts_is_not_shown(display, is_shown):
    assert any(parts(shown(display))) is is_shown


def test_the_fixed_frame_must_be_connected():
    lost = shown(TF, SCAN, frame="map")
    assert parts(lost) == (False, False, False)
    assert not shown(MODEL, tree=FrameTree({"base_link": "odom"})).robot, "which has no description"
    assert "fixed frame 'map'" in lost.problem
    slam = FrameTree({"odom": "map", "base_link": "odom"}, ("/robot_description",))
    assert parts(shown(TF, SCAN, MODEL, frame="/map", tree=slam)) == (True, True, True)
    loop = FrameTree({"odom": "base_link", "base_link": "odom"})
    assert not shown(TF, frame="else", tree=loop).tf


def test_topics_and_namespaces_of_markers():
    view = shown({**MARKER, "Namespaces": {"a": True, "b": False}}, remaps=(("/marker", "/pillar"),))
    assert view.topics == ("/pillar", "/pillar_array")
    assert view.hidden == (("/pillar", "b"),)
    assert shown({**MARKER, **OFF}).topics == ()
    assert shown({**SCAN, "Topic": "front/scan"}).topics == ("/front/scan",)


@pytest.mark.parametrize("content", [None, [], "x", {"Visualization Manager": []}])
def test_what_is_no_configuration_of_rviz_is_told_and_one_of_any_depth_ends(content):
    assert view_of(read_config("a.rviz", content), STANDING).problem == "the file is not RViz's"
    deep = [TF]
    for _ in range(600):
        deep = [{"Class": "rviz/Group", "Displays": deep}]
    assert not shown(*deep).tf


def put(path, text=""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_only_what_is_switched_on_counts(tmp_path):
    put(tmp_path / "a.rviz", "Visualization Manager: {Displays: [{Class: rviz/TF, Enabled: false}]}")
    put(tmp_path / "z" / "b.rviz", "Visualization Manager: {Displays: [{Class: rviz/LaserScan}]}")
    put(tmp_path / "c.rviz", "- no: rviz")
    assert find_setup(Plan(package_path=tmp_path)).source == "b.rviz"
    assert find_setup(Plan()) == RvizConfig()
    for value in (f"Alpha: 1{'0' * 400}", f"Topic: 0x{'f' * 5000}"):
        display = f"{{Class: rviz/LaserScan, {value}}}"
        put(tmp_path / "numbers" / "a.rviz", f"Visualization Manager: {{Displays: [{display}]}}")
        assert find_setup(Plan(package_path=tmp_path / "numbers")).problem == "the file is not RViz's"


def test_the_file_of_the_rviz_node_is_the_one(tmp_path):
    put(tmp_path / "mine.rviz", "Visualization Manager: {Displays: [{Class: rviz/LaserScan, Topic: /a}]}")
    node = RvizNode("rviz", f"-f odom -d {tmp_path}/mine.rviz", (("/a", "/b"),))
    setup = find_setup(Plan(rviz=(node,)))
    assert (setup.source, setup.displays[0].source) == ("its rviz node, mine.rviz", "/b")
    in_home = find_setup(Plan(rviz=(replace(node, args=""),)))
    assert (in_home.source, in_home.started) == ("", True), "it is in the student's home"
    (tmp_path / "ws").mkdir()
    assert not find_setup(Plan(rviz=(node,)), tmp_path / "ws").source, "it is not in the hand-in"
