"""With proximity_stop a robot stops before it touches, once for each start, and may always back off.

Where the stop service is missing, the guard commands zero itself until there is one.
"""

from driver import ROBOT, Driver, gap, speed
from geometry_msgs.msg import Twist
from harness import RosTest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log


class StopsWhenTooClose(RosTest):
    def test_it_stops_in_front_of_the_post_again_and_again_but_lets_the_robot_back_off(self):
        truth = self.remember("ground_truth/odom", Odometry)
        log = self.remember("rosout", Log)
        zeros = self.remember("twist_marker_server/cmd_vel", Twist)
        driver = Driver()
        self.wait_for_node("proximity_stop", ROBOT.topics.scan, ROBOT.topics.odometry, "/tf")

        def standing():
            return abs(speed(truth[-1])) < 1e-3

        def warnings(words):
            return [line for line in list(log) if line.level == Log.WARN and words in line.msg]

        driver.drive(0.5)  # and goes on commanding it
        self.wait_until(lambda: warnings("commanding zero on /twist_marker_server/cmd_vel"), "it says so")
        self.wait_until(standing, "the robot stands", 5.0)
        driver.offer_service()
        stopped = "stopped the controller. To continue: rosservice call /driver/start_stop true"
        self.wait_until(lambda: warnings(stopped), "it warns")
        count = len(zeros)
        self.wait(1.0)
        self.assertEqual(driver.stops, 1, "once is enough")
        self.assertLessEqual(len(zeros), count + 1)
        self.assertGreater(gap(truth[-1]), 0.02, "it has not touched the post")
        self.assertLess(gap(truth[-1]), 0.30, "it did not stop long before")
        (warning,) = warnings(stopped)
        self.assertIn("towards it", warning.msg)

        driver.drive(0.2)  # as if started again
        self.wait_until(lambda: driver.stops == 2, "the driver is stopped again", 5.0)
        self.wait_until(standing, "the robot stands", 3.0)
        self.assertGreater(gap(truth[-1]), 0.0)

        before = gap(truth[-1])
        driver.drive(-0.5)
        self.wait_until(lambda: gap(truth[-1]) > before + 0.5, "it backs off", 5.0)
        self.assertEqual(driver.stops, 2, "nobody minds")
