"""The robot that a hand-in is for is told from what it starts and names; its pillar is the sheets'."""

from dataclasses import replace

import pytest

from husky_highlevel_controller.course import PILLARS
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.grading.drive import ros_graph
from husky_highlevel_controller.grading.drive.ros_graph import robot_listened_to
from husky_highlevel_controller.grading.drive.trials import Trial, trial_world
from husky_highlevel_controller.grading.hand_in.package_files import named_bag, named_robot
from husky_highlevel_controller.grading.hand_in.plan import Plan
from husky_highlevel_controller.grading.records import ROBOT_VERSIONS, MarkingConfig
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.simulator.models.sdf_world import parse_world


@pytest.mark.parametrize(
    ("name", "text", "word"),
    [
        ("a.launch", '<include file="$(find smb_gazebo)/launch/smb_gazebo.launch"/>', "smb_gazebo"),
        ("a.cpp", 'lookupTransform("odom", "rslidar", ros::Time(0))', "rslidar"),
        ("node", '"/imu0"', "/imu0"),
        ("view.rviz", "Topic: /rslidar_points", "/rslidar_points"),
    ],
)
def test_what_a_package_names_tells_the_smb(name, text, word, tmp_path):
    (tmp_path / name).write_text(text)
    robot, why = named_robot(Plan(nodes=("p/n",), package_path=tmp_path))
    assert robot == "smb"
    assert why == f"the simulated robot is the SMB: {name} names {word}"


@pytest.mark.parametrize(("folder", "robot"), [("smb_control", "smb"), ("husky_control", "husky")])
def test_the_filter_s_parameters_tell_the_robot_of_exercise_4(folder, robot, tmp_path):
    (tmp_path / "ekf.launch").write_text(f"$(find {folder})/config/localization.yaml smb_top_view")
    (tmp_path / "view.rviz").write_text("Topic: /rslidar_points")  # in both robots' bags
    assert named_bag(Plan(package_path=tmp_path))[0] == robot


def test_a_node_of_the_smb_that_is_left_out_tells_it_too():
    robot, why = named_robot(Plan(nodes=("p/n",), left_out=("smb_gazebo/spawn",)))
    assert (robot, "the SMB" in why) == ("smb", True)


@pytest.mark.parametrize(
    ("text", "robot", "why"),
    [
        ("Topic: /scan", "husky_melodic", "view.rviz names /scan"),
        ("Topic: /front/scan", "husky", "view.rviz names front/scan"),
        ("Topic: ''", "husky", "it names no topic of scans"),
    ],
)
def test_the_names_in_its_files_give_a_first_guess(text, robot, why, tmp_path):
    (tmp_path / "view.rviz").write_text(text)
    guess, words = named_robot(Plan(package_path=tmp_path))
    assert guess == robot
    assert words.endswith(f": {why}")


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


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_world_has_the_pillar_of_the_robot_s_sheets(robot):
    trial = Trial(1, Pose2D(), (10.0, 1.0), 0)
    (pillar,) = (b for b in parse_world(trial_world(trial, robot), "w").bodies if b.name == "unit_cylinder")
    shape = pillar.collisions[0].shape
    assert (shape.radius, shape.length) == PILLARS[robot]


def test_every_version_is_one_of_the_robots():
    assert {version.partition("_")[0] for version in ROBOT_VERSIONS} == set(ROBOTS)
