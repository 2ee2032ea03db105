"""Stops the controller after a collision; docs/reference.md lists topics and parameters."""

from __future__ import annotations

import threading

import rospy
import tf2_ros
from sensor_msgs.msg import Imu

from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.controller.crash_detection import CrashConfig, CrashDetector
from husky_highlevel_controller.datatypes import IDENTITY, Quaternion, Twist2D
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import parameters_and_robot, run_node
from husky_highlevel_controller.ros.safety.guard import REPORT_PERIOD, Guard, ServiceConfig
from husky_highlevel_controller.ros.transforms import lookup_pose

BASE = "base_link"
QUEUE = 1000  # length of the queues of odometry and IMU messages
# [s] No crash is detected if the clocks of IMU and odometry differ by more than this. When the robot brakes,
# the IMU and the wheels must show the change of speed at the same time. Otherwise it looks like a crash.
CLOCK_TOLERANCE = 0.1
LONG_DELAY = 0.6  # [s] a warning is logged if IMU samples wait longer than this for odometry


class CrashStopNode:
    """Stops the controller after a collision: the IMU feels a change of speed that the wheels do not show."""

    def __init__(self) -> None:
        """Read the parameters, and subscribe to odometry and IMU; ConfigError for a wrong parameter."""
        values, robot = parameters_and_robot()
        service, config = read_config(values, rospy.get_name() + "/", ServiceConfig, CrashConfig)
        self._detector = CrashDetector(config)
        # lock that is held while the detector is used, because odometry and IMU come in different threads
        self._detector_lock = threading.Lock()
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms)
        self._odometry_topic = rospy.resolve_name(robot.topics.odometry)
        # the queues are long, because the detector adds up all messages, and the sums would be wrong if one
        # were lost
        self._guard = Guard(service, robot, CLOCK_TOLERANCE, self._on_odometry, queue_size=QUEUE)
        self._guard.watch(robot.topics.imu, Imu, self._on_imu, queue_size=QUEUE)

    def run(self) -> None:
        """Work until the node is shut down."""
        self._guard.run()

    def _on_odometry(self, stamp: float, twist_in_base: Twist2D) -> None:
        """Give the velocity of the wheels to the crash detector, which compares it with the IMU."""
        with self._detector_lock:
            self._detector.add_odometry(stamp, twist_in_base)

    def _on_imu(self, msg: Imu) -> None:
        """Give one IMU sample to the crash detector, and let the guard stop the controller after a crash.

        While the clocks of IMU and odometry differ, no sample is judged. The IMU would feel the robot brake,
        but the wheels would seem to slow down at another time, which looks like a crash.
        """
        sample, mount = conversions.imu_from_msg(msg), self._imu_in_base(msg.header.frame_id)
        # time of the sample by odometry's clock. This call also measures by how much the clocks differ
        # (`clocks.seconds`), and if they differ, it logs a warning with these texts.
        stamp = self._guard.time_of(sample.stamp, "IMU samples are", "no crash is detected")
        if self._guard.clocks.seconds != 0.0:  # an offset within CLOCK_TOLERANCE is exactly 0
            # None says that this sample shows no danger. `judge` is called for each sample, because it also
            # notices when the robot drives again after a stop.
            self._guard.judge(stamp, None)
            return
        with self._detector_lock:
            # [m/s] change of the speed in a crash; None if no crash is found
            loss = self._detector.add_sample(sample, mount)
            delay = self._detector.delay  # [s] time for which the samples wait for odometry
        if delay > LONG_DELAY:
            rospy.logwarn_throttle(
                REPORT_PERIOD,
                f"no odometry on {self._odometry_topic} for {delay:.1f} s, so crashes are detected late",
            )
        danger = None if loss is None else f"crash: the velocity changed by {loss:.2f} m/s"
        self._guard.judge(stamp, danger)

    def _imu_in_base(self, frame: str) -> Quaternion:
        """Return the rotation of the IMU in base_link; the identity if TF has no transform."""
        if frame.lstrip("/") == BASE:
            return IDENTITY.quat_xyzw
        pose = lookup_pose(self._transforms, BASE, frame)
        return IDENTITY.quat_xyzw if pose is None else pose.quat_xyzw


def main() -> None:
    """Run the node."""
    run_node("crash_stop", CrashStopNode)
