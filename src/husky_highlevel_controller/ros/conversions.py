"""Conversions between this package's records (datatypes.py) and ROS messages.

In and out: records and messages.
"""

from __future__ import annotations

from math import hypot, inf, isfinite, pi
from typing import Iterable, Tuple

import numpy as np
from genpy import Time
from geometry_msgs.msg import (
    Point,
    Quaternion,
    TransformStamped,
    Twist,
    TwistStamped,
    Vector3,
    Vector3Stamped,
)
from geometry_msgs.msg import Pose as PoseMsg
from nav_msgs.msg import Odometry as OdometryMsg
from sensor_msgs.msg import (
    Imu,
    JointState,
    LaserScan,
    MagneticField,
    NavSatFix,
    NavSatStatus,
)
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller.datatypes import (
    GpsFix,
    HuskyError,
    ImuSample,
    MagSample,
    ModelMotion,
    Odometry,
    Pose,
    RobotState,
    Scan,
    Twist2D,
    WheelState,
)
from husky_highlevel_controller.geometry import pose_from_2d
from husky_highlevel_controller.ros.fast_messages import ArrayScan

MIN_INCREMENT = 1e-6  # [rad] a scan with a smaller angle between its beams is not valid
# [rad] the angles of a full turn may exceed 2 pi by this, because they are 32-bit numbers
TURN_TOLERANCE = 0.01
# [m] if even the nearest return is farther than this, the ranges are probably in millimetres
MAX_NEAREST_RETURN = 200.0
MILLIMETRES = (100.0, 60000.0)  # [mm] usual limits of ranges that a driver sends in millimetres by mistake
MAX_RANGE_MAX = 1000.0  # [m] a range_max above this is probably in millimetres

# Covariance of odometry: a (6, 6) matrix, row by row. Its diagonal has the values of
# husky_control/config/control.yaml for x, y, z, roll, pitch and yaw.
ODOMETRY_COVARIANCE = tuple(np.diag([0.001] * 5 + [0.03]).ravel().tolist())


def time_to_msg(seconds: float) -> Time:
    """Return a ROS time, rounded to the nanosecond.

    genpy's own Time.from_sec cuts digits off, so 1.13 s would become 1129999999 ns.
    """
    return Time(*divmod(round(seconds * 1e9), 1_000_000_000))


def header(stamp: float, frame: str) -> Header:
    """Return a message header; the publisher adds the sequence number."""
    return Header(stamp=time_to_msg(stamp), frame_id=frame)


def scan_to_msg(scan: Scan) -> ArrayScan:
    """Return a scan as a LaserScan message.

    A scan of Gazebo's driver has times of 0, and no intensities, so its message has zeros in their place.
    """
    return ArrayScan(
        header=header(scan.stamp, scan.frame),
        angle_min=scan.angle_min,
        angle_max=scan.angle_max,
        angle_increment=scan.angle_increment,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=scan.ranges,
        time_increment=scan.time_increment,
        scan_time=scan.scan_time,
        intensities=np.zeros(len(scan.ranges)) if scan.intensities is None else scan.intensities,
    )


class ScanError(HuskyError):
    """A LaserScan whose beams have no valid directions, or whose ranges are not in metres."""


def scan_from_msg(msg: LaserScan) -> Scan:
    """Return the scan of a LaserScan message, from any driver.

    The angle of the last beam is computed from the increment, because the angle_max of some drivers is one
    step beyond the last beam.

    Raises:
        ScanError: the angles are not valid or more than a full turn, range_min and range_max are not valid
            distances, or the ranges are in millimetres.
    """
    ranges = np.array(msg.ranges, dtype=float)
    ranges.setflags(write=False)  # the array must not change, because it belongs to a record
    _check_geometry(msg, len(ranges))
    # [rad] angle from the first beam to the last; the increment of a scan with one beam may be any number
    angle = msg.angle_increment * (len(ranges) - 1) if len(ranges) > 1 else 0.0
    scan = Scan(
        stamp=msg.header.stamp.to_sec(),
        frame=msg.header.frame_id.lstrip("/"),  # older drivers send a leading slash, which tf2 rejects
        angle_min=msg.angle_min,
        angle_max=msg.angle_min + angle,
        range_min=msg.range_min,
        range_max=msg.range_max,
        ranges=ranges,
        time_increment=msg.time_increment,
        scan_time=msg.scan_time,
    )
    # The ranges are perhaps in millimetres in two cases: range_max is very large, or no range is valid,
    # because all are beyond range_max. Only these scans are checked, because the check takes time.
    if scan.range_max > MAX_NEAREST_RETURN or not scan.valid_count:
        _check_unit(scan)
    return scan


def _check_geometry(msg: LaserScan, beams: int) -> None:
    """Raise ScanError if the angles or the limits of the ranges are not possible for this number of beams."""
    full_turn = 2.0 * pi + TURN_TOLERANCE  # [rad]
    increment = abs(msg.angle_increment)  # [rad]; the increment is negative if the lidar turns clockwise
    problem = ""
    # Some conditions below are written with `not`, because each comparison with NaN is false, and NaN is a
    # problem, too.
    if not isfinite(msg.angle_min):
        problem = f"angle_min = {msg.angle_min} rad"
    elif abs(msg.angle_min) > full_turn:
        problem = f"angle_min = {msg.angle_min:g} rad, more than a turn; check that its angles are in radians"
    # a scan of one beam has no increment
    elif beams > 1 and not MIN_INCREMENT <= increment <= 2.0 * pi:
        limits = f"{MIN_INCREMENT:g} to {2.0 * pi:.2f} rad are possible"
        problem = f"angle_increment = {msg.angle_increment} rad; {limits}"
    # The beams have `beams - 1` steps. The last step may be beyond a full turn, because some drivers send the
    # first beam a second time as the last beam. So only the other `beams - 2` steps are tested.
    elif increment * (beams - 2) > full_turn:
        whole_angle = f"together {increment * (beams - 1):.4g} rad, more than a turn"
        problem = (
            f"angle_increment = {msg.angle_increment:g} rad, {whole_angle}; "
            "check that its angles are in radians"
        )
    elif not 0.0 <= msg.range_min < inf:
        problem = f"range_min = {msg.range_min} m"
    elif not msg.range_max > msg.range_min:
        problem = f"range_max = {msg.range_max} m, and range_min = {msg.range_min:g} m"
    if problem:
        raise ScanError(f"a scan of {beams} beams in '{msg.header.frame_id}' has {problem}")


def _check_unit(scan: Scan) -> None:
    """Raise ScanError if the ranges are in millimetres, and not in metres."""
    measured = scan.ranges[scan.valid]
    # If no range is valid, all positive ranges are examined, because ranges in mm may exceed range_max.
    if not len(measured):
        measured = scan.ranges[np.isfinite(scan.ranges) & (scan.ranges > 0.0)]
        # if all ranges are equal, the beams have met nothing, and the driver marks this by one number
        if not len(measured) or measured.min() == measured.max():
            return
    low, high = measured.min(), measured.max()
    # true if these numbers are usual for ranges in mm, and range_max is too large to be in metres
    smallest_mm, largest_mm = MILLIMETRES
    look_like_mm = scan.range_max > MAX_RANGE_MAX and smallest_mm <= low and high <= largest_mm
    is_nearest_too_far = low > MAX_NEAREST_RETURN  # too far for a lidar, if the ranges are in metres
    if is_nearest_too_far or look_like_mm:
        raise ScanError(
            f"a scan in '{scan.frame}' has ranges from {low:g} to {high:g} m and range_max = "
            f"{scan.range_max:g} m; check that they are in metres"
        )


def twist_to_msg(twist: Twist2D) -> Twist:
    """Return a planar twist as a geometry_msgs/Twist."""
    msg = Twist()
    msg.linear.x, msg.angular.z = twist
    return msg


def twist_from_msg(msg: Twist) -> Twist2D:
    """Return the forward speed and the yaw rate of a Twist; a skid-steer robot cannot follow the rest."""
    return Twist2D(msg.linear.x, msg.angular.z)


def twist_to_stamped_msg(twist: Twist2D, stamp: float) -> TwistStamped:
    """Return a planar twist with its time, and without a frame, as diff_drive_controller publishes it."""
    return TwistStamped(header=header(stamp, ""), twist=twist_to_msg(twist))


def wheels_to_msg(wheels: WheelState, stamp: float) -> JointState:
    """Return the angles, speeds and efforts of the wheels as a message for joint_states."""
    return JointState(
        header=header(stamp, ""),
        name=wheels.names,
        position=wheels.angles,
        velocity=wheels.speeds,
        effort=wheels.efforts,
    )


def odometry_to_msg(odometry: Odometry, stamp: float, odom: str, base: str) -> OdometryMsg:
    """Return odometry as a message, with the pose in the frame `odom` and the twist in the frame `base`."""
    msg = _odometry(stamp, odom, base, pose_from_2d(odometry.pose_base_in_odom))
    msg.twist.twist = twist_to_msg(odometry.twist_in_base)
    msg.pose.covariance = msg.twist.covariance = ODOMETRY_COVARIANCE
    return msg


def truth_to_msg(robot: RobotState, stamp: float, world: str, base: str) -> OdometryMsg:
    """Return the true pose in the frame `world` and the true twist in the frame `base` as a message.

    The covariances are 0, because both are exact.
    """
    msg = _odometry(stamp, world, base, robot.pose_in_world)
    msg.twist.twist = Twist(Vector3(*robot.velocity_in_base), Vector3(*robot.angular_velocity_in_base))
    return msg


def _odometry(stamp: float, frame: str, child: str, pose: Pose) -> OdometryMsg:
    """Return an Odometry message with header and pose; its twist and its covariances are zeros."""
    msg = OdometryMsg(header=header(stamp, frame), child_frame_id=child)
    msg.pose.pose = pose_to_msg(pose)
    return msg


def tree_to_msg(branches: Iterable[Tuple[str, str, Pose]], stamp: float) -> TFMessage:
    """Return a message for /tf; each branch has the parent frame, the child frame, and the child's pose."""
    return TFMessage([transform_to_msg(pose, stamp, parent, child) for parent, child, pose in branches])


def transform_to_msg(pose_child_in_parent: Pose, stamp: float, parent: str, child: str) -> TransformStamped:
    """Return the pose of a child frame in its parent frame as a transform of TF."""
    msg = TransformStamped(header=header(stamp, parent), child_frame_id=child)
    msg.transform.translation = Vector3(*pose_child_in_parent.position)
    msg.transform.rotation = Quaternion(*pose_child_in_parent.quat_xyzw)
    return msg


def pose_from_transform(msg: TransformStamped) -> Pose:
    """Return the pose of the child frame in the parent frame."""
    t, r = msg.transform.translation, msg.transform.rotation
    return Pose((t.x, t.y, t.z), (r.x, r.y, r.z, r.w))


def pose_to_msg(pose: Pose) -> PoseMsg:
    """Return a pose in space as a message."""
    return PoseMsg(Point(*pose.position), Quaternion(*pose.quat_xyzw))


def pose_from_msg(msg: PoseMsg) -> Pose:
    """Return the pose of a message; its numbers are not checked, so they may be NaN."""
    p, q = msg.position, msg.orientation
    return Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def motion_to_msg(motion: ModelMotion) -> Tuple[PoseMsg, Twist]:
    """Return a model's pose and velocity as two messages; both are in the frame of the motion."""
    return pose_to_msg(motion.pose), Twist(Vector3(*motion.velocity), Vector3(*motion.angular_velocity))


def motion_from_msg(pose: PoseMsg, twist: Twist) -> ModelMotion:
    """Return a model's pose and velocity from two messages; the numbers are not checked."""
    v, w = twist.linear, twist.angular
    return ModelMotion(pose_from_msg(pose), (v.x, v.y, v.z), (w.x, w.y, w.z))


# ---------------------------------------------------------------------------- IMU

# Covariance of the orientation, as the Husky's Gazebo plugin publishes it. The variance of roll and pitch is
# (0.005 / 9.8)^2, from the noise of the accelerometer. The covariances of rates and accelerations are all 0,
# which means unknown (REP 145).
IMU_ORIENTATION_COVARIANCE = tuple(np.diag([(0.005 / 9.8) ** 2] * 2 + [0.0]).ravel().tolist())
NO_ORIENTATION = (-1.0, *[0.0] * 8)  # covariance of an IMU that does not measure its orientation (REP 145)


def imu_to_msg(sample: ImuSample, frame: str) -> Imu:
    """Return an IMU sample, whose numbers are along the axes of `frame`, as a message."""
    return Imu(
        header=header(sample.stamp, frame),
        orientation=Quaternion(*sample.quat_xyzw),
        orientation_covariance=IMU_ORIENTATION_COVARIANCE,
        angular_velocity=Vector3(*sample.angular_velocity),
        linear_acceleration=Vector3(*sample.specific_force),
    )


def imu_to_raw_msg(sample: ImuSample, frame: str) -> Imu:
    """Return an IMU sample as a message without an orientation, as drivers send raw samples (REP 145)."""
    msg = imu_to_msg(sample, frame)
    msg.orientation = Quaternion()
    msg.orientation_covariance = NO_ORIENTATION
    return msg


def mag_to_msg(sample: MagSample, frame: str) -> MagneticField:
    """Return a magnetometer's reading, along the axes of `frame`, as a message; its covariance is unknown."""
    return MagneticField(header=header(sample.stamp, frame), magnetic_field=Vector3(*sample.field))


def imu_from_msg(msg: Imu) -> ImuSample:
    """Return the sample of any IMU; an IMU that does not measure its orientation counts as level."""
    q, w, f = msg.orientation, msg.angular_velocity, msg.linear_acceleration
    length = hypot(q.x, q.y, q.z, q.w)
    # REP 145 marks a missing orientation by a covariance of -1; some drivers send a quaternion of zeros or
    # NaN instead, for which `length > 0.5` is false
    has_orientation = msg.orientation_covariance[0] != -1.0 and length > 0.5
    quat = (0.0, 0.0, 0.0, 1.0)
    if has_orientation:
        quat = (q.x / length, q.y / length, q.z / length, q.w / length)
    return ImuSample(msg.header.stamp.to_sec(), quat, (w.x, w.y, w.z), (f.x, f.y, f.z))


# ---------------------------------------------------------------------------- GPS


def fix_to_msg(fix: GpsFix, drift: float, frame: str) -> NavSatFix:
    """Return a GPS fix as a message; its variance is the square of `drift` [m], as in hector_gazebo."""
    return NavSatFix(
        header=header(fix.stamp, frame),
        status=NavSatStatus(status=NavSatStatus.STATUS_FIX),
        latitude=fix.latitude,
        longitude=fix.longitude,
        altitude=fix.altitude,
        position_covariance=tuple(np.diag([drift**2] * 3).ravel().tolist()),
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN,
    )


def fix_velocity_to_msg(fix: GpsFix, frame: str) -> Vector3Stamped:
    """Return the velocity of a GPS fix, towards north, west and up, as a message.

    `frame` is the frame of the receiver, although the numbers are not along its axes.
    """
    return Vector3Stamped(header=header(fix.stamp, frame), vector=Vector3(*fix.velocity))
