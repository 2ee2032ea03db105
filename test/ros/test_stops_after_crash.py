"""With crash_stop a robot stops after it has hit something, and not for hard driving."""

from driver import ROBOT, Driver, gap, speed
from harness import RosTest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log


class StopsAfterCrash(RosTest):
    def test_it_stops_at_the_post_once_and_goes_on_when_started(self):
        truth = self.remember("ground_truth/odom", Odometry)
        log = self.remember("rosout", Log)

        def said(words):
            return [line for line in list(log) if words in line.msg]

        self.wait_for_node("crash_stop", ROBOT.topics.imu, ROBOT.topics.odometry)
        self.wait_until(
            lambda: said("no service /driver/start_stop"), "it repeats that a service is missing", 30.0
        )
        driver = Driver()
        driver.offer_service()

        for command in (1.0, -1.0, 1.0, -1.0):
            driver.drive(command)
            self.wait_until(
                lambda c=command: driver.stops or (truth and speed(truth[-1]) * c > 0.7), "it drives", 5.0
            )
            reasons = [line.msg for line in said("crash: ")]
            self.assertEqual(
                driver.stops, 0, f"hard driving is not a crash: {reasons}, {gap(truth[-1]):.2f} m"
            )

        driver.drive(0.6)
        self.wait_until(lambda: driver.stops, "the driver is stopped")
        self.wait(1.0)
        self.assertEqual(driver.stops, 1, "once is enough")
        self.assertAlmostEqual(gap(truth[-1]), 0.0, delta=0.05, msg="it stands where it hit the post")
        self.assertLess(abs(speed(truth[-1])), 1e-3)
        self.wait_until(lambda: said("crash: "), "it says why")
        told = [line for line in said("crash: ") if line.level == Log.WARN]
        self.assertEqual(len(told), 1)
        self.assertIn("rosservice call /driver/start_stop true", told[0].msg)

        driver.drive(-0.5)
        self.wait_until(lambda: gap(truth[-1]) > 0.5, "it backs off", 5.0)
        self.assertEqual(driver.stops, 1, "nobody minds")
        driver.drive(0.6)
        self.wait_until(lambda: driver.stops == 2, "it is stopped after the next crash")
