"""The launch files of the courses, written for Gazebo, run unchanged with `./dev launch PATH`."""

import os
import re
import sys

import pytest

from husky_highlevel_controller.paths import share_folder

COMMAND = (sys.executable, str(share_folder() / "tools" / "launch.py"))
PILLAR = """<sdf version="1.4"><world name="default">
  <include><uri>model://sun</uri></include><include><uri>model://ground_plane</uri></include>
  <model name="unit_cylinder"><pose>20 5 0.5 0 0 0</pose><link name="link"><collision name="collision">
  <geometry><cylinder><radius>0.2</radius><length>2</length></cylinder></geometry></collision></link></model>
</world></sdf>"""
SHEET = """<launch>
  <arg name="laser_enabled" default="true"/>
  <arg name="pillar_world" default="$(find husky_highlevel_controller)/worlds/singlePillar.world"/>
  <include file="$(find gazebo_ros)/launch/empty_world.launch">
    <arg name="world_name" value="$(arg pillar_world)"/>
    <arg name="paused" value="false"/>
    <arg name="use_sim_time" value="true"/>
    <arg name="gui" value="true"/>
    <arg name="headless" value="false"/>
    <arg name="debug" value="false"/>
  </include>
  <include file="$(find husky_gazebo)/launch/spawn_husky.launch">
    <arg name="laser_enabled" value="$(arg laser_enabled)"/>
  </include>
  <node name="controller" pkg="husky_highlevel_controller" type="controller" output="screen"
        launch-prefix="xterm -e">
    <rosparam command="load" file="$(find husky_highlevel_controller)/config/default.yaml"/>
  </node>
</launch>"""
OLDER = """<launch>
  <include file="$(find husky_gazebo)/launch/husky_empty_world.launch">
    <arg name="world_name" value="worlds/robocup14_spl_field.world"/>
    <arg name="laser_enabled" value="true"/>
  </include>
</launch>"""
CONTROLLER = """#!/usr/bin/env python3
import rospy
from sensor_msgs.msg import LaserScan
rospy.init_node("controller")
scan = rospy.wait_for_message(rospy.get_param("~scan_topic_name"), LaserScan)
print("their package:", rospy.get_param("~greeting"), "in", scan.header.frame_id, flush=True)
"""


@pytest.fixture
def theirs(tmp_path):
    """A student's package, which has the name of ours, as the course's sheet says."""
    package = tmp_path / "catkin_ws" / "src" / "husky_highlevel_controller"
    for folder in ("launch", "worlds", "config", "scripts"):
        (package / folder).mkdir(parents=True)
    (package / "package.xml").write_text(
        '<package format="2"><name>husky_highlevel_controller</name><version>0.0.1</version><description>x'
        '</description><maintainer email="a@b.c">a</maintainer><license>BSD</license></package>'
    )
    (package / "worlds" / "singlePillar.world").write_text(PILLAR)
    (package / "config" / "default.yaml").write_text("scan_topic_name: /front/scan\ngreeting: hello\n")
    (package / "scripts" / "controller").write_text(CONTROLLER)
    os.chmod(package / "scripts" / "controller", 0o755)
    (package / "launch" / "sheet.launch").write_text(SHEET)
    (package / "launch" / "older.launch").write_text(OLDER)
    return package


def launch(ros, file, *arguments, **env):
    return ros.start(*COMMAND, str(file), "-p", str(ros.port), *arguments, **env)


def test_the_sheet_s_file_drives_their_controller_in_their_world(theirs, ros):
    launched = launch(ros, theirs / "launch" / "sheet.launch")
    launched.says("their package: hello in front_laser")
    assert "simulating 'default' with 2 bodies" in launched.output, launched.output
    assert "starts without launch-prefix 'xterm -e'" in launched.output
    assert "ERROR" not in launched.output, launched.output
    assert ros.master("getParam", "/use_sim_time") is True
    assert "front_laser" in ros.master("getParam", "/robot_description")


def test_the_older_launch_file_shows_the_football_field(theirs, ros):
    launched = launch(ros, theirs / "launch" / "older.launch")
    launched.says("simulating")
    assert ros.master("getParam", "/husky_simulator/world_name") == "worlds/robocup14_spl_field.world"


def test_the_environment_of_the_husky_s_launch_files_counts_here_too(theirs, ros):
    file = theirs / "launch" / "bare.launch"
    file.write_text('<launch><include file="$(find husky_gazebo)/launch/empty_world.launch"/></launch>')
    launched = launch(ros, file, HUSKY_LMS1XX_TOPIC="rear/scan", HUSKY_LMS1XX_PREFIX="rear")
    launched.says("simulating")
    assert ros.master("getParam", "/husky_simulator/laser_frame") == "rear_laser"
    assert "rear_laser" in ros.master("getParam", "/robot_description")


def test_a_world_that_is_not_there_ends_the_launch_with_the_worlds_there_are(theirs, ros):
    launched = launch(ros, theirs / "launch" / "sheet.launch", "pillar_world:=nowhere.world")
    assert launched.wait() == 1
    assert re.search(r"no world 'nowhere.world'; there are .*singlePillar.world", launched.output)


def test_real_packages_of_gazebo_are_not_hidden(theirs, ros):
    real = theirs.parent / "gazebo_ros"
    (real / "launch").mkdir(parents=True)
    (real / "package.xml").write_text(
        (theirs / "package.xml").read_text().replace("husky_highlevel_controller", "gazebo_ros")
    )
    (real / "launch" / "empty_world.launch").write_text(
        '<launch><arg name="world_name"/><arg name="paused"/><arg name="use_sim_time"/><arg name="gui"/>'
        '<arg name="headless"/><arg name="debug"/><param name="/real_gazebo" value="true"/></launch>'
    )
    path = os.pathsep.join([str(theirs.parent), os.environ["ROS_PACKAGE_PATH"]])
    launch(ros, theirs / "launch" / "sheet.launch", ROS_PACKAGE_PATH=path).says("* /real_gazebo: True")
