"""Node that estimates the robot's motion on the plane, if robot_localization is not installed.

Stands in for ekf_localization_node of robot_localization 2.7 (Noetic) with two_d_mode, together with
`estimation/`, the script planar_ekf and `compat/robot_localization`. No test compares the two, because Debian
does not have the original. `test_planar_ekf.py` tests the laws of a Kalman filter, and
`test/ros/test_bag_gives_one_path.py` starts the node under the original's name, with the course's parameters.
"""

from __future__ import annotations

import threading
import time
from enum import Enum
from math import hypot, inf, isqrt
from typing import Any, Dict, List, Optional, Sequence, Set, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller.datatypes import Odometry as PlanarOdometry
from husky_highlevel_controller.datatypes import Pose, Pose2D, Quaternion, Twist2D, Vector3
from husky_highlevel_controller.estimation.filter_config import read_filter_config
from husky_highlevel_controller.estimation.localization import Localization
from husky_highlevel_controller.estimation.planar_ekf import VX, MotionEstimate
from husky_highlevel_controller.estimation.readings import ON_PLANE, Mounting, Reading, ReadingError
from husky_highlevel_controller.geometry import yaw_from_quat
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import publish, run_node
from husky_highlevel_controller.ros.transforms import lookup_transform

# length of the queues of messages, which is so large that no message is lost; a bag that is played fast sends
# many messages at once
QUEUE = 1000
# [s] a message is ignored if its stamp is later than the clock by more than this. The clock may lag behind a
# bag that is played fast, so a smaller difference is normal.
MAX_AHEAD = 60.0
# The filter waits for the readings of all inputs, but not for those of a silent input. An input without any
# message is silent when ABSENCE has passed since the first message of another input. An input is also silent
# when SILENCE has passed since its last usable message. Both are long, because a busy machine delays threads.
ABSENCE, SILENCE = 1.0, 3.0  # [s] wall times
CLOCK_BACK = 1.0  # [s] a new run has begun if the clock goes back by more than this
REPORT_PERIOD = 5.0  # [s] time between two warnings of one kind about a topic
# variance of z, roll, pitch and their rates, which is small because they are always 0 on the plane
OFF_PLANE = 1e-6
# index of the rows and columns of x, y and yaw in a (6, 6) covariance of x, y, z, roll, pitch and yaw
PLANE = np.ix_(ON_PLANE, ON_PLANE)


class _Fate(Enum):
    """Fate of a message of an input."""

    USED = "used"  # the filter has accepted the message, or an earlier message that was held until now
    HELD = "held"  # the message waits until TF has the frame of the sensor
    IGNORED = "ignored"  # the message is not usable, and a warning was logged


class LocalizationNode:
    """Filters wheel odometry and IMU; publishes odometry/filtered and the transform odom -> base_link."""

    def __init__(self) -> None:
        """Read the parameters, make the filter, and subscribe to its inputs.

        Raises:
            ConfigError: a parameter asks for a feature that the filter does not have.
        """
        self._config, remarks = read_filter_config(rospy.get_param("~", {}), rospy.get_name() + "/")
        for remark in remarks:  # sentences on parameters and inputs that are ignored
            rospy.logerr(remark)
        options = self._config.options
        # name of the robot's frame in published messages; base_link_frame_output may give it another name
        self._base_frame = options.base_link_frame_output or options.base_link_frame
        # lock that is held while the filter is used, because each publisher has a thread of its own
        self._lock = threading.Lock()
        # [s] time of the last warning, by input and kind of warning
        self._complained_at: Dict[Tuple[str, str], float] = {}
        self._start_filter()
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms)
        self._odometry_publisher = rospy.Publisher("odometry/filtered", Odometry, queue_size=QUEUE)
        self._tf_publisher = rospy.Publisher("/tf", TFMessage, queue_size=QUEUE)
        rospy.Subscriber("set_pose", PoseWithCovarianceStamped, self._on_set_pose)
        for name, item in self._config.inputs.items():
            # the name of an input, such as imu0, gives the type of its messages
            kind = Imu if name.startswith("imu") else Odometry
            # a shorter queue could lose messages, so the configured size only counts if it is larger
            queue_size = max(item.queue_size, QUEUE)
            rospy.Subscriber(item.topic, kind, self._on_message, name, queue_size)
        # this timer runs once, and then logs which inputs have sent nothing; it begins again if the clock
        # goes back
        rospy.Timer(rospy.Duration(REPORT_PERIOD), self._report_silence, oneshot=True, reset=True)

    def run(self) -> None:
        """Work until the node is shut down."""
        rospy.spin()

    def _start_filter(self) -> None:
        """Make a new filter, forget all messages, and begin at time 0."""
        self._filter = Localization(self._config)
        self._newest_time = 0.0  # [s] largest ROS time at which a message has come
        # messages of each input that wait for a transform, oldest first
        self._held_messages: Dict[str, List[Any]] = {name: [] for name in self._config.inputs}
        # [s] wall time of the first message of any input; 0 before this message
        self._first_heard_at = 0.0
        self._heard_inputs: Set[str] = set()  # inputs that have sent any message
        # [s] wall time of the last usable message, by input; an input whose messages are held has no entry
        self._used_at: Dict[str, float] = {}
        # inputs with a message whose thread waits for `_lock`; these inputs are not silent
        self._arriving_inputs: Set[str] = set()

    def _on_message(self, msg: Any, name: str) -> None:
        """Take a message of an input (see `_take`), and note when the input has sent a usable message.

        A message that is ignored or held is not usable. If it counted, the filter would wait forever for the
        readings of an input that sends only such messages. If the clock has gone back by more than
        CLOCK_BACK, the filter starts again before it gets the message.

        Args:
            msg: Odometry or Imu.
            name: name of the input in the parameters, such as odom0.
        """
        self._arriving_inputs.add(name)
        with self._lock:
            self._arriving_inputs.discard(name)
            # the ROS time is read under the lock, because a fast bag may advance by seconds while this thread
            # waits
            now = rospy.get_time()
            if now < self._newest_time - CLOCK_BACK:
                rospy.logwarn(
                    f"clock from {self._newest_time:.3f} back to {now:.3f} s; the filter starts again"
                )
                self._start_filter()
            self._newest_time = max(now, self._newest_time)
            self._heard_inputs.add(name)
            wall_time = time.monotonic()
            if self._first_heard_at == 0.0:  # this is the first message of any input since the start
                self._first_heard_at = wall_time
            fate = self._take(msg, name, now)
            if fate is _Fate.USED:
                self._used_at[name] = wall_time
            elif fate is _Fate.HELD:  # the filter must not wait for the readings that TF holds up
                self._used_at.pop(name, None)

    def _take(self, msg: Any, name: str, now: float) -> _Fate:
        """Give a message to the filter, or hold it until TF has the frame of the sensor, or ignore it.

        Up to QUEUE messages of each input are held. When TF has the frame, the filter gets them before this
        message. A message is ignored if its stamp is more than MAX_AHEAD after the clock, or if the filter
        accepts neither this message nor a held one.

        Args:
            msg: Odometry or Imu.
            name: name of the input.
            now: ROS time [s].
        """
        stamp = msg.header.stamp.to_sec()
        if stamp > now + MAX_AHEAD:
            sentence = f"its stamp is {stamp:.3f} s at {now:.3f} s, so it is ignored"
            self._complain(name, kind="clock", sentence=sentence)
            return _Fate.IGNORED
        held = self._held_messages[name]
        held.append(msg)
        # poses of the frames of this message; None if TF does not have them yet
        mounting = self._mounting(msg, name)
        if mounting is None:
            del held[:-QUEUE]  # only the last QUEUE messages are kept
            return _Fate.HELD
        self._held_messages[name] = []
        # all messages are given to the filter, oldest first; the message of this call is the last
        accepted = [self._add(name, message, mounting) for message in held]
        return _Fate.USED if any(accepted) else _Fate.IGNORED

    def _add(self, name: str, msg: Any, mounting: Mounting) -> bool:
        """Give one reading to the filter, publish new estimates, and return whether the filter accepts it.

        The filter processes the readings of all inputs in the order of their stamps. So it keeps an accepted
        reading until the other inputs have sent later ones, but it does not wait long for a silent input (see
        `_is_silent`). The new estimates may be several, or none while the filter waits.
        """
        others = set(self._config.inputs) - {name}
        silent = {other for other in others if self._is_silent(other, time.monotonic())}
        try:
            estimates = self._filter.add(name, reading_from_msg(msg), mounting, silent)
        except ReadingError as error:
            self._complain(name, kind="reading", sentence=f"{error}, so it is ignored")
            return False
        for estimate in estimates:
            self._publish(estimate)
        return True

    def _publish(self, estimate: MotionEstimate) -> None:
        """Publish an estimate as odometry and, if `publish_tf` is set, as a transform odom -> base_link."""
        odom = self._config.options.odom_frame
        odometry = estimate_to_msg(estimate, odom, self._base_frame)
        publish(self._odometry_publisher, odometry)
        if self._config.options.publish_tf:
            base_in_odom = conversions.pose_from_msg(odometry.pose.pose)
            tree = [(odom, self._base_frame, base_in_odom)]
            publish(self._tf_publisher, conversions.tree_to_msg(tree, estimate.stamp))

    def _is_silent(self, name: str, now: float) -> bool:
        """Return whether an input has sent nothing usable for too long, at the wall time `now` [s]."""
        if name in self._arriving_inputs:
            return False
        if name in self._used_at:
            return now > self._used_at[name] + SILENCE
        # an input whose messages are not usable is silent at once
        return name in self._heard_inputs or now > self._first_heard_at + ABSENCE

    def _mounting(self, msg: Any, name: str) -> Optional[Mounting]:
        """Return where a sensor is mounted: the poses of its frames, in the frames of the filter.

        An IMU has one frame. A message of odometry has two: the frame of its velocities, and the frame of its
        pose. The result is None, with a warning, if TF does not have a frame that the filter needs.
        """
        options, item = self._config.options, self._config.inputs[name]
        sensor = msg.header.frame_id if isinstance(msg, Imu) else msg.child_frame_id
        # the frame of the sensor is always needed, because the measured velocities are in this frame
        sensor_in_base = self._pose(options.base_link_frame, sensor, name)
        if sensor_in_base is None:
            return None
        # `config[:6]` says whether the filter uses x, y, z, roll, pitch and yaw of the pose. With
        # `differential`, the filter uses only the motion from pose to pose, which is the same in every frame.
        needs_pose_frame = isinstance(msg, Odometry) and any(item.config[:6]) and not item.differential
        if not needs_pose_frame:
            return Mounting(sensor_in_base)
        pose_frame_in_odom = self._pose(options.odom_frame, msg.header.frame_id, name)
        if pose_frame_in_odom is None:
            return None
        return Mounting(sensor_in_base, pose_frame_in_odom)

    def _pose(self, parent: str, child: str, name: str) -> Optional[Pose]:
        """Return the pose of a frame in its parent frame; None if TF does not have it.

        Without the pose, a warning about the input `name` is logged. An empty name of the frame means the
        parent frame.
        """
        if child.lstrip("/") in ("", parent):
            return Pose()
        stamped = lookup_transform(self._transforms, parent, child)
        if stamped is None:
            sentence = f"TF has no transform from '{child}' to '{parent}'"
            self._complain(name, kind="transform", sentence=sentence)
            return None
        return conversions.pose_from_transform(stamped)

    def _on_set_pose(self, msg: PoseWithCovarianceStamped) -> None:
        """Set the pose of the filter to the pose in a message of RViz or of a user.

        A pose is ignored with a warning if it is not finite, if it is not in odom, or if its stamp is in the
        future. With a stamp in the future, the filter would drop all readings until that time.
        """
        place = msg.pose.pose.position
        # a quaternion of zeros is not valid, and counts as no turn
        quat = _unit(msg.pose.pose.orientation) or Pose().quat_xyzw
        pose = [place.x, place.y, yaw_from_quat(quat)]
        covariance = _square(msg.pose.covariance)[PLANE]  # (3, 3) covariance of x, y and yaw
        frame, odom = msg.header.frame_id, self._config.options.odom_frame
        now, stamp = rospy.get_time(), msg.header.stamp.to_sec()
        if not np.isfinite([*pose, *covariance.ravel()]).all():
            rospy.logwarn(f"set_pose: {pose} with covariance {covariance.tolist()} is not a valid pose")
        elif frame.lstrip("/") not in ("", odom):
            rospy.logwarn(f"set_pose: the pose is in '{frame}' and is ignored; send it in '{odom}'")
        elif stamp > now + MAX_AHEAD:
            rospy.logwarn(
                f"set_pose: the stamp {stamp:.2f} s is ahead of the clock, {now:.2f} s, and the pose is "
                "ignored; send it with the stamp 0, or with rostopic pub --use-rostime"
            )
        else:
            with self._lock:
                # a stamp of 0 means the present time; after the wait for the lock, `now` may be out of date
                if stamp == 0.0:
                    stamp = rospy.get_time()
                self._filter.set_pose(stamp, np.array(pose), covariance)

    def _complain(self, name: str, kind: str, sentence: str) -> None:
        """Warn of an input, at most once in REPORT_PERIOD for each kind of complaint."""
        complained_at = self._complained_at.get((name, kind), -inf)
        # the difference is negative if the clock has gone back since the last warning
        if abs(self._newest_time - complained_at) >= REPORT_PERIOD:
            self._complained_at[name, kind] = self._newest_time
            rospy.logwarn(f"{rospy.resolve_name(self._config.inputs[name].topic)}: {sentence}")

    def _report_silence(self, _event: Any) -> None:
        """Warn of each input that has sent no message since the start, because its topic may be wrong."""
        for name in sorted(set(self._config.inputs) - self._heard_inputs):
            rospy.logwarn(f"{rospy.resolve_name(self._config.inputs[name].topic)}: no message yet ({name})")


def reading_from_msg(msg: Any) -> Reading:
    """Return the reading of a nav_msgs/Odometry or sensor_msgs/Imu, in the frames of the message."""
    return _reading_of_odometry(msg) if isinstance(msg, Odometry) else _reading_of_imu(msg)


def _reading_of_odometry(msg: Odometry) -> Reading:
    """Return the pose and the velocity of a message of odometry."""
    pose, twist = msg.pose.pose, msg.twist.twist
    # a driver that does not measure the orientation sends zeros as the quaternion; such a robot counts as
    # level, which is the default orientation of a pose
    quat = _unit(pose.orientation) or Pose().quat_xyzw
    return Reading(
        msg.header.stamp.to_sec(),
        pose=Pose(_numbers(pose.position), quat),
        pose_covariance=_square(msg.pose.covariance),
        velocity=np.array([*_numbers(twist.linear), *_numbers(twist.angular)]),
        velocity_covariance=_square(msg.twist.covariance),
    )


def _reading_of_imu(msg: Imu) -> Reading:
    """Return the attitude, the angular velocity and the specific force that an IMU measures.

    By REP 145, an IMU marks a part that it does not measure with a covariance of -1. Such a part is None in
    the reading.
    """
    has_attitude = msg.orientation_covariance[0] != -1.0
    has_rates = msg.angular_velocity_covariance[0] != -1.0
    has_forces = msg.linear_acceleration_covariance[0] != -1.0
    attitude = _unit(msg.orientation) if has_attitude else None  # None for zeros, too
    # linear velocity [m/s] and angular velocity [rad/s]; an IMU measures no linear velocity, so the first
    # three numbers are 0, and the filter does not use them
    velocity = np.array([0.0, 0.0, 0.0, *_numbers(msg.angular_velocity)])
    return Reading(
        msg.header.stamp.to_sec(),
        pose=Pose(quat_xyzw=attitude) if attitude else None,  # an IMU has no position, so it stays 0
        pose_covariance=_covariance_of_angles(msg.orientation_covariance),
        velocity=velocity if has_rates else None,
        velocity_covariance=_covariance_of_angles(msg.angular_velocity_covariance),
        specific_force=np.array(_numbers(msg.linear_acceleration)) if has_forces else None,
        force_covariance=_square(msg.linear_acceleration_covariance),
    )


def estimate_to_msg(estimate: MotionEstimate, odom: str, base: str) -> Odometry:
    """Return an estimate as a message: pose in `odom`, twist in `base`, and the covariances of both."""
    # the last two numbers of the state are the acceleration, which has no field in the message
    x, y, yaw, vx, vy, yaw_rate = estimate.state[:6].tolist()
    planar = PlanarOdometry(Pose2D(x, y, yaw), Twist2D(vx, yaw_rate))
    msg = conversions.odometry_to_msg(planar, estimate.stamp, odom, base)
    msg.twist.twist.linear.y = vy
    # pose and twist, each with the index of its first number in the state: x, y, yaw begin at 0, their rates
    # begin at VX
    for part, first in ((msg.pose, 0), (msg.twist, VX)):
        # (6, 6) covariance of x, y, z, roll, pitch, yaw, or of their rates. The filter estimates only x, y
        # and yaw, whose rows and columns are PLANE. The other variances are OFF_PLANE.
        covariance = OFF_PLANE * np.eye(6)
        covariance[PLANE] = estimate.covariance[first : first + 3, first : first + 3]
        part.covariance = covariance.ravel().tolist()
    return msg


def _numbers(vector: Any) -> Vector3:
    """Return the numbers x, y and z of a message such as Vector3 or Point."""
    return vector.x, vector.y, vector.z


def _unit(quat: Any) -> Optional[Quaternion]:
    """Return the numbers (x, y, z, w) of a Quaternion message, scaled to length 1; None for zeros.

    Zeros mean an unknown orientation. The length is 1 or 0 except for rounding, so any limit between them
    separates both cases.
    """
    length = hypot(quat.x, quat.y, quat.z, quat.w)
    if length < 0.5:
        return None
    return quat.x / length, quat.y / length, quat.z / length, quat.w / length


def _square(numbers: Sequence[float]) -> np.ndarray:
    """Return a square matrix; messages give its numbers row by row."""
    side = isqrt(len(numbers))
    return np.array(numbers).reshape(side, side)


def _covariance_of_angles(numbers: Sequence[float]) -> np.ndarray:
    """Return the covariance (6, 6) of a pose or twist, from the nine numbers for its angles or their rates.

    The part for the position or the linear velocity is 0.
    """
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = _square(numbers)
    return covariance


def main() -> None:
    """Run the node."""
    run_node("ekf_localization", LocalizationNode)
