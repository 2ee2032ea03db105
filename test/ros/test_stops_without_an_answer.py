"""Where the stop service is missing or hangs, the guard commands zero itself until it is answered."""

import threading

from driver import Driver, gap, speed
from geometry_msgs.msg import Twist
from harness import RosTest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log


class StopsWithoutAnAnswer(RosTest):
    def test_it_stands_before_the_post_and_the_service_is_called_again(self):
        truth = self.remember("ground_truth/odom", Odometry)
        log = self.remember("rosout", Log)
        zeros = self.remember("twist_marker_server/cmd_vel", Twist)
        answer = threading.Event()
        driver = Driver(answer)
        self.wait_for_node("proximity_stop", "front/scan", "odometry/filtered", "/tf")

        def warned(words):
            return [line for line in list(log) if line.level == Log.WARN and words in line.msg]

        def standing():
            return abs(speed(truth[-1])) < 1e-3

        driver.drive(0.5)  # and goes on commanding it
        self.wait_until(lambda: warned("zero is commanded on /twist_marker_server/cmd_vel"), "it says so")
        self.wait_until(standing, "the robot stands", 5.0)
        self.assertGreater(gap(truth[-1]), 0.0)
        driver.offer_service()
        self.wait_until(lambda: driver.calls, "the service is called, which hangs", 10.0)
        count = len(zeros)
        self.wait_until(lambda: len(zeros) > count + 20, "zero is still commanded")
        self.assertTrue(standing())
        answer.set()
        self.wait_until(lambda: warned("stopped the controller"), "the service is answered", 10.0)
        count = len(zeros)
        self.wait(1.0)
        self.assertLessEqual(len(zeros), count + 1)
        self.assertTrue(standing())
