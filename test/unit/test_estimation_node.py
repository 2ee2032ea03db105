"""The filter's node: poses that it is given by hand."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from husky_highlevel_controller.estimation.filter_config import read_filter_config
from husky_highlevel_controller.ros.estimation import node as node_module
from husky_highlevel_controller.ros.estimation.node import MAX_AHEAD, LocalizationNode

NOW = 12.0  # [s] simulated time


@pytest.mark.parametrize(
    ("stamp", "set_at"), [(0.0, NOW), (11.0, 11.0), (NOW + MAX_AHEAD, NOW + MAX_AHEAD), (1.8e9, None)]
)
def test_a_set_pose_by_another_clock_is_ignored_with_a_warning(stamp, set_at, monkeypatch):
    stamps, warnings = [], []
    monkeypatch.setattr(rospy, "get_time", lambda: NOW)
    monkeypatch.setattr(rospy, "logwarn", warnings.append)
    node = object.__new__(LocalizationNode)  # without its topics
    node._config = SimpleNamespace(options=SimpleNamespace(odom_frame="odom"))
    node._lock = threading.Lock()
    node._filter = SimpleNamespace(set_pose=lambda stamp, *_: stamps.append(stamp))
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = rospy.Time.from_sec(stamp)
    node._on_set_pose(msg)
    assert stamps == ([] if set_at is None else [set_at])
    assert ["set_pose: the stamp 1800000000.00 s is ahead" in each for each in warnings] == [True] * (
        set_at is None
    )


def turns_unreadable(msg, _stamp):
    msg.angular_velocity.z = float("nan")


def runs_ahead(msg, stamp):
    msg.header.stamp = rospy.Time.from_sec(stamp + 2.0 * MAX_AHEAD)


def has_no_stamp(msg, _stamp):
    msg.header.stamp = rospy.Time()


@pytest.mark.parametrize("begin", [0.0, 5.0])
@pytest.mark.parametrize("spoil", [turns_unreadable, runs_ahead, has_no_stamp])
def test_an_imu_whose_messages_are_all_ignored_does_not_stop_the_filter(spoil, begin, monkeypatch):
    now, estimates = [100.0], []
    monkeypatch.setattr(rospy, "get_time", lambda: now[0])
    monkeypatch.setattr(rospy, "logwarn", lambda _: None)
    monkeypatch.setattr(node_module, "time", SimpleNamespace(monotonic=lambda: 5000.0 + now[0]))
    monkeypatch.setattr(node_module, "publish", lambda _, msg: estimates.append(msg))
    node = object.__new__(LocalizationNode)  # without its topics
    only_speed, only_yaw_rate = [6 <= row < 9 for row in range(15)], [row == 11 for row in range(15)]
    inputs = {"odom0": "odom", "odom0_config": only_speed, "imu0": "imu", "imu0_config": only_yaw_rate}
    options = {
        "two_d_mode": True,
        "publish_tf": False,
        "odom_frame": "/odom",
        "base_link_frame": "/base_link",
    }
    node._config, _ = read_filter_config({**inputs, **options}, "/ekf/")
    node._base_frame, node._lock, node._complained_at = "base_link", threading.Lock(), {}
    node._transforms = node._odometry_publisher = node._tf_publisher = None
    node._start_filter()
    for step in range(500):  # 10 s
        now[0] = 100.0 + step / 50.0
        imu = Imu()
        imu.header.frame_id, imu.header.stamp = "base_link", rospy.Time.from_sec(now[0])
        imu.orientation.w = 1.0
        if step / 50.0 >= begin:
            spoil(imu, now[0])
        node._on_message(imu, "imu0")
        odometry = Odometry(child_frame_id="base_link")
        odometry.header.frame_id, odometry.header.stamp = "odom", rospy.Time.from_sec(now[0])
        odometry.pose.pose.orientation.w = odometry.twist.twist.linear.x = 1.0
        odometry.twist.covariance = [0.001 if row % 7 == 0 else 0.0 for row in range(36)]
        node._on_message(odometry, "odom0")
    assert estimates[-1].header.stamp.to_sec() > now[0] - 0.1
    assert estimates[-1].pose.pose.position.x == pytest.approx(10.0, abs=0.2)
    assert (estimates[-1].header.frame_id, estimates[-1].child_frame_id) == ("odom", "base_link")
