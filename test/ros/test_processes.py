"""Nodes and launch files as processes: how they start, what they say when they cannot, how they end."""

import re
import signal
import subprocess

import pytest
import yaml
from network import PACKAGE, Ros, wait_until

from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.simulator.models.description import robot_description

SHARE = share_folder()
LAUNCH_FILES = ("controller.launch", "simulator.launch")


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """A running master, for several tests."""
    network = Ros(tmp_path_factory.mktemp("core"))
    network.start("roscore", "-p", str(network.port)).says("started core service")
    yield network
    network.end()


ARGUMENTS = [
    "world_name:=empty.world",
    "laser_enabled:=false",
    "laser_tower:=false",
    "laser_topic:=scan",
    "laser_prefix:=base",
    "kinect_enabled:=false",
    "profile:=robot",
    "ground:=soft",
    "paused:=true",
    "use_sim_time:=false",
    "headless:=true",
    "debug:=true",
    "real_time_factor:=3.5",
    "x:=1.5",
    "y:=-2",
    "yaw:=3",
    "lockstep:=false",
    "robot:=husky",
    "seed:=7",
    "web:=false",
    "web_address:=localhost",
    "web_port:=8090",
    "exit_on_arrival:=false",
    "deadline:=60",
    "rviz:=false",
]


def documented_arguments(file, ros):
    """What roslaunch says of a launch file's arguments."""
    command = ["roslaunch", "--ros-args", PACKAGE, file]
    return subprocess.run(command, env=ros.env, capture_output=True, text=True, check=True).stdout


def test_a_launch_file_starts_with_every_argument_and_documents_it(ros):
    config = share_folder() / "config"
    arguments = [*ARGUMENTS, "naive:=false", f"parameters:={config / 'controller.yaml'}"]
    arguments.append(f"simulator_parameters:={config / 'simulator.yaml'}")
    for file in LAUNCH_FILES:
        documented = documented_arguments(file, ros)
        names = set(re.findall(r"^  (\w+)", documented, re.MULTILINE))
        assert names == {argument.split(":=")[0] for argument in arguments} | {"gui"}
        assert documented.count('default "') == len(names), "every argument has a default"
        assert not re.search(r"^  \w+ .*\): *$", documented, re.MULTILINE)

    launched = ros.roslaunch("controller.launch", *arguments)  # which includes the other
    launched.says("simulating 'default' with 1 bodies, physics at 200 Hz, paused")
    assert "ERROR" not in launched.output, launched.output
    assert "has died" not in launched.output, launched.output


@pytest.mark.parametrize("file", LAUNCH_FILES)
def test_a_launch_file_needs_no_python_that_knows_the_package_and_the_environment_takes_the_lidar_away(
    file, ros
):
    environment = {**ros.env, "PATH": "/usr/bin:/bin", "HUSKY_LMS1XX_ENABLED": "0"}
    command = ["roslaunch", "--dump-params", PACKAGE, file]
    dumped = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert "/robot_description: " in dumped.stdout, dumped.stderr
    assert "base_link" in dumped.stdout
    assert "front_laser" not in yaml.safe_load(dumped.stdout)["/robot_description"]


def test_environment_start_pose_and_pace_reach_the_simulation_which_tells_the_factor_reached(ros):
    lidar = {"TOWER": "0", "TOPIC": "rear/scan", "PREFIX": "rear"}
    environment = {f"HUSKY_LMS1XX_{name}": value for name, value in lidar.items()}
    arguments = ("x:=1.5", "y:=-2.0", "yaw:=0.5", "real_time_factor:=1000")
    launched = ros.roslaunch("simulator.launch", *arguments, **environment)
    launched.says("this machine is too slow for real_time_factor 1000: reached ")
    assert b'frame_id: "rear_laser"' in ros.run("rostopic", "echo", "-n", "1", "--noarr", "/rear/scan")
    frames = ros.run("rostopic", "echo", "-n", "1", "/tf_static").decode()
    upright = frames.partition('child_frame_id: "rear_laser"')[2]
    assert [float(value) for value in re.findall(r": (\S+)", upright)[:7]] == [0.055, 0, 0.0365, 0, 0, 0, 1]
    pose = ros.run("rostopic", "echo", "-n", "1", "/ground_truth/odom/pose/pose").decode()
    x, y, _, _, _, sin_half_yaw, _ = (float(word) for word in re.findall(r"[xyzw]: (\S+)", pose))
    assert (x, y, sin_half_yaw) == pytest.approx((1.5, -2.0, 0.2474), abs=1e-3)


def test_as_fast_as_it_goes_time_waits_for_the_controller_that_was_launched(ros):
    launched = ros.roslaunch("controller.launch", "real_time_factor:=0")
    launched.says("driving to the pillar")
    (seen_at,) = re.findall(r", ([0-9.]+)\]: driving to the pillar", launched.output)
    assert float(seen_at) < 5.0  # it was ten and more, and the arrival as late


CONFIG = ("robots/husky.yaml", "simulator.yaml")


def start_simulator(core, **changes):
    """The simulator with the parameters its launch file sets, some of them changed; None leaves one out."""
    parameters = {
        "world_name": "singlePillar.world", "x": 0.0, "y": 0.0, "yaw": 0.0, "seed": 0,
        "profile": "gazebo", "ground": "hard", "real_time_factor": 1.0, "lockstep": False, "paused": False,
        "kinect_enabled": False, "laser_frame": "front_laser", **changes,
    }  # fmt: skip
    core.master("setParam", "/robot_description", robot_description())
    core.master("deleteParam", "/husky_simulator")
    files = [yaml.safe_load((SHARE / "config" / file).read_text()) for file in CONFIG]
    for key, value in [item for values in (*files, parameters) for item in values.items()]:
        if value is not None:
            core.master("setParam", f"/husky_simulator/{key}", value)
    return core.start("rosrun", PACKAGE, "husky_simulator")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": None}, "/husky_simulator/seed is missing"),
        ({"lidar/beams": "many"}, "/husky_simulator/lidar/beams = 'many' is not a int"),
        (
            {"kinect_enabled": True},
            "kinect_enabled = True, but robot_description has no 'camera_frame_optical'",
        ),
    ],
)
def test_a_node_ends_on_bad_input_and_names_it(change, words, core):
    process = start_simulator(core, **change)
    assert process.wait() == 1, process.output
    assert words in process.output
    assert "Traceback" not in process.output


@pytest.mark.parametrize("how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_a_signal_ends_everything(how, ros):
    launched = ros.roslaunch("controller.launch")
    launched.says("driving to the pillar")
    launched.popen.send_signal(how)
    wait_until(lambda: not ros.left(), "everything has ended")
    assert "escalating" not in launched.output, launched.output  # roslaunch had to ask once only
    assert "Traceback" not in launched.output, launched.output


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_node_ended_by_a_signal_exits_with_0(how, core):
    process = start_simulator(core)
    process.says("simulating")
    process.popen.send_signal(how)
    assert process.wait() == 0, process.output
    assert "Traceback" not in process.output, process.output
