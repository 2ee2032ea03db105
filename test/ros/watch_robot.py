"""Writes what other nodes see of the robot into a file, again and again: watch_robot.py FILE."""

import json
import os
import sys
import time

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

PERIOD = 0.02  # [s] of wall time


def main(path):
    rospy.init_node("watch_robot", disable_rostime=True)
    seen = {"speed": None, "position": None, "commanded": 0.0, "commands": 0, "is_locked": False, "time": 0.0}

    def on_odometry(msg):
        point = msg.pose.pose.position
        seen.update(
            speed=msg.twist.twist.linear.x, position=(point.x, point.y), time=msg.header.stamp.to_sec()
        )

    def on_command(msg):
        seen.update(commanded=msg.linear.x, commands=seen["commands"] + 1)

    rospy.Subscriber("ground_truth/odom", Odometry, on_odometry)
    rospy.Subscriber("kb_teleop/cmd_vel", Twist, on_command)
    rospy.Subscriber("e_stop", Bool, lambda msg: seen.update(is_locked=msg.data))
    while not rospy.is_shutdown():
        with open(f"{path}.new", "w") as file:
            json.dump(seen, file)
        os.replace(f"{path}.new", path)
        time.sleep(PERIOD)


main(sys.argv[1])
