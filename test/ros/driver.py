"""A driver that looks at nothing, and obeys a start/stop service as the controller does."""

import rospy
from geometry_msgs.msg import Twist
from harness import twist
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool, SetBoolResponse

from husky_highlevel_controller.robot import load_robot

ROBOT = load_robot(rospy.get_param("robot_name", "husky"))  # of post.launch
POST, RADIUS = 2.0, 0.2  # [m], where the post is, how thick


class Driver:
    """Commands one twist, all the time, until it is stopped."""

    def __init__(self):
        self.stops, self._command = 0, None
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        rospy.Subscriber("ground_truth/odom", Odometry, self._on_odometry, queue_size=1, tcp_nodelay=True)

    def offer_service(self):
        rospy.Service("driver/start_stop", SetBool, self._on_start_stop)

    def drive(self, linear=0.0, angular=0.0):
        self._command = twist(linear, angular)

    def stop(self):
        self._command = None
        self._velocity.publish(twist())

    def _on_odometry(self, _msg):
        command = self._command
        if command is not None:
            self._velocity.publish(command)

    def _on_start_stop(self, request):
        assert not request.data, "a guard only ever stops"
        self.stops += 1
        self.stop()
        return SetBoolResponse(True, "stopped")


def speed(msg):
    return msg.twist.twist.linear.x


def gap(msg):
    """Between the robot's nose and the post, for a robot that looks straight at it [m]."""
    return POST - RADIUS - ROBOT.hull.length / 2.0 - msg.pose.pose.position.x
