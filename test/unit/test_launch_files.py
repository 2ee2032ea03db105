"""What roslaunch makes of this package's launch files."""

import pytest

pytest.importorskip("roslaunch")

import roslaunch.config

from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.robot import load_robot


@pytest.fixture
def load(monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")  # a robot may be running

    def load(file, *arguments):
        path = str(share_folder() / "launch" / file)
        return roslaunch.config.load_config_default([(path, arguments)], None, verbose=False)

    return load


@pytest.mark.parametrize("robot", ["husky", "husky_melodic", "smb"])
def test_the_guard_of_a_real_robot_hears_the_scans_that_the_controller_hears(robot, load):
    config = load("robot.launch", f"robot:={robot}", "scan_topic:=/lidar/scan", "rviz:=false")
    (guard,) = (node for node in config.nodes if node.name == "proximity_stop")
    assert dict(guard.remap_args)[load_robot(robot).topics.scan] == "/lidar/scan"
    assert config.params["/husky_highlevel_controller/scan_topic_name"].value == "/lidar/scan"


@pytest.mark.parametrize(
    ("robot", "topic"), [("husky", "front/scan"), ("husky_melodic", "scan"), ("smb", "scan")]
)
def test_the_guard_hears_the_scans_of_its_robot(robot, topic, load):
    (guard,) = load("proximity_stop.launch", f"robot:={robot}").nodes
    assert dict(guard.remap_args)[load_robot(robot).topics.scan] == topic


@pytest.mark.parametrize(("word", "value"), [("1", True), ("0", False), ("true", True)])
def test_an_argument_that_is_true_or_false_may_be_1_or_0(word, value, load):
    names = ("paused", "lockstep", "kinect_enabled", "wait_for_rviz")
    config = load("simulator.launch", "gui:=false", *(f"{name}:={word}" for name in names))
    assert [config.params[f"/husky_simulator/{name}"].value for name in names] == [value] * 4


def test_a_file_of_the_user_changes_the_profile_of_the_real_robot(load, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("robot_profile: {lidar: {range_max: 5.0}, hard: {friction: 0.3}}")
    parameters = load(
        "simulator.launch", "gui:=false", "profile:=robot", f"simulator_parameters:={file}"
    ).params
    profile = "/husky_simulator/robot_profile"
    assert parameters[f"{profile}/lidar/range_max"].value == 5.0
    assert parameters[f"{profile}/hard/friction"].value == 0.3
    assert parameters[f"{profile}/lidar/beams"].value == 541, "the others keep their defaults"


@pytest.mark.parametrize(
    ("file", "arguments"),
    [
        ("controller.launch", ("gui:=false", "web:=true", "exit_on_arrival:=true")),
        ("controller.launch", ("gui:=false", "naive:=true")),
        ("robot.launch", ("rviz:=false",)),
    ],
)
def test_a_wrong_parameter_of_an_earlier_launch_is_forgotten(file, arguments, load):
    config = load(file, *arguments)
    names = [f"/{node.name}/" for node in config.nodes if node.package == "husky_highlevel_controller"]
    assert len(names) > 1
    assert sorted(config.clear_params) == sorted(names)


@pytest.mark.parametrize("file", sorted(path.name for path in (share_folder() / "launch").glob("*.launch")))
def test_every_launch_file_loads(file, load):
    assert load(file).nodes


@pytest.mark.parametrize(
    ("folder", "place"), [("bags", "/home/ann/bags"), ("/data/my bags", "/data/my bags")]
)
def test_a_folder_of_bags_is_looked_for_where_the_user_types(folder, place, load, monkeypatch):
    monkeypatch.setenv("PWD", "/home/ann")
    (node,) = load("record_exercise_4.launch", f"folder:={folder}").nodes
    assert node.args.endswith(f"--folder '{place}'")
