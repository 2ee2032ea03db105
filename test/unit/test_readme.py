"""README.md tells the truth about arguments, parameters, topics and defaults."""

import re
from dataclasses import fields

import pytest
import yaml
from defusedxml import ElementTree

from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.control import ControlConfig
from husky_highlevel_controller.description import share_folder
from husky_highlevel_controller.lidar import LidarConfig
from husky_highlevel_controller.pillar import PillarConfig

SHARE = share_folder()
README = (SHARE / "README.md").read_text()


def rows():
    return {
        cells[0].strip(): cells
        for cells in (line.strip("|").split("|") for line in README.splitlines())
        if cells
    }


def named(name, default):
    """The README's table row of a parameter, with its default."""
    cells = next((cells for first, cells in rows().items() if f"`{name}`" in first), None)
    assert cells is not None, f"{name} has no row"
    assert str(default) in cells[1], f"{name}: README says {cells[1]}, the code {default}"


@pytest.mark.parametrize("file", ["controller.launch", "simulator.launch"])
def test_every_launch_argument_has_a_row(file):
    for argument in ElementTree.parse(SHARE / "launch" / file).getroot().findall("arg"):
        default = argument.get("default")
        if argument.get("name") in ("rviz", "world_name"):  # told in words
            default = ""
        named(argument.get("name"), default)


@pytest.mark.parametrize("record", [ControlConfig, PillarConfig])
def test_every_parameter_of_the_controller_has_a_row(record):
    for parameter in fields(record):
        named(f"~{parameter.name}", parameter.default)


def test_every_parameter_of_the_lidar_has_a_row():
    for parameter in fields(LidarConfig):
        named(f"~lidar/{parameter.name}", parameter.default)


def test_the_controller_s_yaml_says_what_the_code_says():
    values = yaml.safe_load((SHARE / "config" / "controller.yaml").read_text())
    control, looks = read_config(values, "controller.yaml: ", ControlConfig, PillarConfig)
    assert (control, looks) == (ControlConfig(), PillarConfig())


@pytest.mark.parametrize("node", ["simulator", "controller"])
def test_every_topic_and_service_has_a_row(node):
    source = (SHARE / "src/husky_highlevel_controller/nodes" / f"{node}.py").read_text()
    names = re.findall(r'rospy\.(?:Publisher|Subscriber|Service)\(\s*"([^"]+)"', source)
    assert names
    for name in names:
        assert f"`{name}`" in README, name
