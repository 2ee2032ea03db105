"""Files of a hand-in: what RViz would show by its configuration, and for which robot the hand-in is."""

from dataclasses import replace

import pytest
import yaml
from packages import put

from husky_grading.displays import STANDING, FrameTree, RvizConfig, read_rviz_config, view_of
from husky_grading.drive import ros_graph
from husky_grading.drive.ros_graph import robot_listened_to
from husky_grading.hand_in.package_files import (
    files_of_others,
    find_rviz_config,
    named_robot,
)
from husky_grading.records import MarkingConfig
from husky_grading.submission import Plan, RvizNode
from husky_highlevel_controller.paths import share_folder

OFF = {"Enabled": False}
TF = {"Class": "rviz/TF"}
SCAN = {"Class": "rviz/LaserScan", "Topic": "/front/scan"}
MODEL = {"Class": "rviz/RobotModel"}
MARKER = {"Class": "rviz/Marker", "Marker Topic": "/marker"}


def shown(*displays, frame="odom", tree=STANDING, types=(), **more):
    options = {"Displays": list(displays), "Global Options": {"Fixed Frame": frame}}
    return view_of(read_rviz_config("a.rviz", {"Visualization Manager": options}, **more), tree, dict(types))


def parts(view):
    return view.tf, view.robot, view.scan


def test_our_own_configuration_shows_everything():
    text = (share_folder() / "rviz" / "controller.rviz").read_text()
    view = view_of(read_rviz_config("controller.rviz", yaml.safe_load(text)), STANDING, {})
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
    both = shown({**MARKER, "Namespaces": {"a": True, "b": False}}, {**MARKER, "Namespaces": {"a": False}})
    assert both.hidden == (), "one of two displays shows each namespace"
    assert shown({**MARKER, **OFF}).topics == ()
    assert shown({**SCAN, "Topic": "front/scan"}).topics == ("/front/scan",)


@pytest.mark.parametrize("content", [None, [], "x", {"Visualization Manager": []}])
def test_what_is_no_configuration_of_rviz_is_told_and_one_of_any_depth_ends(content):
    assert (
        view_of(read_rviz_config("a.rviz", content), STANDING, {}).problem
        == "the file is not a configuration of RViz"
    )
    deep = [TF]
    for _ in range(600):
        deep = [{"Class": "rviz/Group", "Displays": deep}]
    assert not shown(*deep).tf


def rviz_file(display):
    return f"Visualization Manager: {{Displays: [{{Class: rviz/{display}}}]}}"


@pytest.mark.parametrize(
    ("display", "topic", "message", "is_shown"),
    [
        ("Marker", "/marker", "Marker", True),
        ("Marker", "/marker", "MarkerArray", False),
        ("Marker", "/marker_array", "MarkerArray", True),
        ("Marker", "/marker_array", "Marker", False),
        ("MarkerArray", "/marker", "MarkerArray", True),
        ("MarkerArray", "/marker", "Marker", False),
        ("MarkerArray", "/marker_array", "MarkerArray", False),
        ("MarkerArray", "/marker", None, True),
        ("Marker", "/marker", None, True),
    ],
)
def test_a_display_of_markers_shows_messages_of_its_type(display, topic, message, is_shown):
    types = {topic: f"visualization_msgs/{message}"} if message else {}
    view = shown({**MARKER, "Class": f"rviz/{display}"}, types=types)
    assert (topic in view.topics) == is_shown
    assert [each.source for each in view.mistyped] == ["/marker"] * (not is_shown and topic == "/marker")


SLAM = {"slam.rviz": rviz_file("TF")}
SHOWS_SLAM = '<node pkg="rviz" args="-d $(find a)/slam.rviz"/></launch>'
BY_VIEWER = {**SLAM, "slam.launch": f'<launch><node pkg="gazebo_ros"/>{SHOWS_SLAM}'}
BY_BAG = {**SLAM, "slam.launch": f'<launch><node pkg="rosbag"/>{SHOWS_SLAM}'}
BY_CODE = {**SLAM, "slam.launch": f'<launch><node pkg="a"/>{SHOWS_SLAM}'}
SOME = {"a.rviz": rviz_file("TF, Enabled: false"), "z/b.rviz": rviz_file("LaserScan"), "c.rviz": "- no: rviz"}


@pytest.mark.parametrize(
    ("files", "node", "source"),
    [
        ({}, None, ""),
        ({}, "", ""),  # in the student's home
        (SOME, None, "b.rviz"),  # only what is switched on counts
        (SOME, "-f odom -d {}/a.rviz", "its rviz node, a.rviz"),
        # a file that only another launch file names is that one's, unless that one only shows
        (BY_VIEWER, "", "slam.rviz, the package's only .rviz file, used by slam.launch"),
        (BY_BAG, "", ""),
        ({**BY_BAG, "mine.rviz": "{}"}, "", "mine.rviz"),
        (BY_VIEWER, None, "slam.rviz"),
        (BY_BAG, None, ""),
        (BY_CODE, None, ""),
        ({**SLAM, "slam.launch.xml": BY_CODE["slam.launch"]}, None, ""),
    ],
)
def test_the_configuration_of_a_hand_in(files, node, source, tmp_path):
    folder = tmp_path / "a"
    for name, text in {**files, "husky.launch": "<launch/>"}.items():
        put(folder / name, text)
    nodes = () if node is None else (RvizNode("rviz", node.format(folder), ()),)
    planned = Plan(("a/b",), rviz=nodes, package_path=folder)
    setup = find_rviz_config(planned, None, "/ws/src/a/launch/husky.launch")
    assert setup.source == source
    assert setup.source or setup == RvizConfig(started=node == "")
    if "slam.launch" in files and "slam.rviz" not in source:
        assert find_rviz_config(planned, None, "slam.launch").source == "slam.rviz"
        aside = "slam.rviz belongs to slam.launch, so it is not graded"
        assert files_of_others(planned, "husky.launch") == [aside]


def test_the_file_of_the_rviz_node_is_that_of_the_hand_in_as_its_topics_are_remapped(tmp_path):
    put(tmp_path / "mine.rviz", rviz_file("LaserScan, Topic: /a"))
    planned = Plan(rviz=(RvizNode("rviz", f"-d {tmp_path}/mine.rviz", (("/a", "/b"),)),))
    assert find_rviz_config(planned).displays[0].source == "/b"
    assert not find_rviz_config(planned, tmp_path / "ws").source, "it is not in the hand-in"
    for value in (f"Alpha: 1{'0' * 400}", f"Topic: 0x{'f' * 5000}"):
        put(tmp_path / "numbers" / "a.rviz", rviz_file(f"LaserScan, {value}"))
        assert (
            find_rviz_config(Plan(package_path=tmp_path / "numbers")).problem
            == "the file is not a configuration of RViz"
        )


# ---------------------------------------------------------------------------- the robot that it is for


@pytest.mark.parametrize(
    ("name", "text", "robot", "why"),
    [
        ("a.launch", '<include file="$(find smb_gazebo)/launch/smb_gazebo.launch"/>', "smb", "smb_gazebo"),
        ("a.cpp", 'lookupTransform("odom", "rslidar", ros::Time(0))', "smb", "rslidar"),
        ("node", '"/imu0"', "smb", "/imu0"),
        ("view.rviz", "Topic: /rslidar_points", "smb", "/rslidar_points"),
        ("view.rviz", "Topic: /scan", "husky_melodic", "/scan"),
        ("view.rviz", "Topic: /front/scan", "husky", "front/scan"),
        ("view.rviz", "Frames:\n  rslidar:\n    Value: true\nTopic: front/scan", "husky", "front/scan"),
        ("its package", "Topic: ''", "husky", "no topic of scans"),
    ],
)
def test_what_a_package_names_is_a_first_guess_at_its_robot(name, text, robot, why, tmp_path):
    (tmp_path / name).write_text(text)
    named = named_robot(Plan(nodes=("p/n",), package_path=tmp_path))
    assert (named.version, named.is_certain) == (robot, robot == "smb")
    assert named.why.endswith(f": {name} names {why}")
    assert named_robot(Plan(nodes=("p/n",), left_out=("smb_gazebo/spawn",))).version == "smb"


def test_a_package_with_a_filter_between_front_scan_and_scan_is_for_the_husky(tmp_path):
    (tmp_path / "controller.py").write_text('rospy.Subscriber("/scan", LaserScan, drive)')
    (tmp_path / "median_filter.py").write_text('rospy.Subscriber("/front/scan", LaserScan, smooth)')
    named = named_robot(Plan(nodes=("p/n",), package_path=tmp_path))
    assert named.version == "husky"
    assert named.why.endswith(": median_filter.py names front/scan")


@pytest.mark.parametrize(
    ("topics", "guess", "told"),
    [
        (("/front/scan", "/scan"), "husky", ("husky", "")),
        (("/front/scan", "/scan"), "husky_melodic", ("husky_melodic", "")),
        (("/front/scan",), "husky_melodic", ("husky", "")),
        (("/scan",), "husky", ("husky_melodic", "")),
        (("/laser",), "husky", ("husky", "/laser")),
        (("/laser", "/rear"), "husky", None),
        ((), "husky", None),
    ],
)
def test_what_it_subscribes_to_decides(topics, guess, told, monkeypatch):
    listeners = [[topic, ["/controller"]] for topic in topics] + [["/scan", ["/rosout"]]] * (
        "/scan" not in topics
    )
    types = [[topic, "sensor_msgs/LaserScan"] for topic in topics]
    answers = {"getSystemState": [[], listeners, []], "getTopicTypes": types}
    monkeypatch.setattr(ros_graph, "_ask", lambda _, method: answers[method])
    config = MarkingConfig(robot=guess)
    assert robot_listened_to("", ["/rosout"], config) == (
        told and replace(config, robot=told[0], scans=told[1])
    )
