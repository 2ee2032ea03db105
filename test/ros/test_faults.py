"""What goes wrong in a laboratory: processes die, hang and flood, and the rest goes on."""

import os
import re
import signal
import sys
from pathlib import Path

import pytest
from network import PACKAGE, wait_until

from husky_highlevel_controller.paths import share_folder

CONTROLLER = "husky_highlevel_controller"
STRESS_CLIENT = str(Path(__file__).with_name("stress_client.py"))


def start_simulator(ros, *arguments):
    launched = ros.roslaunch("simulator.launch", *arguments)
    launched.says("simulating")
    return launched


def start_controller(ros):
    config = f"{share_folder()}/config/controller.yaml"
    assert ros.start("rosparam", "load", config, f"/{CONTROLLER}").wait() == 0
    for name, value in (("scan_topic_name", "/front/scan"), ("scan_topic_queue_size", 1)):
        ros.master("setParam", f"/{CONTROLLER}/{name}", value)
    return ros.start("rosrun", PACKAGE, "husky_controller")


def truth(ros, field):
    """A number of the robot's true odometry now."""
    return float(ros.echo(f"/ground_truth/odom/{field}"))


def seconds_of(ros):
    """Simulated time [s]."""
    return truth(ros, "header/stamp/secs")


def speed_of(ros):
    """True forward speed [m/s]."""
    return truth(ros, "twist/twist/linear/x")


def test_a_controller_that_dies_leaves_a_robot_that_brakes_and_a_new_one_drives_on(ros):
    start_simulator(ros, "real_time_factor:=3")
    first = start_controller(ros)
    first.says("driving to the pillar")
    wait_until(lambda: truth(ros, "pose/pose/position/x") > 1.0, "it drives")
    for pid in ros.pids("husky_controller"):
        os.kill(pid, signal.SIGKILL)
    wait_until(lambda: abs(speed_of(ros)) < 0.01, "it stands")
    second = start_controller(ros)
    second.says("arrived after")


def test_a_simulator_that_is_killed_and_started_again_finds_the_same_controller_driving(ros):
    ros.core()
    launched = start_simulator(ros, "real_time_factor:=3")
    controller = start_controller(ros)
    controller.says("driving to the pillar")
    wait_until(lambda: seconds_of(ros) > 5, "it is on its way")
    for pid in ros.pids("husky_simulator"):
        os.kill(pid, signal.SIGKILL)
    wait_until(lambda: launched.popen.poll() is not None, "its launch has ended")
    start_simulator(ros, "real_time_factor:=3", "y:=2.0")  # where time begins at 0 again
    controller.says("arrived after")
    assert controller.popen.poll() is None, "the controller lives on"
    assert "Traceback" not in controller.output, controller.output


def test_a_second_simulator_is_refused_and_the_first_drives_on(ros):
    first = ros.roslaunch("controller.launch", "real_time_factor:=3")
    first.says("driving to the pillar")
    second = ros.roslaunch("simulator.launch")
    assert second.wait() != 0, second.output
    assert "/husky_simulator simulates already on" in second.output
    assert "ROS_MASTER_URI=http://localhost:11312 roslaunch" in second.output
    by_hand = ros.start("rosrun", PACKAGE, "husky_simulator")
    assert by_hand.wait() == 1, by_hand.output
    assert "/husky_simulator simulates already on" in by_hand.output
    first.says("arrived after")
    assert "new node registered with same name" not in first.output, first.output


def test_another_publisher_of_the_clock_is_named(ros):
    ros.core()
    other = ros.start("rostopic", "pub", "-r", "1", "/clock", "rosgraph_msgs/Clock", "{}")
    wait_until(lambda: "/clock" in str(ros.master("getPublishedTopics", "")), "it publishes")
    launched = ros.roslaunch("simulator.launch")
    launched.says("publishes /clock too")
    assert "/rostopic_" in launched.output
    assert other.popen.poll() is None


def test_a_subscriber_that_hangs_does_not_hold_the_world(ros):
    start_simulator(ros, "real_time_factor:=0")
    hanging = ros.start("rostopic", "echo", "/front/scan/header/stamp")
    hanging.says("nsecs")
    os.kill(hanging.popen.pid, signal.SIGSTOP)
    later = seconds_of(ros) + 60
    wait_until(lambda: seconds_of(ros) > later, "a minute has passed")
    os.kill(hanging.popen.pid, signal.SIGCONT)

    def stamps():
        return [int(seconds) for seconds in re.findall(r"secs: +(\d+)\nnsecs", hanging.output)]

    wait_until(lambda: stamps()[-1] > later, "it hears the scans again, those of now and in order")
    heard = stamps()
    assert heard == sorted(heard)


def test_a_thousand_commands_a_second_are_obeyed_as_one(ros):
    start_simulator(ros)
    flood = ("rostopic", "pub", "-r", "1000", "/cmd_vel", "geometry_msgs/Twist", "{linear: {x: 0.5}}")
    sender = ros.start(*flood)
    wait_until(lambda: abs(speed_of(ros) - 0.5) < 0.01, "it drives as told")
    sender.popen.terminate()
    wait_until(lambda: abs(speed_of(ros)) < 0.01, "nothing is left to obey")


@pytest.mark.parametrize("seconds", [60, pytest.param(3600, marks=pytest.mark.slow)])
def test_an_hour_of_driving_misses_no_scan_and_takes_no_memory(seconds, ros):
    start_simulator(ros, "real_time_factor:=0", "lockstep:=true", "world_name:=empty.world")
    (pid,) = ros.pids("husky_simulator")
    client = ros.start(sys.executable, STRESS_CLIENT, str(seconds), str(pid))
    assert client.wait(3600.0) == 0, client.output  # it has a deadline of its own
    report = client.output.splitlines()[-1]  # rospy may warn before it
    count, growth, *gaps = (float(word) for word in report.split())
    assert count >= seconds * 50
    assert gaps == [20.0], "ms, and no other gap"
    assert growth < 2000
