"""The launch files of the courses, written for Gazebo, run unchanged with `./dev launch PATH`."""

import pytest
import yaml
from network import PACKAGE, make_package

from husky_highlevel_controller.paths import share_folder

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
TELEPORT = """#!/usr/bin/env python3
import rospy
from gazebo_msgs.msg import ModelState, ModelStates
from gazebo_msgs.srv import SetModelState

rospy.init_node("teleport")
rospy.wait_for_service("/gazebo/set_model_state")
state = ModelState(model_name="husky")
state.pose.position.x = 2.0
rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)(state)
states = rospy.wait_for_message("/gazebo/model_states", ModelStates)
print("models:", *states.name, "at %.2f" % states.pose[-1].position.x, flush=True)
"""
TELEPORTED = OLDER.replace(
    "</launch>", '<node name="t" pkg="husky_highlevel_controller" type="teleport" output="screen"/></launch>'
)


@pytest.fixture
def theirs(tmp_path):
    """A student's package, which has the name of ours, as the course's sheet says."""
    files = {
        "worlds/singlePillar.world": PILLAR,
        "config/default.yaml": "scan_topic_name: /front/scan\ngreeting: hello\n",
        "scripts/controller": CONTROLLER,
        "scripts/teleport": TELEPORT,
        "launch/teleport.launch": TELEPORTED,
        "launch/sheet.launch": SHEET,
        "launch/older.launch": OLDER,
    }
    return make_package(tmp_path / "catkin_ws" / "src" / PACKAGE, PACKAGE, files)


def test_the_sheet_s_file_drives_their_controller_in_their_world(theirs, launch, ros):
    launched = launch(theirs / "launch" / "sheet.launch")
    launched.says("their package: hello in front_laser")
    assert "simulating 'default' with 2 bodies" in launched.output, launched.output
    assert "starts without launch-prefix 'xterm -e'" in launched.output
    assert "ERROR" not in launched.output, launched.output
    assert ros.master("getParam", "/use_sim_time") is True
    assert "front_laser" in ros.master("getParam", "/robot_description")


def test_the_older_launch_file_shows_the_football_field_with_the_laser_of_the_environment(
    theirs, launch, ros
):
    file = theirs / "launch" / "older.launch"
    launched = launch(file, HUSKY_LMS1XX_TOPIC="rear/scan", HUSKY_LMS1XX_PREFIX="rear")
    launched.says("simulating")
    assert ros.master("getParam", "/husky_simulator/world_name") == "worlds/robocup14_spl_field.world"
    assert ros.master("getParam", "/husky_simulator/laser_frame") == "rear_laser"
    assert "rear_laser" in ros.master("getParam", "/robot_description")


def test_a_script_for_gazebo_s_services_moves_the_robot_by_launch_file_and_by_hand(theirs, launch, ros):
    launched = launch(theirs / "launch" / "teleport.launch")
    launched.says("ground_plane")
    assert "husky at 2.00" in launched.output, launched.output
    ran = ros.start(str(share_folder() / "dev"), "run", str(theirs / "scripts" / "teleport"))
    ran.says("husky at 2.00")


AS_PRINTED = """<launch>
  <arg name="seed" default="4"/>
  <include file="$(find gazebo_ros)/launch/empty_world.launch">
    <arg name="world_name" value="$(find husky_highlevel_controller)/worlds/singlePillar.world"/>
    <arg name="gui" value="true"/>
  </include>
  <include file="$(find husky_gazebo)/launch/spawn_husky.launch"/>
  <node name="husky_highlevel_controller" pkg="husky_highlevel_controller" type="husky_highlevel_controller"
        output="screen">
    <rosparam command="load" file="$(find husky_highlevel_controller)/config/config.yaml"/>
  </node>
  <node pkg="rviz" type="rviz" name="rviz" required="true"/>
</launch>"""
ENDS = ("real_time_factor:=6", "exit_on_arrival:=true")


def test_the_sheet_s_file_drives_this_package_s_controller_with_arguments_of_the_simulator(
    launch, ros, tmp_path
):
    (tmp_path / "husky_controller.launch").write_text(AS_PRINTED)
    core = ros.core()  # which keeps the parameters
    launched = launch(tmp_path / "husky_controller.launch", *ENDS, "seed:=7", "web:=true", "web_port:=8171")
    launched.says("arrived after")
    assert launched.wait() == 0, launched.output
    assert core.popen.poll() is None
    assert ros.master("getParam", "/husky_simulator/real_time_factor") == 6.0
    assert ros.master("getParam", "/husky_simulator/seed") == 0, "the file has a seed of its own"
    assert "process[husky_web" in launched.output
    assert "process[rviz" not in launched.output, "there is no display"


WITH_SCAN = """<launch>
  <include file="$(find gazebo_ros)/launch/empty_world.launch">
    <arg name="world_name" value="$(find husky_highlevel_controller)/worlds/singlePillar.world"/>
  </include>
  <include file="$(find husky_description)/launch/description.launch"/>
  <node name="spawn" pkg="gazebo_ros" type="spawn_model" args="-urdf -param robot_description -model husky"/>
  <node name="theirs" pkg="husky_highlevel_controller" type="naive_controller" output="screen">
    <param name="scan_topic_name" value="/scan"/>
  </node>
</launch>"""


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        (["robot:=husky_melodic"], 0, "arrived after"),
        (["deadline:=6"], 1, "no arrival within 6 s of simulated time; last: the robot has not moved"),
    ],
)
def test_a_controller_of_2018_arrives_with_its_robot_and_is_told_of_it_without(
    more, code, words, launch, ros, tmp_path
):
    (tmp_path / "theirs.launch").write_text(WITH_SCAN)
    ros.core()
    launched = launch(tmp_path / "theirs.launch", *ENDS, *more)
    assert launched.wait() == code, launched.output
    assert words in launched.output
    frame = ros.master("getParam", "/husky_simulator/laser_frame")
    assert frame == ("base_laser" if code == 0 else "front_laser")
    assert frame in ros.master("getParam", "/robot_description")


MAZE = """<sdf version="1.6"><world name="maze">
  <include><uri>model://ground_plane</uri></include>
</world></sdf>"""
POST = """<robot name="post"><link name="post">
  <collision><geometry><cylinder radius="0.2" length="2"/></geometry></collision>
</link></robot>"""
OWN_NODES = """<launch>
  <node name="gazebo" pkg="gazebo_ros" type="gzserver"
        args="-e ode -s libx.so $(find husky_gazebo)/worlds/maze.world"/>
  <node name="gui" pkg="gazebo_ros" type="gzclient"/>
  <include file="$(find husky_gazebo)/launch/spawn_husky.launch">
    <arg name="ur5_enabled" value="true"/>
  </include>
  <node name="post" pkg="gazebo_ros" type="spawn_model" output="screen"
        args="-file $(find husky_gazebo)/models/post.urdf -urdf -model post -x 4 -y -2 -z 1 -Y 0.5"/>
</launch>"""


@pytest.fixture
def copy(theirs):
    """A student's copy of husky_gazebo with a world, a model and launch files of their own, not built."""
    needs_gazebo = '<launch><include file="$(find husky_control)/launch/control.launch"/></launch>'
    files = {
        "worlds/maze.world": MAZE,
        "models/post.urdf": POST,
        "launch/maze.launch": OWN_NODES,
        "launch/spawn_husky.launch": needs_gazebo,
    }
    return make_package(theirs.parent / "husky_gazebo", "husky_gazebo", files)


def test_nodes_of_gazebo_ros_simulate_the_world_and_the_model_of_a_copy(copy, launch, ros):
    launched = launch(copy / "launch" / "maze.launch", HUSKY_UST10_ENABLED="1")
    launched.says("'post' was added")
    assert "simulating 'maze' with 1 bodies" in launched.output
    assert ros.master("getParam", "/husky_simulator/world_name") == str(copy / "worlds" / "maze.world")
    assert "ignored by this simulator: -s" in launched.output
    assert "ignored by this simulator: ur5_enabled=true" in launched.output
    assert "ignored by this simulator: HUSKY_UST10_ENABLED=1" in launched.output
    assert "ERROR" not in launched.output
    post = yaml.safe_load(ros.call("/husky_simulator/list", "world"))["poses"][1]["position"]
    assert (post["x"], post["y"], post["z"]) == (4.0, -2.0, 1.0)


ROBOT = """<launch>
  <include file="$(find gazebo_ros)/launch/empty_world.launch"/>
  <include file="$(find husky_control)/launch/control.launch"/>
  <include file="$(find husky_control)/launch/teleop.launch"/>
  <node name="spawn" pkg="gazebo_ros" type="spawn_model"
        args="-x 1.5 -z 0.2 -unpause -urdf -param robot_description -model husky -robot_namespace /"/>
</launch>"""


def test_the_husky_s_urdf_in_spawn_model_is_the_robot(theirs, launch, ros):
    file = theirs / "launch" / "robot.launch"
    file.write_text(ROBOT)
    launched = launch(file)
    launched.says("simulating 'default' with 1 bodies")
    assert "ERROR" not in launched.output
    assert "no robot" not in launched.output
    assert ros.master("getParam", "/husky_simulator/x") == 1.5


BOOM = """<robot name="husky" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="$(find husky_description)/urdf/husky.urdf.xacro"/>
  <link name="boom"><collision><geometry><box size="0.2 3 0.1"/></geometry></collision></link>
  <joint name="boom_joint" type="{}">
    <parent link="base_link"/><child link="boom"/><origin xyz="0 0 1"/>
  </joint>
</robot>"""
CRATE = """<robot name="crate"><link name="crate">
  <collision><geometry><box size="0.3 0.3 0.3"/></geometry></collision>
  <inertial><mass value="2"/><inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial>
</link></robot>"""
WITH_BOOM = """<launch>
  <include file="$(find gazebo_ros)/launch/empty_world.launch"/>
  <param name="robot_description" command="$(find xacro)/xacro $(dirname)/boom.urdf.xacro"/>
  <node name="spawn" pkg="gazebo_ros" type="spawn_model" args="-urdf -param robot_description -model husky"/>
  <node name="crate" pkg="gazebo_ros" type="spawn_model"
        args="-urdf -file $(dirname)/crate.urdf -model crate -y 1.3 -z 2"/>
</launch>"""


@pytest.mark.parametrize("joint", ["fixed", "revolute"])
def test_what_a_husky_of_ones_own_has_besides_is_there_or_a_warning_says_why_not(joint, theirs, launch, ros):
    folder = theirs / "launch"
    for name, text in (("boom.launch", WITH_BOOM), ("crate.urdf", CRATE)):
        (folder / name).write_text(text)
    (folder / "boom.urdf.xacro").write_text(BOOM.format(joint))
    launched = launch(folder / "boom.launch")
    if joint == "fixed":
        launched.says("the robot touches 'crate'")  # which falls onto the boom, beside the Husky
        assert 'child_frame_id: "boom"' in ros.echo("/tf_static")
        assert "warning: " not in launched.output
    else:
        launched.says(
            "warning: your robot description has a fault, so the Husky's is simulated and shown: link 'boom'"
        )
        launched.says("'crate' was added")
    assert ('name="boom"' in ros.master("getParam", "/robot_description")) is (joint == "fixed")


def test_a_launch_file_that_needs_gazebo_gives_way_to_the_one_that_does_not(copy, launch, ros):
    launched = launch(copy / "launch" / "spawn_husky.launch", "--nodes")
    assert launched.wait() == 0
    assert "spawn_husky.launch needs Gazebo, so " in launched.output
    assert launched.output.splitlines()[-1] == "/spawn_husky"


INCLUDE = '<launch><include file="$(find husky_gazebo)/launch/{}.launch"/></launch>'


def test_several_robots_are_refused_with_the_reason(theirs, launch):
    outer = theirs / "launch" / "outer.launch"
    outer.write_text(INCLUDE.format("multi_husky_playpen"))
    launched = launch(outer)
    assert launched.wait() == 1
    assert "playpen.launch: the simulator has one robot in a world" in launched.output


def test_a_camera_that_is_not_simulated_is_left_out_with_the_reason_and_the_robot_starts(theirs, launch):
    outer = theirs / "launch" / "outer.launch"
    robot = INCLUDE.format("spawn_husky").partition("<launch>")[2]
    outer.write_text(INCLUDE.format("realsense").replace("</launch>", robot))
    launched = launch(outer, "--nodes")
    assert launched.wait() == 0, launched.output
    assert "warning: realsense.launch is ignored, because no RealSense is simulated" in launched.output
    assert launched.output.splitlines()[-1] == "/spawn_husky"
