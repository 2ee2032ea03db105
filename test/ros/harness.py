"""What the rostest scripts here share: a node that remembers messages, and waits that end."""

import time
import unittest

import rospy
from geometry_msgs.msg import Twist

WALL_LIMIT = 60.0  # [s], for a simulation that does not get on


class RosTest(unittest.TestCase):
    """A test case with a node."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("test")

    def remember(self, topic, kind):
        """A list that grows with every message of a topic, which somebody publishes."""
        messages = []
        subscriber = rospy.Subscriber(topic, kind, messages.append, queue_size=1000, tcp_nodelay=True)
        self.addCleanup(subscriber.unregister)
        self.wait_until(subscriber.get_num_connections, f"somebody publishes {topic}")
        return messages

    def wait_until(self, condition, what, simulated=30.0):
        """Wait for a condition; fail after so many simulated seconds, or when simulated time stands still."""
        wall_end, end = time.monotonic() + WALL_LIMIT, None
        while not condition():
            now = rospy.get_time()
            if end is None and now > 0.0:
                end = now + simulated
            self.assertFalse(rospy.is_shutdown(), "shut down while waiting until " + what)
            self.assertLess(time.monotonic(), wall_end, f"{WALL_LIMIT} s of wall time passed before {what}")
            self.assertTrue(end is None or now < end, f"{simulated} simulated s passed before {what}")
            time.sleep(0.002)

    def wait(self, simulated):
        """Let simulated time pass."""
        self.wait_until(lambda: rospy.get_time() > 0.0, "there is a clock")
        end = rospy.get_time() + simulated
        self.wait_until(lambda: rospy.get_time() >= end, f"{simulated} s passed", simulated + 10.0)

    def publisher(self, topic, kind):
        """A publisher that somebody listens to."""
        publisher = rospy.Publisher(topic, kind, queue_size=100)
        self.addCleanup(publisher.unregister)
        self.wait_until(publisher.get_num_connections, f"somebody listens to {topic}")
        return publisher


def twist(linear=0.0, angular=0.0):
    msg = Twist()
    msg.linear.x, msg.angular.z = linear, angular
    return msg


def stamp(msg):
    return msg.header.stamp.to_sec()


def run(case):
    """Run a test case as rostest wants it; call at the end of the script."""
    import rostest

    rostest.rosrun("husky_highlevel_controller", case.__name__, case)
