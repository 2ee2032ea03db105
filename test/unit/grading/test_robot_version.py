"""The robot that a hand-in is for is told from what it starts and names; its pillar is the sheets'."""

from dataclasses import replace

import numpy as np
import pytest

from husky_highlevel_controller.course import PILLARS
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.grading.drive.plan import Plan, Submission
from husky_highlevel_controller.grading.drive.recording import empty_recording, from_json, hull_gaps, to_json
from husky_highlevel_controller.grading.drive.robot_version import detect_robot
from husky_highlevel_controller.grading.drive.trials import Trial, trial_world
from husky_highlevel_controller.grading.records import ROBOT_VERSIONS, Launchable
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.simulator.models.sdf_world import parse_world

NODE = Submission(Launchable("node", "p", "n"))


@pytest.mark.parametrize(
    ("name", "text", "word"),
    [
        ("a.launch", '<include file="$(find smb_gazebo)/launch/smb_gazebo.launch"/>', "smb_gazebo"),
        ("a.cpp", 'lookupTransform("odom", "rslidar", ros::Time(0))', "rslidar"),
        ("node", '"/imu0"', "/imu0"),
    ],
)
def test_what_a_package_names_tells_the_smb(name, text, word, tmp_path):
    (tmp_path / name).write_text(text)
    robot, _, why = detect_robot(NODE, Plan(nodes=("p/n",), package_path=tmp_path), tmp_path)
    assert robot == "smb"
    assert why == f"the simulated robot is the SMB: {name} names {word}"


def test_a_node_of_the_smb_that_is_left_out_tells_it_too(tmp_path):
    robot, _, why = detect_robot(NODE, Plan(nodes=("p/n",), left_out=("smb_gazebo/spawn",)), tmp_path)
    assert (robot, "the SMB" in why) == ("smb", True)


@pytest.mark.parametrize(
    ("text", "robot", "why"),
    [
        ("Topic: /scan", "husky_melodic", "view.rviz names /scan"),
        ("Topic: /front/scan", "husky", "view.rviz names front/scan"),
        ("Topic: /rslidar_points", "smb", "view.rviz names /rslidar_points"),
        ("Topic: ''", "husky", "it names no topic of scans"),
    ],
)
def test_where_nothing_starts_the_names_in_its_files_tell_the_robot(text, robot, why, tmp_path):
    (tmp_path / "view.rviz").write_text(text)
    told, scans, words = detect_robot(NODE, Plan(package_path=tmp_path), tmp_path)
    assert (told, scans) == (robot, "")
    assert words.endswith(f": {why}")


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_world_has_the_pillar_of_the_robot_s_sheets(robot):
    trial = Trial(1, Pose2D(), (10.0, 1.0), 0)
    (pillar,) = (b for b in parse_world(trial_world(trial, robot), "w").bodies if b.name == "unit_cylinder")
    shape = pillar.collisions[0].shape
    assert (shape.radius, shape.length) == PILLARS[robot]


def test_gaps_are_of_the_robot_that_drove():
    pose = np.array([[0.0, 0.0, 0.0]])
    assert hull_gaps(pose, (10.0, 0.0), "husky")[0] == pytest.approx(10.0 - 0.4937 - 0.2)
    assert hull_gaps(pose, (10.0, 0.0), "smb")[0] == pytest.approx(np.hypot(10.0 - 0.4059, 0.235) - 1.0)
    kept = replace(empty_recording((10.0, 0.0), 60.0, ()), robot="smb")
    assert from_json(to_json(kept)).pillar_size == PILLARS["smb"]


def test_every_version_is_one_of_the_robots():
    assert {version.partition("_")[0] for version in ROBOT_VERSIONS} == set(ROBOTS)
