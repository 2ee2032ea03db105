"""Exercise 4 as it is handed in: a launch file with filter and description, and a bag that is played."""

import numpy as np
import pytest
import rosbag
import rospy
from nav_msgs.msg import Odometry
from network import make_package, wait_until
from sensor_msgs.msg import Imu

SECONDS, RATE = 8.0, 0.5
END = (100.0 + SECONDS - 0.11) * 1e9  # [ns], just before the last estimate
COLUMNS = [2, 5, 6, 12]  # of `rostopic echo -p`: stamp, x, y and its variance
# as students write it; the IMU is mounted by TF, and the node's own remapping of an input holds
LAUNCH = """<launch>
  <param name="use_sim_time" value="true"/>
  <include file="$(find smb_description)/launch/load.launch">
    <arg name="wheel_joint_type" value="continuous"/>
  </include>
  <param name="old_description"
         command="$(find xacro)/xacro '$(find husky_description)/urdf/husky.urdf.xacro' laser_enabled:=true"/>
  <node pkg="robot_localization" type="ekf_localization_node" name="ekf_localization" output="screen">
    <rosparam command="load" file="$(find smb_control)/config/localization.yaml"/>
    <rosparam param="process_noise_covariance">[0.1, 0.2]</rosparam>
  </node>
  <node pkg="robot_localization" type="ekf_localization_node" name="ekf_in_space" output="screen">
    <rosparam command="load" file="$(find husky_control)/config/localization.yaml"/>
    <param name="two_d_mode" value="false"/>
  </node>
  <node ns="deaf" pkg="robot_localization" type="ekf_localization_node" name="ekf" output="screen">
    <rosparam command="load" file="$(find smb_control)/config/localization.yaml"/>
  </node>
  <node pkg="robot_state_publisher" type="robot_state_publisher" name="robot_state_publisher"/>
</launch>"""


def stamped(msg, time, frame):
    msg.header.stamp, msg.header.frame_id = rospy.Time.from_sec(time), frame
    return msg


def write_bag(path):
    """A circle, with a stamp that goes back and a covariance of NaN in it."""
    with rosbag.Bag(str(path), "w") as bag:
        start = 100.0
        for k in range(round(10 * SECONDS)):
            odometry = stamped(Odometry(child_frame_id="base_link"), start + k / 10, "odom")
            odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = 1.0, RATE
            odometry.twist.covariance = np.diag([1e-3] * 6).ravel().tolist()
            if k == 40:
                odometry.twist.covariance[0] = float("nan")
            bag.write("/smb_velocity_controller/odom", odometry, odometry.header.stamp)
        for k in range(round(50 * SECONDS)):
            time = start + 0.004 + k / 50
            imu = stamped(Imu(), time - (3.0 if k == 200 else 0.0), "imu_link")
            half = RATE * k / 100
            imu.orientation.z, imu.orientation.w = np.sin(half), np.cos(half)
            imu.angular_velocity.z = RATE
            bag.write("/imu/data", imu, rospy.Time.from_sec(time))


def play(ros, bag, rate):
    """Play a bag; rows of stamp [ns], x, y and its variance of the filter's path."""

    def listeners():
        return set(dict(ros.master("getSystemState")[1]).get("/odometry/filtered", ()))

    others = listeners()
    echo = ros.start("rostopic", "echo", "-p", "/odometry/filtered")  # rosbag record drops a burst
    wait_until(lambda: listeners() - others, "rostopic listens")
    player = ros.start("rosbag", "play", "--queue", "100000", "--clock", "-d", "3", "-r", str(rate), str(bag))
    assert player.wait() == 0, player.output

    def rows():
        complete = echo.output.rpartition("\n")[0].splitlines()
        table = [line.split(",") for line in complete if line[:1].isdigit()]
        return [[float(row[column]) for column in COLUMNS] for row in table]

    wait_until(lambda: (rows() or [[0]])[-1][0] > END, "the filter has done all")
    return rows()


def test_a_hand_in_of_exercise_4_runs_and_a_bag_gives_one_path_at_every_rate(ros, launch, tmp_path):
    name = "smb_highlevel_controller"
    package = make_package(tmp_path / "ws" / name, name, {"launch/ekf.launch": LAUNCH})
    launched = launch(package / "launch" / "ekf.launch")
    launched.says("two_d_mode = False is not supported, because the filter is planar")
    launched.says("process_noise_covariance has 2 numbers, not 225; using the default")
    bag = tmp_path / "navigation.bag"
    write_bag(bag)
    wait_until(lambda: "/imu/data" in ros.subscriptions("/ekf_localization"), "the filter listens")

    transforms = ros.start("rostopic", "echo", "/tf")
    slow = play(ros, bag, 2)
    stamp, x, y, variance = slow[-1]
    turned = RATE * (stamp * 1e-9 - 100.0)
    assert (x, y) == pytest.approx((np.sin(turned) / RATE, (1.0 - np.cos(turned)) / RATE), abs=0.05)
    assert 0.0 < variance < 10.0
    assert "/smb_velocity_controller/odom: its velocity's covariance is [[nan" in launched.output
    assert "/imu/data: its stamp 101" in launched.output

    launched.says("/deaf/imu/data: no message yet (imu0)")

    transforms.says('child_frame_id: "base_link"')

    fast = play(ros, bag, 20)
    launched.says("the filter starts again")
    assert fast == slow
