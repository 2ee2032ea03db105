"""Nodes and launch files as processes: how they start, what they say when they cannot, how they end."""

import os
import re
import signal
import subprocess

import pytest
import yaml
from network import PACKAGE, wait_until

from husky_highlevel_controller.paths import share_folder

LAUNCH_FILES = ("controller.launch", "simulator.launch")


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
    "z:=0",
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
    "wait_for_rviz:=true",
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


@pytest.mark.parametrize("factor", [5, 0])
def test_a_robot_without_a_lidar_advertises_no_scan_and_the_controller_says_why_it_waits(factor, ros):
    launched = ros.roslaunch("controller.launch", f"real_time_factor:={factor}", HUSKY_LMS1XX_ENABLED="0")
    launched.says("no node publishes /front/scan: start the simulator with laser_enabled:=true")
    topics = dict(ros.master("getPublishedTopics", ""))
    assert "/odometry/filtered" in topics
    assert "/front/scan" not in topics
    assert "no node publishes /front/scan" in ros.echo("/diagnostics/status")


def test_environment_start_pose_and_pace_reach_the_simulation_which_tells_the_factor_reached(ros):
    lidar = {"TOWER": "0", "TOPIC": "rear/scan", "PREFIX": "rear"}
    environment = {f"HUSKY_LMS1XX_{name}": value for name, value in lidar.items()}
    arguments = ("x:=1.5", "y:=-2.0", "yaw:=0.5", "real_time_factor:=1000")
    launched = ros.roslaunch("simulator.launch", *arguments, **environment)
    launched.says("this machine is too slow for real_time_factor 1000: reached ")
    assert 'frame_id: "rear_laser"' in ros.echo("/rear/scan", "--noarr")
    frames = ros.echo("/tf_static")
    upright = frames.partition('child_frame_id: "rear_laser"')[2]
    assert [float(value) for value in re.findall(r": (\S+)", upright)[:7]] == [0.055, 0, 0.0365, 0, 0, 0, 1]
    pose = ros.echo("/ground_truth/odom/pose/pose")
    x, y, _, _, _, sin_half_yaw, _ = (float(word) for word in re.findall(r"[xyzw]: (\S+)", pose))
    assert (x, y, sin_half_yaw) == pytest.approx((1.5, -2.0, 0.2474), abs=1e-3)
    end_simulator(ros, launched, signal.SIGINT)


def test_as_fast_as_it_goes_time_waits_for_the_controller_that_was_launched(ros):
    launched = ros.roslaunch("controller.launch", "real_time_factor:=0")
    launched.says("driving to the pillar")
    (seen_at,) = re.findall(r", ([0-9.]+)\]: driving to the pillar", launched.output)
    assert float(seen_at) < 5.0  # it was ten and more, and the arrival as late
    end_simulator(ros, launched, signal.SIGTERM)


def end_simulator(ros, launched, how):
    """End the simulator by a signal; it exits with 0, and its launch with it."""
    (pid,) = ros.pids("husky_simulator")
    os.kill(pid, how)
    launched.says("process has finished cleanly")
    assert "Traceback" not in launched.output, launched.output


@pytest.mark.parametrize("how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_a_signal_ends_everything(how, ros):
    launched = ros.roslaunch("controller.launch")
    launched.says("driving to the pillar")
    launched.popen.send_signal(how)
    wait_until(lambda: not ros.left(), "everything has ended")
    assert "escalating" not in launched.output, launched.output  # roslaunch had to ask once only
    assert "Traceback" not in launched.output, launched.output
