"""Writes what other nodes see of robot and world into a file, again and again: watch_robot.py FILE."""

import contextlib
import json
import os
import sys
import time
from math import dist

import rospy
from geometry_msgs.msg import Twist
from husky_highlevel_controller.srv import ListObjects
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

PERIOD = 0.02  # [s] of wall time
LIST_PERIOD = 0.2  # [s] of wall time between two looks at the objects
JUMP = 1.0  # [m] between two messages: the robot was put elsewhere


def main(path):
    rospy.init_node("watch_robot", disable_rostime=True)
    seen = {"speed": None, "position": None, "commanded": 0.0, "commands": 0, "is_locked": False, "time": 0.0}
    seen["objects"] = {}  # (x, y) in the world [m] by name
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
    list_objects, list_due = rospy.ServiceProxy("husky_simulator/list", ListObjects), 0.0
    while not rospy.is_shutdown():
        if time.monotonic() >= list_due:
            list_due = time.monotonic() + LIST_PERIOD
            with contextlib.suppress(rospy.ServiceException):  # no simulator yet
                answer = list_objects("world")
                places = [(pose.position.x, pose.position.y) for pose in answer.poses]
                seen["objects"] = dict(zip(answer.model_names, places))
        with open(f"{path}.new", "w") as file:
            json.dump(seen, file)
        os.replace(f"{path}.new", path)
        time.sleep(PERIOD)


main(sys.argv[1])
