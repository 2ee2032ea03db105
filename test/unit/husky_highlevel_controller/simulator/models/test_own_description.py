"""A user's own description of the robot counts where the physics can use it, and never goes in silence."""

import pytest

from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.models.description import main, robot_description
from husky_highlevel_controller.simulator.models.own_description import (
    VARIABLE,
    choose_description,
    robot_of,
)
from husky_highlevel_controller.simulator.models.robot_model import robot_model

HUSKY = robot_description(meshes="")
MAST = """<link name="mast"><collision><geometry><box size="0.1 0.1 1.5"/></geometry></collision>
  <inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="mast_joint" type="fixed"><parent link="base_link"/><child link="mast"/><origin xyz="-0.3 0 1"/>
  </joint></robot>"""
OWN = HUSKY.replace("</robot>", MAST)
MESH = OWN.replace('<box size="0.1 0.1 1.5"/>', '<mesh filename="package://lab/mast.dae"/>')


def choose(own, given=HUSKY, frames=("front_laser",)):
    return choose_description(own, given, [robot_description(meshes="")], load_robot(), frames)


def test_a_mast_on_the_husky_is_part_of_it():
    assert choose(OWN) == (OWN, "")
    husky, own = robot_model(HUSKY), robot_model(OWN)
    assert own.mass == pytest.approx(husky.mass + 9.0)
    assert own.fixed_poses["mast"].position == (-0.3, 0.0, 1.0)


def test_the_husky_s_own_description_gives_way_to_the_arguments_of_the_launch():
    given = robot_description(laser_tower=False)
    assert choose(HUSKY, given) == (given, "")


@pytest.mark.parametrize(
    ("own", "reason"),
    [
        ("<robot name='husky'/>", "no link 'base_link'"),
        (
            OWN.replace("front_left_wheel", "wheel_1"),
            "no joint 'front_left_wheel'; the wheels' joints are ",
        ),
        (OWN.replace('"fixed"><parent', '"revolute"><parent'), "link 'mast' is neither fixed to base_link"),
        (OWN.replace("front_laser", "lms"), "no link 'front_laser' for a sensor is fixed to base_link"),
        (OWN[:-9], "is not valid XML"),
    ],
)
def test_a_description_that_cannot_be_used_is_replaced_with_the_reason(own, reason):
    text, warning = choose(own)
    assert text == HUSKY
    fault = "your robot description has a fault, so the Husky's is simulated and shown"
    assert warning.startswith(f"{fault}: {reason}"), warning


def test_collision_meshes_are_named_because_nothing_touches_them():
    text, warning = choose(MESH)
    assert text == MESH
    assert (
        warning
        == "collision meshes in your robot description have no effect; use a box, cylinder or sphere: mast"
    )


@pytest.mark.parametrize(
    ("text", "robot"),
    [
        (OWN.replace('name="husky"', 'name="lab_rover"'), "husky"),
        (robot_description("smb", meshes=""), "smb"),
        (MAST.replace("</robot>", "").join(("<robot name='mast'>", "</robot>")), None),
    ],
)
def test_a_robot_is_known_by_its_name_or_by_its_wheels(text, robot):
    assert robot_of(text) == robot


@pytest.mark.parametrize(
    ("arguments", "own", "printed", "warning"),
    [
        ([], OWN, "mast_joint", ""),
        (["laser_prefix:=rear"], OWN, "rear_laser", "no link 'rear_laser' for a sensor"),
        (["laser_prefix:=rear", "laser_enabled:=false"], OWN, "mast_joint", ""),
        (
            ["kinect_enabled:=true"],
            OWN,
            "camera_frame_optical",
            "no link 'camera_frame_optical' for a sensor",
        ),
        (["robot:=husky_melodic", "laser_prefix:=base"], HUSKY, "base_laser", ""),
    ],
)
def test_the_command_prints_the_own_description_unless_a_sensor_would_be_without_its_place(
    arguments, own, printed, warning, monkeypatch, capsys
):
    module = "husky_highlevel_controller.xml_rpc.ask"
    monkeypatch.setattr(module, lambda *words: own if words[-1] == "/own" else None)
    monkeypatch.setenv(VARIABLE, "/own")
    monkeypatch.setattr("sys.argv", ["robot_description", *arguments])
    main()
    got = capsys.readouterr()
    assert printed in got.out
    assert warning in got.err
    assert bool(got.err) == bool(warning)
