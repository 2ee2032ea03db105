"""What goes wrong in a laboratory: processes die, hang and flood, and the rest goes on."""

import os
import re
import signal
import sys
from pathlib import Path

import pytest
import yaml
from network import PACKAGE, wait_until

from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros.registration import LOST

CONTROLLER = "husky_highlevel_controller"
STRESS_CLIENT = str(Path(__file__).with_name("stress_client.py"))
SOURCES_OF_ODOM = """
import rospy
from tf2_msgs.msg import TFMessage
sources = []
def on_tf(message):
    if any(each.header.frame_id == "odom" for each in message.transforms):
        sources.append(message._connection_header["callerid"])
rospy.init_node("listener", anonymous=True)
rospy.Subscriber("/tf", TFMessage, on_tf)
while len(sources) < 100:
    rospy.rostime.wallsleep(0.05)
print("sources:", *sorted(set(sources)), "end")
"""
MARKS_IN_BASE_LASER = """
import rospy
from visualization_msgs.msg import Marker
rospy.init_node("drive")
marker = Marker(ns="pillar")
marker.header.frame_id = "base_laser"
publisher = rospy.Publisher("~visualization_marker", Marker, queue_size=1, latch=True)
publisher.publish(marker)
rospy.spin()
"""


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
    assert "/husky_simulator already runs on" in second.output
    assert "ROS_MASTER_URI=http://localhost:11312 roslaunch" in second.output
    by_hand = ros.start("rosrun", PACKAGE, "husky_simulator")
    assert by_hand.wait() == 1, by_hand.output
    assert "/husky_simulator already runs on" in by_hand.output
    first.says("arrived after")
    assert "new node registered with same name" not in first.output, first.output


def test_another_publisher_of_the_clock_is_named(ros):
    ros.core()
    other = ros.start("rostopic", "pub", "-r", "1", "/clock", "rosgraph_msgs/Clock", "{}")
    wait_until(lambda: "/clock" in str(ros.master("getPublishedTopics", "")), "it publishes")
    launched = ros.roslaunch("simulator.launch")
    launched.says("also publishes /clock")
    assert "/rostopic_" in launched.output
    assert other.popen.poll() is None


def test_a_gamepad_that_never_pauses_is_named_by_the_simulator_and_by_the_controller(ros):
    launched = ros.roslaunch("controller.launch", "real_time_factor:=3")
    launched.says("drives the robot by /cmd_vel")
    ros.start("rostopic", "pub", "-r", "20", "/joy_teleop/cmd_vel", "geometry_msgs/Twist", "{}")
    launched.says("holds the robot with zero commands on joy_teleop/cmd_vel")
    launched.says("but the robot stands; /joy_teleop/cmd_vel of /rostopic_")


def test_the_first_touch_of_an_object_is_told_once(ros, tmp_path):
    file = tmp_path / "touch.yaml"
    file.write_text("stop_distance: 0.0\n")
    launched = ros.roslaunch("controller.launch", f"parameters:={file}", "real_time_factor:=0")
    launched.says("the robot touches 'unit_cylinder'")
    launched.says("arrived after")
    assert launched.output.count("the robot touches") == 1


def test_an_arrival_is_told_once_in_each_drive_of_a_node_that_does_not_say_so_itself(ros):
    launched = ros.roslaunch("controller.launch", "naive:=true", "real_time_factor:=10")
    launched.says("the robot has arrived after")
    ros.call("/husky_simulator/reset")
    wait_until(lambda: launched.output.count("the robot has arrived after") == 2, "it arrives again")


def test_an_arrival_that_the_controller_announces_is_not_told_twice(ros):
    launched = ros.roslaunch("controller.launch", "real_time_factor:=10")
    launched.says("arrived after")
    ros.start("rostopic", "echo", "-n", "100", "/front/scan/header/stamp").wait()
    assert "the robot has arrived" not in launched.output


def test_a_marker_in_a_frame_that_tf_does_not_know_is_told_with_the_one_that_is_meant(ros):
    launched = ros.roslaunch("simulator.launch", "real_time_factor:=0")
    ros.start(sys.executable, "-c", MARKS_IN_BASE_LASER)
    launched.says("in the frame 'base_laser', which TF does not have")
    doctor = (sys.executable, "-m", "husky_highlevel_controller.ros.simulator.wrong_topics")
    wait_until(lambda: "/husky_simulator has found: " in ros.run(*doctor), "./dev doctor says so, too")


def test_a_filter_in_the_launch_file_of_the_simulator_is_the_only_source_of_odom(ros, tmp_path):
    filter_parameters = "".join(
        f'<param name="{name}" value="{value}"/>'
        for name, value in {
            "two_d_mode": "true", "odom_frame": "odom", "base_link_frame": "base_link", "world_frame": "odom",
            "odom0": "husky_velocity_controller/odom",
        }.items()
    )  # fmt: skip
    row = "false,false,false, false,false,false, true,true,false, false,false,true, false,false,false"
    file = tmp_path / "filter.launch"
    file.write_text(
        '<launch><include file="$(find husky_highlevel_controller)/launch/simulator.launch">'
        '<arg name="gui" value="false"/></include>'
        '<node name="lab_filter" pkg="husky_highlevel_controller" type="planar_ekf">'
        f'{filter_parameters}<rosparam param="odom0_config">[{row}]</rosparam></node></launch>'
    )
    launched = ros.start("roslaunch", "-p", str(ros.port), str(file))
    launched.says(
        "/lab_filter publishes /odometry/filtered, so the simulator leaves it and odom -> base_link"
    )
    listener = ros.start(sys.executable, "-c", SOURCES_OF_ODOM)
    listener.says("sources: /lab_filter end")


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


def numbers(echo):
    """What `rostopic echo` of a number has printed."""
    return [float(line) for line in echo.output.splitlines() if re.fullmatch(r"-?\d[\d.e-]*", line)]


def has_error(echo, node):
    """Whether `rostopic echo /diagnostics` has printed that a node stands still."""
    # rostopic's own warnings, which begin with "[WARN]", are in the same output
    messages = "".join(line for line in echo.splitlines(keepends=True) if not line.startswith("["))
    statuses = (status for text in messages.split("---\n")[:-1] for status in yaml.safe_load(text)["status"])
    return any((each["level"], each["name"], each["message"]) == (2, node, LOST) for each in statuses)


def kill_master(ros):
    for pid in ros.pids("rosmaster"):
        os.kill(pid, signal.SIGKILL)


def test_nodes_that_a_new_master_does_not_know_stand_still_and_say_so(ros):
    core = ros.core()
    launched = ros.roslaunch("controller.launch")
    guard = ros.roslaunch("proximity_stop.launch")
    guard.says("guard active")
    speed = ros.start("rostopic", "echo", "/ground_truth/odom/twist/twist/linear/x")
    lights = ros.start("rostopic", "echo", "/diagnostics")
    launched.says("driving to the pillar")
    wait_until(lambda: max(numbers(speed), default=0.0) > 0.3, "it drives")
    lights.says("level: 0")
    kill_master(ros)
    wait_until(lambda: core.popen.poll() is not None, "its master has ended")
    end = numbers(speed)
    wait_until(lambda: len(numbers(speed)) > len(end) + 100, "it goes on")
    assert min(numbers(speed)[len(end) :]) > 0.2, "without a master the robot drives on"
    assert "standing still" not in launched.output + guard.output
    ros.core()
    wait_until(
        lambda: "standing still: the ROS master was started again" in guard.output, "the guard says so"
    )
    wait_until(
        lambda: launched.output.count("standing still: the ROS master was started again") >= 2, "both say so"
    )
    wait_until(lambda: abs(numbers(speed)[-1]) < 0.01, "it stands")
    for node in ("husky_highlevel_controller", "husky_simulator", "proximity_stop"):
        wait_until(lambda node=node: has_error(lights.output, node), f"{node} is an error in /diagnostics")


def test_a_master_that_does_not_answer_for_a_while_stops_nobody(ros):
    ros.core()
    launched = ros.roslaunch("controller.launch", "real_time_factor:=2")
    speed = ros.start("rostopic", "echo", "/ground_truth/odom/twist/twist/linear/x")
    launched.says("driving to the pillar")
    wait_until(lambda: max(numbers(speed), default=0.0) > 0.3, "it drives")
    (master,) = ros.pids("rosmaster")
    os.kill(master, signal.SIGSTOP)
    before = len(numbers(speed))
    wait_until(lambda: len(numbers(speed)) > before + 300, "three seconds have passed")
    os.kill(master, signal.SIGCONT)
    launched.says("arrived after")
    assert "standing still" not in launched.output


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
