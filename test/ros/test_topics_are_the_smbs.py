"""With robot:=smb topics, frames, rates and TF are those of the course's SMB, and it obeys its own inputs."""

import rospy
from geometry_msgs.msg import Twist
from harness import RosTest, twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState, LaserScan

TOPICS = {  # type, frame, rate [Hz]
    "scan": (LaserScan, "rslidar", 10),
    "imu0": (Imu, "imu_link", 400),
    "joint_states": (JointState, "", 50),
    "smb_velocity_controller/odom": (Odometry, "odom", 50),
    "odometry/filtered": (Odometry, "odom", 50),
}
PARENT = {
    "base_link": "odom",
    "base_inertia": "base_link",
    "top": "base_link",
    "imu_link": "base_link",
    "lidar_mount_link": "base_link",
    "rslidar_base_link": "base_link",
    "rslidar": "rslidar_base_link",
    **{f"{corner}_WHEEL": "base_link" for corner in ("LF", "RF", "LH", "RH")},
}


class TopicsAreTheSmbs(RosTest):
    def test_every_topic_comes_at_its_rate_in_its_frame(self):
        joints = self.assert_topics(TOPICS, 20)["joint_states"]
        self.assertEqual(list(joints[0].name), [f"{c}_WHEEL_JOINT" for c in ("LF", "RF", "LH", "RH")])

    def test_every_frame_has_its_parent(self):
        self.assert_frames(PARENT)

    def test_it_has_no_topic_of_the_husky(self):
        names = {name for name, _ in rospy.get_published_topics()}
        self.assertFalse({name for name in names if "husky_velocity" in name or "front" in name}, names)
        self.assertNotIn("/navsat/fix", names)

    def test_it_obeys_cmd_vel_and_the_output_of_its_mux(self):
        truth = self.remember("ground_truth/odom", Odometry)
        for topic in ("cmd_vel", "smb_velocity_controller/cmd_vel"):
            publisher = self.publisher(topic, Twist)

            def fast(publisher=publisher):
                publisher.publish(twist(0.5, 0.0))
                return truth and abs(truth[-1].twist.twist.linear.x - 0.5) < 0.05

            self.wait_until(fast, f"it drives as told on {topic}")
            self.wait_until(lambda: abs(truth[-1].twist.twist.linear.x) < 0.01, "and stops by itself")
