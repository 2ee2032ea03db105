"""Everything comes as on the Husky: types, frames, rates, and a twist in base_link however it stands."""

from math import nan

from geometry_msgs.msg import Twist, TwistStamped, Vector3Stamped
from harness import RosTest, stamp, twist
from husky_highlevel_controller.msg import Bumps
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock, Log
from sensor_msgs.msg import Imu, JointState, LaserScan, NavSatFix

WHEELS = ["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"]

TOPICS = {  # type, frame, rate [Hz]
    "front/scan": (LaserScan, "front_laser", 50),
    "imu/data": (Imu, "base_link", 50),
    "navsat/fix": (NavSatFix, "base_link", 40),
    "navsat/vel": (Vector3Stamped, "base_link", 40),
    "joint_states": (JointState, "", 50),
    "husky_velocity_controller/odom": (Odometry, "odom", 50),
    "husky_velocity_controller/cmd_vel_out": (TwistStamped, "", 50),
    "odometry/filtered": (Odometry, "odom", 50),
    "ground_truth/odom": (Odometry, "world", 50),
    "bumps": (Bumps, "base_link", 50),
}


class TopicsAreTheHuskys(RosTest):
    from_the_start = True

    def test_every_topic_comes_at_its_rate_in_its_frame(self):
        received = self.assert_topics(TOPICS, 100)
        for topic in ("husky_velocity_controller/odom", "odometry/filtered", "ground_truth/odom"):
            self.assertEqual(received[topic][0].child_frame_id, "base_link", topic)
        self.assertEqual(list(received["joint_states"][0].name), WHEELS)

    def test_the_clock_never_runs_backwards(self):
        clock = self.remember("clock", Clock)
        self.wait_until(lambda: len(clock) > 200, "there are 200 clock messages")
        ticks = [msg.clock.to_sec() / 0.02 for msg in clock]
        # rospy's own listener to the clock, whose connection this is, keeps only the latest when it is late
        gaps = [round(b - a, 6) for a, b in zip(ticks, ticks[1:])]
        self.assertEqual([gap for gap in gaps if gap < 1.0 or gap % 1.0], [])
        self.assertIn(1.0, gaps)

    def test_forward_is_forward_left_is_positive_and_a_command_that_is_not_a_number_is_none(self):
        odometry = self.remember("odometry/filtered", Odometry)
        truth = self.remember("ground_truth/odom", Odometry)
        joints = self.remember("joint_states", JointState)
        log = self.remember("rosout", Log)
        publisher = self.publisher("cmd_vel", Twist)

        def drive(command, duration):
            self.wait_until(lambda: truth, "there is a pose")
            end = stamp(truth[-1]) + duration
            while stamp(truth[-1]) < end:
                seen = len(truth)
                publisher.publish(command)
                publisher.publish(twist(nan, nan))
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
        self.wait_until(lambda: any("cmd_vel" in m.msg and "nan" in m.msg for m in log), "it warns")
        wheels = max((msg.velocity for msg in list(joints)), key=min)
        rolled = fastest.twist.twist.linear.x / 0.1651
        self.assertAlmostEqual(min(wheels), rolled, delta=0.1, msg="all wheels roll forwards")
        true_at = {stamp(msg): msg.pose.pose.position for msg in list(truth)}
        for msg in list(odometry):
            true, believed = true_at.get(stamp(msg)), msg.pose.pose.position
            if true is not None:
                self.assertAlmostEqual(believed.x, true.x, delta=0.1)
                self.assertAlmostEqual(believed.y, true.y, delta=0.1)
                self.assertEqual(believed.z, 0.0)
