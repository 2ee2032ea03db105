"""The border: what goes into a message comes out of it, also over the wire."""

from io import BytesIO
from math import inf, nan, pi

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion, Twist, Vector3
from hypothesis import example, given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry as OdometryMsg
from sensor_msgs.msg import Imu, LaserScan

from husky_highlevel_controller.datatypes import (
    ImuSample,
    Odometry,
    Pose,
    Pose2D,
    RobotState,
    Scan,
    Twist2D,
    WheelState,
)
from husky_highlevel_controller.estimation.planar_ekf import MotionEstimate
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.estimation.node import estimate_to_msg, reading_from_msg

numbers = st.floats(-1e6, 1e6)
stamps = st.integers(0, 10**15).map(lambda ns: ns * 1e-9)  # [s], up to eleven days


def over_the_wire(msg):
    """The message as another node gets it."""
    buffer = BytesIO()
    msg.serialize(buffer)
    return type(msg)().deserialize(buffer.getvalue())


def xyz(it):
    return it.x, it.y, it.z


def xyzw(it):
    return it.x, it.y, it.z, it.w


# ---------------------------------------------------------------------------- time


@given(st.integers(0, 10**7), st.sampled_from([50, 100, 200, 240, 1000]))
def test_a_stamp_is_the_nearest_nanosecond_so_that_steps_never_drift(step, rate):
    stamp = conversions.time_to_msg(step / rate)
    assert stamp.to_nsec() == round(step * 10**9 / rate)
    assert 0 <= stamp.nsecs < 10**9
    stamp = conversions.time_to_msg(step + 1.9999999999)
    assert (stamp.secs, stamp.nsecs) == (step + 2, 0), "a hair below a full second"


# ---------------------------------------------------------------------------- scans

readings = st.one_of(st.floats(0.11, 29.9), st.sampled_from([inf, -inf, nan, 0.1, 30.0]))


@given(stamps, st.lists(readings, min_size=2, max_size=50), st.floats(-3.1, 0.0), st.floats(0.1, 3.1))
@example(0.0, [inf] * 720, -2.35619, 2.35619)  # the Husky's
def test_a_scan_survives_the_wire(stamp, ranges, angle_min, angle_max):
    scan = Scan(stamp, "front_laser", angle_min, angle_max, 0.1, 30.0, np.array(ranges))
    got = conversions.scan_from_msg(over_the_wire(conversions.scan_to_msg(scan)))
    assert got.stamp == pytest.approx(stamp, abs=1e-9)
    assert got.frame == "front_laser"
    # LaserScan carries 32-bit floats
    np.testing.assert_allclose(got.ranges, scan.ranges, rtol=1e-6)
    np.testing.assert_allclose(got.bearings, scan.bearings, atol=1e-6)
    assert np.array_equal(got.valid, scan.valid)


def test_valid_beams_are_those_within_the_range_limits_and_range_max_is_a_miss():
    ranges = np.array([0.1, 1.0, 29.999, 30.0, 0.0999, 30.001, inf, -inf, nan, 0.0, -1.0])
    scan = Scan(0.0, "front_laser", -2.35619, 2.35619, 0.1, 30.0, ranges)
    assert scan.valid.tolist() == [True] * 3 + [False] * 8


def test_a_scan_message_has_the_fields_of_gazebo_s_lidar():
    scan = Scan(1.5, "front_laser", -1.0, 1.0, 0.1, 30.0, np.array([1.0, inf, 3.0]))
    msg = over_the_wire(conversions.scan_to_msg(scan))
    assert (msg.header.frame_id, msg.header.stamp.to_sec()) == ("front_laser", 1.5)
    assert (msg.time_increment, msg.scan_time) == (0.0, 0.0)
    assert list(msg.intensities) == [0.0, 0.0, 0.0]
    assert (msg.angle_min, msg.angle_max, msg.angle_increment) == (-1.0, 1.0, 1.0)
    assert (msg.range_min, msg.range_max) == (pytest.approx(0.1), 30.0)


def test_a_lidar_that_miscounts_its_last_angle_is_believed_in_its_increment():
    # drivers differ in whether angle_max is that of the last beam or one step beyond
    msg = LaserScan(angle_min=-1.0, angle_max=1.0, angle_increment=0.5, range_max=9.0, ranges=[1.0] * 4)
    assert conversions.scan_from_msg(msg).bearings == pytest.approx([-1.0, -0.5, 0.0, 0.5])


@pytest.mark.parametrize("ranges", [[], [1.0]])
def test_a_scan_without_a_step_between_beams_is_read_all_the_same(ranges):
    msg = LaserScan(angle_min=0.25, angle_max=0.25, angle_increment=0.0, range_max=30.0, ranges=ranges)
    msg.header.frame_id = "/base_laser"
    scan = conversions.scan_from_msg(msg)
    assert scan.frame == "base_laser", "which tf2 knows"
    with pytest.raises(ValueError, match="read-only"):
        scan.ranges[:] = 0.0
    assert scan.bearings.tolist() == [0.25] * len(ranges)
    assert scan.angle_increment == 0.0
    assert scan.ranges.tolist() == ranges


def scan_msg(ranges=(1.0, 2.0), angle_increment=0.1, range_min=0.1, range_max=30.0, **more):
    return LaserScan(
        ranges=list(ranges), angle_increment=angle_increment, range_min=range_min, range_max=range_max, **more
    )


SHORTEST_RANGE = r"range_max = \S+ m, and range_min = 0.1 m"
MILLIMETRES = "check that they are in metres"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        *[
            ({"angle_increment": step, "ranges": [1.0] * 9}, "9 beams in '' has angle_increment = ")
            for step in (nan, inf, -inf, 0.0, 5e-324, 1e-12, 7.0)
        ],
        *[({"angle_min": angle}, "angle_min = ") for angle in (nan, inf, -inf)],
        *[({"range_min": shortest}, "range_min = ") for shortest in (nan, -inf, inf, -1.0)],
        *[({"range_max": longest}, SHORTEST_RANGE) for longest in (nan, 0.0, -inf, 0.1)],
        # in degrees
        ({"angle_min": -135.0, "ranges": [1.0] * 541}, "angle_min = -135 rad.* in radians"),
        ({"angle_increment": 0.5, "ranges": [1.0] * 541}, "together 270 rad.* in radians"),
        ({"angle_increment": -0.5, "ranges": [1.0] * 541}, "together 270 rad.* in radians"),
        ({"range_max": 20000.0, "ranges": [650.0, 12000.0, 0.0]}, MILLIMETRES),
        ({"range_max": 20000.0, "ranges": [150.0, 3000.0]}, MILLIMETRES),
        ({"range_max": 20.0, "ranges": [650.0, 12000.0]}, MILLIMETRES),
        ({"range_max": 500.0, "ranges": [300.0]}, MILLIMETRES),
    ],
)
def test_a_scan_that_cannot_be_is_refused_with_a_sentence(change, words):
    with pytest.raises(conversions.ScanError, match=words):
        conversions.scan_from_msg(scan_msg(**change))


FULL_TURN = 2.0 * pi / 360.0  # [rad] between beams


@pytest.mark.parametrize(
    "change",
    [
        {"angle_increment": FULL_TURN, "ranges": [1.0] * 360},
        {"angle_increment": -FULL_TURN, "ranges": [1.0] * 361},  # the first beam is sent twice
        # misses and far ranges are not in millimetres
        {"range_max": 20.0, "ranges": [65.5, 65.5]},
        {"range_max": 20.0, "ranges": [655.35, 655.35]},
        {"range_max": inf, "ranges": [4.0, 30.0]},
        {"range_max": 20000.0, "ranges": [4.0, 900.0]},
        {"range_max": 300.0, "ranges": [inf]},
    ],
)
def test_an_unusual_scan_is_taken_as_it_is(change):
    msg = over_the_wire(scan_msg(**change))
    scan = conversions.scan_from_msg(msg)
    assert scan.ranges == pytest.approx(change["ranges"])


# ---------------------------------------------------------------------------- motion


@given(st.builds(Twist2D, numbers, numbers))
def test_a_twist_survives_the_wire_and_has_only_what_a_skid_steer_robot_can_follow(twist):
    msg = conversions.twist_to_msg(twist)
    assert msg == Twist(Vector3(twist.linear, 0.0, 0.0), Vector3(0.0, 0.0, twist.angular))
    msg.linear.y = msg.linear.z = msg.angular.x = msg.angular.y = 9.0
    assert conversions.twist_from_msg(over_the_wire(msg)) == twist


@given(stamps, st.tuples(numbers, numbers, numbers), st.tuples(*[st.floats(-4.0, 4.0)] * 3))
def test_a_pose_survives_the_wire_as_a_transform(stamp, position, rpy):
    pose = Pose(position, quat_from_rpy(*rpy))
    msg = over_the_wire(conversions.transform_to_msg(pose, stamp, "odom", "base_link"))
    assert conversions.pose_from_transform(msg) == pose
    assert (msg.header.frame_id, msg.child_frame_id) == ("odom", "base_link")
    assert msg.header.stamp.to_sec() == pytest.approx(stamp, abs=1e-9)
    tree = over_the_wire(conversions.tree_to_msg([("odom", "base_link", pose)], stamp))
    assert tree.transforms == [msg]


def assert_is_odometry(msg, frame, position, quat_xyzw, linear, angular):
    assert (msg.header.frame_id, msg.child_frame_id, msg.header.stamp.to_sec()) == (frame, "base_link", 2.5)
    assert (xyz(msg.pose.pose.position), xyzw(msg.pose.pose.orientation)) == (position, quat_xyzw)
    assert (xyz(msg.twist.twist.linear), xyz(msg.twist.twist.angular)) == (linear, angular)


def test_odometry_is_a_pose_in_odom_and_a_twist_in_base_with_the_husky_s_covariance():
    odometry, yaw = Odometry(Pose2D(1.0, 2.0, 0.5), Twist2D(0.3, -0.4)), quat_from_rpy(0.0, 0.0, 0.5)
    msg = over_the_wire(conversions.odometry_to_msg(odometry, 2.5, "odom", "base_link"))
    assert_is_odometry(msg, "odom", (1.0, 2.0, 0.0), yaw, (0.3, 0.0, 0.0), (0.0, 0.0, -0.4))
    # husky_control 0.6.10, control.yaml
    for covariance in (msg.pose.covariance, msg.twist.covariance):
        assert np.array_equal(np.reshape(covariance, (6, 6)), np.diag([0.001] * 5 + [0.03]))


def test_the_truth_is_told_in_all_six_dimensions():
    pose = Pose((1.0, 2.0, 3.0), quat_from_rpy(0.1, 0.2, 0.3))
    robot = RobotState(pose, (0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    msg = over_the_wire(conversions.truth_to_msg(robot, 2.5, "world", "base_link"))
    assert_is_odometry(msg, "world", *pose, (0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    assert set(msg.pose.covariance) == set(msg.twist.covariance) == {0.0}


def test_joint_states_keep_each_wheel_s_numbers_with_its_name():
    wheels = WheelState(("front_left_wheel", "front_right_wheel"), (1.0, 2.0), (3.0, 4.0), (5.0, 6.0))
    msg = over_the_wire(conversions.wheels_to_msg(wheels, 2.5))
    assert msg.header.stamp.to_sec() == 2.5
    assert list(zip(msg.name, msg.position, msg.velocity, msg.effort)) == [
        ("front_left_wheel", 1.0, 3.0, 5.0),
        ("front_right_wheel", 2.0, 4.0, 6.0),
    ]


# ---------------------------------------------------------------------------- IMU

LEVEL = (0.0, 0.0, 0.0, 1.0)


@given(st.builds(quat_from_rpy, *[st.floats(-pi, pi)] * 3))
def test_an_imu_s_sample_survives_the_wire(quat):
    sample = ImuSample(2.5, quat, (0.1, 0.2, 0.3), (0.4, 0.5, 9.8))
    msg = over_the_wire(conversions.imu_to_msg(sample, "base_link"))
    assert (msg.header.frame_id, msg.header.stamp.to_sec()) == ("base_link", 2.5)
    got = conversions.imu_from_msg(msg)
    assert (got.stamp, got.angular_velocity, got.specific_force) == (2.5, (0.1, 0.2, 0.3), (0.4, 0.5, 9.8))
    assert got.quat_xyzw == pytest.approx(quat, abs=1e-12)
    # as the Husky publishes them
    covariance = np.diag([(0.005 / 9.8) ** 2, (0.005 / 9.8) ** 2, 0.0])
    assert np.reshape(msg.orientation_covariance, (3, 3)) == pytest.approx(covariance)
    assert set(msg.angular_velocity_covariance) == set(msg.linear_acceleration_covariance) == {0.0}


@pytest.mark.parametrize(
    ("quat", "first_covariance", "taken"),
    [
        ((0.0, 0.0, 0.0, 0.0), 0.0, LEVEL),  # it does not know how it stands
        ((nan, nan, nan, nan), 0.0, LEVEL),
        ((0.6, 0.0, 0.0, 0.8), -1.0, LEVEL),
        ((0.0, 0.0, 0.7, 0.7), 0.0, (0.0, 0.0, 0.5**0.5, 0.5**0.5)),  # not quite normed
    ],
)
def test_an_imu_s_orientation_is_a_rotation_or_level(quat, first_covariance, taken):
    msg = Imu()
    msg.orientation.x, msg.orientation.y, msg.orientation.z, msg.orientation.w = quat
    msg.orientation_covariance[0] = first_covariance
    assert conversions.imu_from_msg(msg).quat_xyzw == pytest.approx(taken)


# ---------------------------------------------------------------------------- readings of the filter


def test_a_part_that_an_imu_does_not_measure_is_none():
    msg = Imu(angular_velocity=Vector3(0.1, 0.2, 0.3), angular_velocity_covariance=np.arange(9.0).tolist())
    msg.orientation_covariance = msg.linear_acceleration_covariance = [-1.0] + [0.0] * 8
    msg.orientation.w = 1.0
    reading = reading_from_msg(msg)
    assert reading.pose is None
    assert reading.specific_force is None
    assert reading.velocity.tolist() == [0.0, 0.0, 0.0, 0.1, 0.2, 0.3]
    assert reading.velocity_covariance[3:, 3:].ravel().tolist() == np.arange(9.0).tolist()


@pytest.mark.parametrize(("quaternion", "expected"), [((0, 0, 0, 0), None), ((0, 0, 0, 2), (0, 0, 0, 1))])
def test_a_quaternion_of_zeros_is_no_attitude_and_a_long_one_is_shortened(quaternion, expected):
    pose = reading_from_msg(Imu(orientation=Quaternion(*quaternion))).pose
    assert (pose and pose.quat_xyzw) == expected


def test_an_estimate_says_where_how_fast_and_how_sure():
    msg = estimate_to_msg(MotionEstimate(1.5, np.arange(8.0), np.diag(np.arange(1.0, 9.0))), "odom", "base")
    assert (msg.header.stamp.to_sec(), msg.header.frame_id, msg.child_frame_id) == (1.5, "odom", "base")
    assert (msg.pose.pose.position.x, msg.pose.pose.position.y) == (0.0, 1.0)
    assert (msg.twist.twist.linear.x, msg.twist.twist.linear.y, msg.twist.twist.angular.z) == (3.0, 4.0, 5.0)
    assert np.diag(np.reshape(msg.pose.covariance, (6, 6))).tolist() == [1, 2, 1e-6, 1e-6, 1e-6, 3]
    assert np.diag(np.reshape(msg.twist.covariance, (6, 6))).tolist() == [4, 5, 1e-6, 1e-6, 1e-6, 6]
    assert reading_from_msg(OdometryMsg(pose=msg.pose, twist=msg.twist)).velocity[5] == 5.0
