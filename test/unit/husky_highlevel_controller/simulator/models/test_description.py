"""The robot's description in URDF: frames, meshes, arguments of its command."""

import subprocess
import sys
import xml.etree.ElementTree as ET
from math import cos, sin
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np
import pytest

from husky_highlevel_controller.simulator.models.description import (
    main,
    mesh_uri,
    robot_description,
    variables_without_effect,
)
from husky_highlevel_controller.simulator.models.robot_model import robot_model

ON_BASE = ["base_footprint", "inertial_link", "imu_link"]
ON_BASE += ["top_chassis_link", "user_rail_link", "top_plate_link"]
ON_BASE += [f"{end}_{side}_wheel_link" for end in ("front", "rear") for side in ("left", "right")]
ON_BASE += [f"{end}_bumper_link" for end in ("front", "rear")]
ON_PLATE = ["top_plate_front_link", "top_plate_rear_link", "front_laser_mount"]
TREE = {**dict.fromkeys(ON_BASE, "base_link"), **dict.fromkeys(ON_PLATE, "top_plate_link")}
TREE["front_laser"] = "front_laser_mount"
HUSKY = robot_description()


def test_the_tree_of_frames_is_the_noetic_huskys_and_its_root_weighs_nothing():
    robot = ET.fromstring(HUSKY)
    parents = {j.find("child").get("link"): j.find("parent").get("link") for j in robot.findall("joint")}
    assert parents == TREE
    assert {link.get("name") for link in robot.findall("link")} == {"base_link", *TREE}
    assert robot.find("link[@name='base_link']/inertial") is None, "which KDL would ignore"


@pytest.mark.parametrize(
    ("arguments", "mass", "frames"),
    [
        ({"laser_enabled": False}, 56.582, []),
        ({"laser_prefix": "rear"}, 57.682, ["rear_laser_mount", "rear_laser"]),
    ],
)
def test_the_lidar_can_be_left_out_and_its_frames_be_renamed(arguments, mass, frames):
    model = robot_model(robot_description(**arguments))
    assert model.mass == pytest.approx(mass)
    assert [frame for frame in model.fixed_poses if "laser" in frame] == frames


def test_every_mesh_is_a_file_that_exists():
    files = [Path(unquote(urlparse(mesh.get("filename")).path)) for mesh in ET.fromstring(HUSKY).iter("mesh")]
    assert len(files) == 9
    assert all(file.is_file() for file in files)


def test_the_wheels_one_sees_touch_the_ground():
    mesh = ET.fromstring(HUSKY).find("link[@name='front_left_wheel_link']/visual/geometry/mesh")
    data = Path(unquote(urlparse(mesh.get("filename")).path)).read_bytes()
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(data[84:], triangle)["corners"].reshape(-1, 3)
    scale = np.array(mesh.get("scale").split(), dtype=float)
    assert np.abs(corners * scale).max(axis=0) == pytest.approx((0.1651, 0.0572, 0.1651), abs=2e-4)


def test_the_meshes_are_looked_for_without_loading_pybullets_data_package():
    program = (
        "import sys; from husky_highlevel_controller.simulator.models import description as x;"
        "x.mesh_uri(); sys.exit('pybullet' in sys.modules or 'pybullet_data' in sys.modules)"
    )
    source = Path(__file__).resolve().parents[5] / "src"
    assert subprocess.run([sys.executable, "-c", program], env={"PYTHONPATH": str(source)}).returncode == 0


def test_where_pybullet_is_not_installed_there_are_no_meshes(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert mesh_uri() == ""


@pytest.fixture
def command(monkeypatch, capsys):
    """Calls robot_description with arguments; what it printed and wrote to stderr."""

    def call(*arguments):
        monkeypatch.setattr("sys.argv", ["robot_description", *arguments])
        main()
        return capsys.readouterr()

    return call


@pytest.mark.parametrize("no", ["false", "False", "0"])
def test_the_command_prints_the_urdf_by_switches_as_of_roslaunch_or_of_the_environment(no, command):
    printed = command(f"laser_tower:={no}", "meshes:=")
    assert printed.err == ""
    assert printed.out.strip() == robot_description(laser_tower=False, meshes="").strip()


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        (
            "laser:=true",
            "unknown argument 'laser'; there are robot:=husky|smb|husky_melodic laser_enabled:=true|false",
        ),
        ("laser_enabled=true", "unknown argument 'laser_enabled=true'"),
        ("laser_enabled:=yes", "laser_enabled is 'yes'; use true|false"),
        ("laser_tower:=", "laser_tower is ''; use true|false"),
        ("laser_prefix:=", "laser_prefix is ''; use a name, e.g. front"),
        ("laser_prefix:=$(find x)", "laser_prefix is '$(find x)'; use a name, e.g. front"),
        ("laser_prefix:=${1/0}", "laser_prefix is '${1/0}'; use a name"),
        ("meshes:=meshes/husky", "meshes is 'meshes/husky'; use a URI"),
        ("meshes:=file:///$(find x)", "meshes is 'file:///$(find x)'; use a URI"),
    ],
)
def test_a_wrong_argument_is_refused_with_a_hint(argument, words, command, capsys):
    with pytest.raises(SystemExit) as stop:
        command(argument)
    printed = capsys.readouterr()
    assert stop.value.code == 2
    assert printed.out == ""
    assert words in printed.err


def test_the_variables_of_the_husky_s_launch_files_move_the_lidar(monkeypatch, command, capsys):
    monkeypatch.setenv("HUSKY_LMS1XX_XYZ", "0.3 0.1 0.2")
    monkeypatch.setenv("HUSKY_LMS1XX_RPY", "0 0 0.5")
    moved = robot_model(command().out).fixed_poses["front_laser_mount"]
    usual = robot_model(HUSKY).fixed_poses["front_laser_mount"]
    assert np.subtract(moved.position, usual.position) == pytest.approx((0.0794, 0.1, 0.19365))
    assert moved.quat_xyzw == pytest.approx((0.0, 0.0, sin(0.25), cos(0.25)))
    monkeypatch.setenv("HUSKY_LMS1XX_XYZ", "0.3 0.1")
    with pytest.raises(SystemExit):
        command()
    assert "HUSKY_LMS1XX_XYZ" in capsys.readouterr().err


def test_variables_of_equipment_that_is_not_simulated_are_named():
    environment = {
        "HUSKY_LMS1XX_ENABLED": "1", "HUSKY_LMS1XX_XYZ": "0 0 0", "HUSKY_UST10_ENABLED": "1",
        "HUSKY_REALSENSE_ENABLED": "0", "HUSKY_LMS1XX_SECONDARY_ENABLED": "true", "HUSKY_PORT": "/dev/tty",
        "HOME": "/root",
    }  # fmt: skip
    named = variables_without_effect(environment)
    assert named == ["HUSKY_LMS1XX_SECONDARY_ENABLED=true", "HUSKY_UST10_ENABLED=1"]
