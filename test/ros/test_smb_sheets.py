"""What the sheets of ETH's course of 2021 have students do with the SMB works with `./dev launch PATH`."""

import os

import pytest
from network import make_package, wait_until

from husky_highlevel_controller.paths import share_folder

NAME = "smb_highlevel_controller"
INCLUDE = '<include file="$(find smb_gazebo)/launch/smb_gazebo.launch">'
# exercise 1: the world is changed to one of Gazebo's own
FOOTBALL = f"""<launch>{INCLUDE}
  <arg name="world_file" value="/usr/share/gazebo-11/worlds/robocup14_spl_field.world"/>
  <arg name="z" value="0.7"/></include></launch>"""
# exercises 2 and 3: the student's node with its parameter file, the laser, the world, the heights of the scan
PILLAR = f"""<launch>{INCLUDE}
    <arg name="world_file" value="$(find smb_highlevel_controller)/worlds/singlePillar.world"/>
    <arg name="laser_enabled" value="true"/>
    <arg name="laser_scan_min_height" value="-0.2"/>
    <arg name="laser_scan_max_height" value="1.0"/>
  </include>
  <node name="smb_highlevel_controller" pkg="smb_highlevel_controller" type="controller" output="screen">
    <rosparam command="load" file="$(find smb_highlevel_controller)/config/default.yaml"/>
  </node>
</launch>"""
# drives into the pillar by the nearest return, no sign turned; exercise 5: a service that starts and stops it
CONTROLLER = """#!/usr/bin/env python3
import math
import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, LaserScan, PointCloud2
from std_srvs.srv import SetBool, SetBoolResponse

rospy.init_node("smb_highlevel_controller")
velocity = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
running, speed, last, commanded_at = True, 0.0, [], []

def on_scan(scan):
    nearest = min(scan.ranges)
    if math.isinf(nearest) and running:  # within 0.45 m nothing is seen
        velocity.publish(command(0.8, 0.0))
    if math.isfinite(nearest):
        angle = scan.angle_min + scan.ranges.index(nearest) * scan.angle_increment
        if running:
            velocity.publish(command(0.8, angle))
        rospy.loginfo_once(
            "%s: smallest %.2f m at %.3f rad of %d", scan.header.frame_id, nearest, angle, len(scan.ranges)
        )

def command(linear, angular):
    twist = Twist()
    twist.linear.x, twist.angular.z = linear, angular
    commanded_at[:] = [*commanded_at[-99:], rospy.get_time()]
    return twist

def on_imu(imu):  # the pillar weighs 1 kg: it takes some 0.01 m/s off the robot, in one sample or two
    stamp = imu.header.stamp.to_sec()
    # without a command for 0.25 s the robot brakes, which is no hit: after a stop, or on a busy machine
    if not any(0.0 <= stamp - at < 0.2 for at in list(commanded_at)):
        last.clear()
        return
    last[:] = [*last[-7:], imu.linear_acceleration.x / 400.0]
    if speed > 0.5 and sum(last) < -0.005:
        rospy.loginfo_once("hit, felt in %s", imu.header.frame_id)

def on_odometry(odometry):
    global speed
    speed = odometry.twist.twist.linear.x

def on_call(request):
    global running
    running = request.data
    return SetBoolResponse(True, "runs" if running else "stands")

rospy.Subscriber("/imu0", Imu, on_imu)
rospy.Subscriber("/odometry/filtered", Odometry, on_odometry)
def on_cloud(cloud):
    rospy.loginfo_once("%d points", cloud.width * cloud.height)

rospy.Subscriber("/rslidar_points", PointCloud2, on_cloud)
rospy.Service(rospy.get_param("~service_name"), SetBool, on_call)
topic, size = rospy.get_param("~scan_topic"), rospy.get_param("~queue_size")
rospy.Subscriber(topic, LaserScan, on_scan, queue_size=size)
rospy.spin()
"""


@pytest.fixture
def theirs(tmp_path):
    """A student's package."""
    files = {
        "worlds/singlePillar.world": (share_folder() / "worlds" / "singlePillar.world").read_text(),
        "config/default.yaml": "scan_topic: /scan\nqueue_size: 10\nservice_name: /startService\n",
        "scripts/controller": CONTROLLER,
        "launch/football.launch": FOOTBALL,
        "launch/pillar.launch": PILLAR,
    }
    return make_package(tmp_path / "smb_ws" / "src" / NAME, NAME, files)


def test_exercise_1_a_world_of_gazebo_s_is_found_by_its_name_and_a_twist_drives(theirs, launch, ros):
    # the course's own copy of smb_gazebo gives way where there is no Gazebo
    node = '<node name="x" pkg="gazebo_ros" type="spawn_model"/>'
    spawn = f'<launch><arg name="world_file"/><arg name="z"/>{node}</launch>'
    copy = theirs.parent / "smb_common" / "smb_gazebo"
    make_package(copy, "smb_gazebo", {"launch/smb_gazebo.launch": spawn})
    path = os.pathsep.join([str(theirs.parent), os.environ["ROS_PACKAGE_PATH"]])
    launched = launch(theirs / "launch" / "football.launch", ROS_PACKAGE_PATH=path)
    launched.says("there is no world /usr/share/gazebo-11/worlds/robocup14_spl_field.world; using ")
    launched.says("simulating")
    assert ros.master("getParam", "/husky_simulator/z") == 0.7
    topics = {name for name, _ in ros.master("getPublishedTopics", "")}
    assert {"/odometry/filtered", "/imu0", "/rslidar_points", "/joint_states", "/tf", "/clock"} <= topics
    wait_until(
        lambda: "pointcloud_to_laserscan" in str(ros.master("getSystemState")), "the scans have a node"
    )
    ros.start("rostopic", "pub", "-r", "10", "/cmd_vel", "geometry_msgs/Twist", "{linear: {x: 0.5}}")
    speed = "/smb_velocity_controller/odom/twist/twist/linear/x"
    wait_until(lambda: abs(float(ros.echo(speed)) - 0.5) < 0.01, "it drives")
    assert "ERROR" not in launched.output, launched.output


def test_exercises_2_3_and_5_their_node_sees_the_pillar_drives_into_it_and_stops_when_it_is_told(
    theirs, launch, ros
):
    launched = launch(theirs / "launch" / "pillar.launch")
    launched.says("rslidar: smallest ")
    launched.says("7040 points")
    words = launched.output.split("rslidar: smallest ")[1].split("\n")[0]
    distance, angle = float(words.split()[0]), float(words.split()[3])
    assert distance == pytest.approx(20.41, abs=0.1)
    assert angle == pytest.approx(0.245, abs=0.02), "on the left is positive"
    assert words.split()[-1] == "362"

    assert "stands" in ros.call("/startService", "false")
    speed = "/odometry/filtered/twist/twist/linear/x"
    wait_until(lambda: abs(float(ros.echo(speed))) < 0.01, "it stops")
    assert "runs" in ros.call("/startService", "true")
    assert "felt" not in launched.output, "driving and stopping is not a crash"
    launched.says("hit, felt in imu_link")
    # the log says what it has hit. Its position does not, because it pushes the pillar on, and on a busy
    # machine a look at its position takes seconds
    launched.says("the robot touches 'unit_cylinder'")
    assert "ERROR" not in launched.output, launched.output
