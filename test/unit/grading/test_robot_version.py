"""The robot that a hand-in is for is told from what it starts and names; its pillar is the sheets'."""

from dataclasses import replace

import pytest

from husky_highlevel_controller.grading.drive import ros_graph
from husky_highlevel_controller.grading.drive.ros_graph import robot_listened_to
from husky_highlevel_controller.grading.hand_in.package_files import named_bag, named_robot
from husky_highlevel_controller.grading.records import MarkingConfig
from husky_highlevel_controller.grading.submission import Plan


@pytest.mark.parametrize(
    ("name", "text", "robot", "why"),
    [
        ("a.launch", '<include file="$(find smb_gazebo)/launch/smb_gazebo.launch"/>', "smb", "smb_gazebo"),
        ("a.cpp", 'lookupTransform("odom", "rslidar", ros::Time(0))', "smb", "rslidar"),
        ("node", '"/imu0"', "smb", "/imu0"),
        ("view.rviz", "Topic: /rslidar_points", "smb", "/rslidar_points"),
        ("view.rviz", "Topic: /scan", "husky_melodic", "/scan"),
        ("view.rviz", "Topic: /front/scan", "husky", "front/scan"),
        ("it", "Topic: ''", "husky", "no topic of scans"),
    ],
)
def test_what_a_package_names_is_a_first_guess_at_its_robot(name, text, robot, why, tmp_path):
    (tmp_path / name).write_text(text)
    guess, words = named_robot(Plan(nodes=("p/n",), package_path=tmp_path))
    assert guess == robot
    assert words.endswith(f": {name} names {why}")
    assert named_robot(Plan(nodes=("p/n",), left_out=("smb_gazebo/spawn",)))[0] == "smb"


@pytest.mark.parametrize(("folder", "robot"), [("smb_control", "smb"), ("husky_control", "husky")])
def test_the_filter_s_parameters_tell_the_robot_of_exercise_4(folder, robot, tmp_path):
    (tmp_path / "ekf.launch").write_text(f"$(find {folder})/config/localization.yaml smb_top_view")
    (tmp_path / "view.rviz").write_text("Topic: /rslidar_points")  # in both robots' bags
    assert named_bag(Plan(package_path=tmp_path))[0] == robot


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
