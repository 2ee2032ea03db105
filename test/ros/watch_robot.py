"""Writes what other nodes see of the robot into a file, again and again: watch_robot.py FILE."""

import json
import os
import sys
import time
from math import dist

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

PERIOD = 0.02  # [s] of wall time
JUMP = 1.0  # [m] between two messages: the robot was put elsewhere


def main(path):
    rospy.init_node("watch_robot", disable_rostime=True)
    seen = {"speed": None, "position": None, "commanded": 0.0, "commands": 0, "is_locked": False, "time": 0.0}
    # since the last jump, for a test that may come too late to see it
    seen.update(jumped_to=None, fastest=0.0)

    def on_odometry(msg):
        position = msg.pose.pose.position.x, msg.pose.pose.position.y
        speed = msg.twist.twist.linear.x
        if seen["position"] is not None and dist(seen["position"], position) > JUMP:
            seen.update(jumped_to=position, fastest=0.0)
        seen.update(
            speed=speed,
            position=position,
            time=msg.header.stamp.to_sec(),
            fastest=max(seen["fastest"], speed),
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
