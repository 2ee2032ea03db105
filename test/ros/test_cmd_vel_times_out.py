#!/usr/bin/env python3
"""A command that is not renewed stops counting after 0.25 s, and the robot brakes within its limits."""

from geometry_msgs.msg import Twist
from harness import RosTest, run, stamp, twist
from nav_msgs.msg import Odometry


class CmdVelTimesOut(RosTest):
    from_the_start = True

    def test_one_command_moves_the_robot_for_a_quarter_of_a_second(self):
        truth = self.remember("ground_truth/odom", Odometry)
        self.wait_until(lambda: len(truth) > 50, "the robot stands on its wheels")
        self.publisher("cmd_vel", Twist).publish(twist(0.6))
        self.wait_until(lambda: any(m.twist.twist.linear.x > 0.5 for m in list(truth)), "it drives")
        self.wait_until(lambda: abs(truth[-1].twist.twist.linear.x) < 1e-3, "it stands again", 5.0)
        self.wait(0.5)

        moving = [stamp(m) for m in truth if m.twist.twist.linear.x > 0.01]
        # 0.25 s until the command is too old, and 0.6 m/s / 3 m/s^2 to brake
        self.assertAlmostEqual(moving[-1] - moving[0], 0.45, delta=0.08)
        braking = [m.twist.twist.linear.x for m in truth]
        hardest = max(a - b for a, b in zip(braking, braking[1:])) / 0.02
        self.assertLess(hardest, 3.3, "it brakes at 3 m/s^2")


if __name__ == "__main__":
    run(CmdVelTimesOut)
