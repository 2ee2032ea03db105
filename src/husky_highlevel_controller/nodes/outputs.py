"""What the simulator publishes, on the Husky's topics at the Husky's rates."""

from __future__ import annotations

from typing import Any, Callable, Set

import rospy
from geometry_msgs.msg import TwistStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, LaserScan, NavSatFix
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller import messages
from husky_highlevel_controller.datatypes import Scan, Snapshot
from husky_highlevel_controller.geometry import pose_from_2d
from husky_highlevel_controller.msg import Bumps
from husky_highlevel_controller.nodes.starting import publish
from husky_highlevel_controller.simulation import ODOMETRY_RATE, SimulatorConfig, steps_per

WORLD, ODOM, BASE = "world", "odom", "base_link"
CLOCK_RATE = 50  # [Hz], as that of scans and odometry; besides, the clock is told with every scan
QUEUE = 200  # messages kept for a subscriber that is busy; one that hangs must not hold the world


class Outputs:
    """Publishes snapshots; a message that nobody listens to is not even made."""

    def __init__(self, config: SimulatorConfig) -> None:
        """Raises HuskyError where a rate does not divide that of the physics."""
        self._state_steps = steps_per(ODOMETRY_RATE, config.physics_rate, "the rate of odometry")
        self._clock_steps = steps_per(CLOCK_RATE, config.physics_rate, "the rate of /clock")
        self._drift = config.gps.drift
        self._tells_time = bool(rospy.get_param("/use_sim_time", False))
        self._bumped: Set[str] = set()
        self.clock = rospy.Publisher("/clock", Clock, queue_size=QUEUE)
        self.transforms = rospy.Publisher("/tf", TFMessage, queue_size=QUEUE)
        self.scan = rospy.Publisher("front/scan", LaserScan, queue_size=QUEUE)
        self.joints = rospy.Publisher("joint_states", JointState, queue_size=QUEUE)
        self._imu = rospy.Publisher("imu/data", Imu, queue_size=QUEUE)
        self._fix = rospy.Publisher("navsat/fix", NavSatFix, queue_size=QUEUE)
        self._fix_velocity = rospy.Publisher("navsat/vel", Vector3Stamped, queue_size=QUEUE)
        self._odometry = rospy.Publisher("odometry/filtered", Odometry, queue_size=QUEUE)
        self._wheel_odometry = rospy.Publisher("husky_velocity_controller/odom", Odometry, queue_size=QUEUE)
        self._command = rospy.Publisher(
            "husky_velocity_controller/cmd_vel_out", TwistStamped, queue_size=QUEUE
        )
        self._truth = rospy.Publisher("ground_truth/odom", Odometry, queue_size=QUEUE)
        self._bumps = rospy.Publisher("bumps", Bumps, queue_size=QUEUE)
        self.reset()
        self._set_time(rospy.Time())

    def reset(self) -> None:
        """Let all periods begin anew."""
        self._step = 0
        self.clock_was_published = False

    def publish(self, snapshot: Snapshot) -> None:
        """Publish what is due one step after the snapshot before.

        The time goes first, then the robot's place and the scan: whoever answers scans waits for no more.
        """
        self._step += 1
        self.clock_was_published = snapshot.scan is not None or self._step % self._clock_steps == 0
        if self.clock_was_published:
            self.publish_clock(snapshot.stamp)
        state = self._step % self._state_steps == 0
        if state:
            base_in_odom = pose_from_2d(snapshot.odometry.pose_base_in_odom)
            _offer(self.transforms, messages.tree_to_msg, base_in_odom, snapshot.stamp, ODOM, BASE)
        if snapshot.scan is not None:
            self.publish_scan(snapshot.scan)
        self._bumped.update(snapshot.touched)
        if state:
            self._publish_state(snapshot)
        if snapshot.imu is not None:
            _offer(self._imu, messages.imu_to_msg, snapshot.imu, BASE)
        if snapshot.gps is not None:
            _offer(self._fix, messages.fix_to_msg, snapshot.gps, self._drift, BASE)
            _offer(self._fix_velocity, messages.fix_velocity_to_msg, snapshot.gps, BASE)

    def publish_scan(self, scan: Scan) -> None:
        """Publish a scan."""
        _offer(self.scan, messages.scan_to_msg, scan)

    def _publish_state(self, snapshot: Snapshot) -> None:
        stamp = snapshot.stamp
        _offer(self.joints, messages.wheels_to_msg, snapshot.wheels, stamp)
        _offer(self._odometry, messages.odometry_to_msg, snapshot.odometry, stamp, ODOM, BASE)
        wheels = snapshot.wheel_odometry
        _offer(self._wheel_odometry, messages.odometry_to_msg, wheels, stamp, ODOM, BASE)
        _offer(self._command, messages.twist_to_stamped_msg, snapshot.command, stamp)
        _offer(self._truth, messages.truth_to_msg, snapshot.robot, stamp, WORLD, BASE)
        _offer(self._bumps, lambda: Bumps(messages.header(stamp, BASE), sorted(self._bumped)))
        self._bumped.clear()

    def publish_clock(self, stamp: float) -> None:
        """Tell what time it is [s], this node first, which does not listen to itself."""
        now = messages.time_to_msg(stamp)
        self._set_time(rospy.Time(now.secs, now.nsecs))
        _offer(self.clock, Clock, now)

    def _set_time(self, now: rospy.Time) -> None:
        if self._tells_time:
            rospy.rostime._rostime_current = now  # and wake nobody: here no thread waits for a moment


def _offer(publisher: rospy.Publisher, make: Callable[..., Any], *args: Any) -> None:
    if publisher.get_num_connections():
        publish(publisher, make(*args))
