#!/usr/bin/env python3
"""State comes as on the Husky: types, frames, 50 Hz, and a twist in base_link however the robot stands."""

from geometry_msgs.msg import Twist
from harness import RosTest, run, stamp, twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

WHEELS = ["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"]


class TopicsAreTheHuskys(RosTest):
    def test_odometry_and_joint_states_come_at_50_hz(self):
        topics = {"odometry/filtered": Odometry, "joint_states": JointState, "ground_truth/odom": Odometry}
        received = {topic: self.remember(topic, kind) for topic, kind in topics.items()}
        self.wait_until(lambda: min(map(len, received.values())) > 100, "there are 100 of each")
        for topic, messages in received.items():
            ticks = [round(stamp(msg) / 0.02, 6) for msg in messages]
            self.assertEqual(ticks, [ticks[0] + i for i in range(len(ticks))], topic)
        odometry, joints = received["odometry/filtered"][0], received["joint_states"][0]
        self.assertEqual((odometry.header.frame_id, odometry.child_frame_id), ("odom", "base_link"))
        self.assertEqual(list(joints.name), WHEELS)

    def test_the_clock_never_runs_backwards(self):
        clock = self.remember("clock", Clock)
        self.wait_until(lambda: len(clock) > 200, "there are 200 clock messages")
        times = [msg.clock.to_sec() for msg in clock]
        self.assertEqual([round(b - a, 9) for a, b in zip(times, times[1:])], [0.01] * (len(times) - 1))

    def test_forward_is_forward_and_left_is_positive(self):
        odometry = self.remember("odometry/filtered", Odometry)
        truth = self.remember("ground_truth/odom", Odometry)
        joints = self.remember("joint_states", JointState)
        publisher = self.publisher("cmd_vel", Twist)

        def drive(command, duration):
            self.wait_until(lambda: truth, "there is a pose")
            end = stamp(truth[-1]) + duration
            while stamp(truth[-1]) < end:
                seen = len(truth)
                publisher.publish(command)
                self.wait_until(lambda seen=seen: len(truth) > seen, "time goes on")

        drive(twist(0.0, 0.5), 3.0)  # to the left, by about 1.5 rad
        orientation = truth[-1].pose.pose.orientation
        self.assertGreater(orientation.z * orientation.w, 0.2, "it turned left")

        start = len(truth)
        drive(twist(0.5, 0.0), 2.0)
        # it may brake now and then where commands come late, but at its fastest it does as told
        fastest = max(truth[start:], key=lambda m: m.twist.twist.linear.x)
        self.assertAlmostEqual(fastest.twist.twist.linear.x, 0.5, delta=0.02, msg="told in base_link")
        self.assertAlmostEqual(fastest.twist.twist.linear.y, 0.0, delta=0.01)
        wheels = max((msg.velocity for msg in list(joints)), key=min)
        self.assertAlmostEqual(min(wheels), 0.5 / 0.1651, delta=0.1, msg="all wheels roll forwards")
        true_at = {stamp(msg): msg.pose.pose.position for msg in list(truth)}
        for msg in list(odometry):
            true, believed = true_at.get(stamp(msg)), msg.pose.pose.position
            if true is not None:
                self.assertAlmostEqual(believed.x, true.x, delta=0.1)
                self.assertAlmostEqual(believed.y, true.y, delta=0.1)
                self.assertEqual(believed.z, 0.0)


if __name__ == "__main__":
    run(TopicsAreTheHuskys)
