"""A command that is not a number is refused with a warning; the command before it stays in force."""

from math import inf, nan

from geometry_msgs.msg import Twist
from harness import RosTest, twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log


class NanCommandIsIgnored(RosTest):
    from_the_start = True

    def test_the_robot_drives_on_through_bad_commands(self):
        truth = self.remember("ground_truth/odom", Odometry)
        log = self.remember("rosout", Log)
        publisher = self.publisher("cmd_vel", Twist)
        for bad in (twist(nan, 0.0), twist(0.5, nan), twist(inf, 0.0), twist(0.0, -inf)):
            publisher.publish(bad)
        self.wait(1.0)
        self.assertLess(max(abs(m.twist.twist.linear.x) for m in truth[5:]), 0.01, "it stands still")

        good, start = 0, len(truth)
        while good < 100:
            seen = len(truth)
            publisher.publish(twist(0.5, 0.0))
            publisher.publish(twist(nan, nan))
            self.wait_until(lambda seen=seen: len(truth) > seen, "time goes on")
            good += 1
        speeds = [m.twist.twist.linear.x for m in truth[start:]]
        self.assertGreater(max(speeds), 0.45)
        self.assertLess(max(speeds), 0.55)
        self.wait_until(lambda: any("cmd_vel" in m.msg and "nan" in m.msg for m in log), "it warns")
