"""docs/reference.md agrees with the code about arguments, parameters, topics and defaults."""

import re
from dataclasses import fields

import pytest
import yaml
from defusedxml import ElementTree

from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.crash_detection import CrashConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.controller.safety import ProximityConfig
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.robot import ROBOTS, load_robot
from husky_highlevel_controller.ros.controller.display import ESTIMATE, IN_LASER, IN_ODOM, PATH, STATE, TARGET
from husky_highlevel_controller.ros.controller.node import ScanTopicConfig, StartStopConfig
from husky_highlevel_controller.ros.safety.guard import ServiceConfig

SHARE = share_folder()
REFERENCE = (SHARE / "docs" / "reference.md").read_text()


def assert_told(name, default):
    """A parameter has a table row, with its default; two nodes may have parameters of one name."""
    rows = [line.strip("|").split("|") for line in REFERENCE.splitlines() if line.startswith("|")]
    told = [cells[1] for cells in rows if f"`{name}`" in cells[0]]
    assert told, f"{name} has no row"
    assert any(default in cell for cell in told), f"{name}: docs/reference.md says {told}, the code {default}"


@pytest.mark.parametrize("file", ["controller.launch", "simulator.launch"])
def test_every_launch_argument_has_a_row(file):
    for argument in ElementTree.parse(SHARE / "launch" / file).getroot().findall("arg"):
        default = argument.get("default")
        if argument.get("name") in (
            "rviz",
            "world_name",
            "parameters",
            "simulator_parameters",
        ):  # told in words
            default = ""
        husky = r"\$\(eval (?:.* )?optenv\('(\w+)', .* '(\S+)'\)\)"  # the last value is the Husky's
        default = re.sub(husky, r"`$\1`, else `\2`", default)
        assert_told(argument.get("name"), re.sub(r"\$\(optenv (\w+) (\S+)\)", r"`$\1`, else `\2`", default))


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("file", ["controller", "simulator", "web", "robot"])
def test_the_launch_files_name_the_robot_s_topics(file, robot):
    topics = load_robot(robot).topics
    assert topics_in(file, robot) == {topics.scan, *([topics.imu] if file == "robot" else [])}
    assert topics.limited_command == f"{robot}_velocity_controller/cmd_vel_out", "as web.launch has it"
    if robot == "husky":  # on which the lidar of older Huskies is
        assert topics_in(file, "husky_melodic") == {"scan", *([topics.imu] if file == "robot" else [])}


def topics_in(file, robot):
    """Topics that are defaults of a launch file's arguments for a robot."""
    told = set()
    for argument in ElementTree.parse(SHARE / "launch" / f"{file}.launch").getroot().findall("arg"):
        if "arg('robot')" in argument.get("default") and argument.get("name").endswith("topic"):
            default = argument.get("default").partition(" ")[2][:-1]
            told.add(eval(default, {"arg": lambda _: robot, "optenv": lambda _, value: value}))
    return told


@pytest.mark.parametrize(
    ("file", "records"),
    [
        ("controller", [ScanTopicConfig, StartStopConfig, ControlConfig, PillarConfig]),
        ("proximity_stop", [ServiceConfig, ProximityConfig]),
        ("crash_stop", [ServiceConfig, CrashConfig]),
    ],
)
def test_a_node_s_yaml_file_says_what_the_code_says(file, records):
    values = yaml.safe_load((SHARE / "config" / f"{file}.yaml").read_text())
    assert read_config(values, f"{file}.yaml: ", *records) == [record() for record in records]
    assert f"[config/{file}.yaml](../config/{file}.yaml)" in REFERENCE


@pytest.mark.parametrize("file", ["controller", "proximity_stop", "crash_stop", "simulator", "robots/husky"])
def test_every_parameter_in_a_yaml_file_has_its_meaning_beside_it(file):
    text = (SHARE / "config" / f"{file}.yaml").read_text()
    if file.startswith("robots/"):
        text = text[text.index("# parameters of husky_simulator") :]
    lines = [line for line in text.splitlines() if re.match(r"\s*\w+: \S", line)]
    assert lines
    assert [line for line in lines if not re.search(r"\S\s+# \S", line)] == []


def test_the_parameters_of_scans_are_told():
    for parameter in fields(ScanTopicConfig):
        assert re.search(rf"`~{parameter.name}` \(`?{parameter.default}`?\)", REFERENCE), parameter.name


def test_every_topic_of_the_husky_has_a_row():
    topics = dict(vars(load_robot().topics))
    for name in {*topics.pop("velocity"), *topics.values()} - {""}:
        assert f"`{name}`" in REFERENCE, name


@pytest.mark.parametrize(
    "module",
    [
        "simulator/publishers",
        "simulator/depth_camera",
        "simulator/commands",
        "simulator/world_services",
        "simulator/node",
        "controller/node",
        "controller/display",
        "controller/diagnostics",
    ],
)
def test_every_topic_and_service_has_a_row(module):
    source = (SHARE / "src/husky_highlevel_controller/ros" / f"{module}.py").read_text()
    names = re.findall(
        r'(?:rospy\.(?:Publisher|Subscriber|Service)|calls\.offer|sensor)\(\s*"([^"]+)"', source
    )
    assert names
    for name in names:
        assert f"`{name}`" in REFERENCE, name


@pytest.mark.parametrize("namespace", [ESTIMATE, IN_LASER, IN_ODOM, PATH, STATE, TARGET])
def test_every_marker_namespace_is_told(namespace):
    assert f"`{namespace}`" in REFERENCE
