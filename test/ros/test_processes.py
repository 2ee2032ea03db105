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


# ---------------------------------------------------------------------------- starting


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


@pytest.mark.parametrize("file", LAUNCH_FILES)
def test_a_launch_file_starts_with_every_argument_and_documents_it(file, ros):
    documented = subprocess.run(
        ["roslaunch", "--ros-args", PACKAGE, file], env=ros.env, capture_output=True, text=True, check=True
    ).stdout
    names = set(re.findall(r"^  (\w+)", documented, re.MULTILINE))
    config = share_folder() / "config"
    arguments = [*ARGUMENTS, "naive:=false", f"parameters:={config / 'controller.yaml'}"]
    arguments.append(f"simulator_parameters:={config / 'simulator.yaml'}")
    assert names == {argument.split(":=")[0] for argument in arguments} | {"gui"}
    assert documented.count('default "') == len(names), "every argument has a default"
    assert not re.search(r"^  \w+ .*\): *$", documented, re.MULTILINE)

    launched = ros.roslaunch(file, *arguments)
    launched.says("simulating 'default' with 1 bodies, physics at 200 Hz, paused")
    assert "ERROR" not in launched.output, launched.output
    assert "has died" not in launched.output, launched.output


@pytest.mark.parametrize("file", LAUNCH_FILES)
def test_a_launch_file_needs_no_python_on_the_path_that_knows_the_package(file, ros):
    environment = {**ros.env, "PATH": "/usr/bin:/bin"}
    command = ["roslaunch", "--dump-params", PACKAGE, file]
    dumped = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert "/robot_description: " in dumped.stdout, dumped.stderr


def test_the_environment_of_the_husky_s_own_launch_files_places_the_lidar(ros):
    lidar = {"TOWER": "0", "TOPIC": "rear/scan", "PREFIX": "rear"}
    environment = {f"HUSKY_LMS1XX_{name}": value for name, value in lidar.items()}
    ros.roslaunch("simulator.launch", **environment).says("simulating")
    echo = ros.start("rostopic", "echo", "-n", "1", "--noarr", "/rear/scan")
    assert echo.wait() == 0
    assert 'frame_id: "rear_laser"' in echo.output
    frames = ros.start("rostopic", "echo", "-n", "1", "/tf_static")
    assert frames.wait() == 0
    upright = frames.output.partition('child_frame_id: "rear_laser"')[2]
    assert [float(value) for value in re.findall(r": (\S+)", upright)[:7]] == [0.055, 0, 0.0365, 0, 0, 0, 1]


def test_the_environment_can_take_the_lidar_away(ros):
    launched = ros.roslaunch("simulator.launch", HUSKY_LMS1XX_ENABLED="0")
    launched.says("simulating")
    assert "rear_laser" not in ros.master("getParam", "/robot_description")
    assert "front_laser" not in ros.master("getParam", "/robot_description")


def test_as_fast_as_it_goes_time_waits_for_the_controller_that_was_launched(ros):
    launched = ros.roslaunch("controller.launch", "real_time_factor:=0")
    launched.says("driving to the pillar")
    (seen_at,) = re.findall(r", ([0-9.]+)\]: driving to the pillar", launched.output)
    assert float(seen_at) < 5.0  # it was ten and more, and the arrival as late


def test_start_pose_and_seed_reach_the_simulation(ros):
    launched = ros.roslaunch("simulator.launch", "x:=1.5", "y:=-2.0", "yaw:=0.5", "real_time_factor:=0")
    launched.says("simulating")
    echo = ros.start("rostopic", "echo", "-n", "1", "/ground_truth/odom/pose/pose")
    assert echo.wait() == 0
    x, y, _, _, _, sin_half_yaw, _ = (float(word) for word in re.findall(r"[xyzw]: (\S+)", echo.output))
    assert (x, y, sin_half_yaw) == (
        pytest.approx(1.5, abs=1e-3),
        pytest.approx(-2.0, abs=1e-3),
        pytest.approx(0.2474, abs=1e-3),
    )


def test_a_machine_too_slow_is_told_the_factor_reached(ros):
    launched = ros.roslaunch("simulator.launch", "real_time_factor:=1000")
    launched.says("this machine is too slow for real_time_factor 1000: reached ")


# ---------------------------------------------------------------------------- bad input


def start_node(core, executable, name, config, parameters):
    """A node with the parameters its launch file sets, some of them changed; None leaves one out."""
    core.master("deleteParam", name)
    files = [yaml.safe_load((SHARE / file).read_text()) for file in config.split()]
    for key, value in [item for values in (*files, parameters) for item in values.items()]:
        if value is not None:
            core.master("setParam", f"{name}/{key}", value)
    return core.start("rosrun", PACKAGE, executable)


def start_simulator(core, **changes):
    parameters = {
        "world_name": "singlePillar.world", "x": 0.0, "y": 0.0, "yaw": 0.0, "seed": 0,
        "profile": "gazebo", "ground": "hard", "real_time_factor": 1.0, "lockstep": False, "paused": False,
        "kinect_enabled": False, "laser_frame": "front_laser", **changes,
    }  # fmt: skip
    core.master("setParam", "/robot_description", parameters.pop("/robot_description", robot_description()))
    return start_node(
        core,
        "husky_simulator",
        "/husky_simulator",
        "config/robots/husky.yaml config/simulator.yaml",
        parameters,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("world_name", "nowhere.world"), "no world 'nowhere.world'; there are "),
        (("seed", None), "/husky_simulator/seed is missing"),
        (("real_time_factor", -1.0), "/husky_simulator/real_time_factor = -1.0 is out of range 0.0..1000.0"),
        (("physics_rate", 210), "50 Hz does not divide physics_rate = 210 Hz"),
        (("lidar/beams", "many"), "/husky_simulator/lidar/beams = 'many' is not a int"),
        (("colour", "red"), "/husky_simulator/colour is not a parameter; there are: "),
        (
            ("kinect_enabled", True),
            "kinect_enabled = True, but robot_description has no 'camera_frame_optical'",
        ),
        (("/robot_description", "<robot/>"), "no link 'base_link'"),
    ],
)
def test_the_simulator_ends_on_bad_input_and_names_it(change, words, core):
    process = start_simulator(core, **dict([change]))
    assert process.wait() == 1, process.output
    assert words in process.output
    assert "Traceback" not in process.output


def test_a_broken_world_is_named_with_line_and_value(core, tmp_path):
    world = tmp_path / "broken.world"
    world.write_text(
        """<sdf version="1.6"><world name="w"><model name="pillar"><link name="link"><collision name="c">
        <geometry><cylinder><radius>-0.2</radius><length>2</length></cylinder></geometry>
        </collision></link></model></world></sdf>"""
    )
    process = start_simulator(core, world_name=str(world))
    assert process.wait() == 1, process.output
    assert f"{world}:2: model 'pillar'" in process.output
    assert "'-0.2'" in process.output


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("p_gain_vel", -1.0), "/husky_highlevel_controller/p_gain_vel = -1.0 is out of range"),
        (("stop_distance", "near"), "/husky_highlevel_controller/stop_distance = 'near' is not a float"),
        (("scan_topic_name", None), "/husky_highlevel_controller/scan_topic_name is missing"),
        (("p_gain", 1.0), "/husky_highlevel_controller/p_gain is not a parameter"),
    ],
)
def test_the_controller_ends_on_a_bad_parameter_and_names_it(change, words, core):
    parameters = dict([("scan_topic_name", "/front/scan"), ("scan_topic_queue_size", 1), change])
    process = start_node(
        core, "husky_controller", "/husky_highlevel_controller", "config/controller.yaml", parameters
    )
    assert process.wait() == 1, process.output
    assert words in process.output


# ---------------------------------------------------------------------------- ending


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
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
