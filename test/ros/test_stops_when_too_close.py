"""With proximity_stop a robot stops before it touches, once for each start, and may always back off."""

from driver import ROBOT, Driver, gap, speed
from harness import RosTest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log


class StopsWhenTooClose(RosTest):
    def test_it_stops_in_front_of_the_post_again_and_again_but_lets_the_robot_back_off(self):
        truth = self.remember("ground_truth/odom", Odometry)
        log = self.remember("rosout", Log)
        driver = Driver()
        driver.offer_service()
        self.wait_for_node("proximity_stop", ROBOT.topics.scan, ROBOT.topics.odometry, "/tf")

        def standing():
            return abs(speed(truth[-1])) < 1e-3

        self.assertEqual(driver.stops, 0)
        driver.drive(0.5)
        self.wait_until(lambda: driver.stops, "the driver is stopped")
        self.wait_until(standing, "the robot stands", 3.0)
        self.wait(1.0)
        self.assertEqual(driver.stops, 1, "once is enough")
        self.assertGreater(gap(truth[-1]), 0.02, "it has not touched the post")
        self.assertLess(gap(truth[-1]), 0.30, "it did not stop long before")

        def warnings():
            return [line for line in list(log) if line.level == Log.WARN and "towards it" in line.msg]

        self.wait_until(warnings, "it warns")
        self.assertEqual(len(warnings()), 1)
        self.assertIn("rosservice call /driver/start_stop true", warnings()[0].msg)

        driver.drive(0.2)  # as if started again
        self.wait_until(lambda: driver.stops == 2, "the driver is stopped again", 5.0)
        self.wait_until(standing, "the robot stands", 3.0)
        self.assertGreater(gap(truth[-1]), 0.0)

        before = gap(truth[-1])
        driver.drive(-0.5)
        self.wait_until(lambda: gap(truth[-1]) > before + 0.5, "it backs off", 5.0)
        self.assertEqual(driver.stops, 2, "nobody minds")
