"""The guards trust only the newest odometry and scan, and only while they are fresh."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

import rospy
from nav_msgs.msg import Odometry

from husky_highlevel_controller.controller.safety import ProximityConfig
from husky_highlevel_controller.datatypes import Twist2D
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.safety import proximity_stop
from husky_highlevel_controller.ros.safety.guard import Guard, ServiceConfig


def guard_with_odometry(stamp):
    guard = Guard.__new__(Guard)  # without a master
    msg = Odometry(header=conversions.header(stamp, "odom"))
    msg.twist.twist = conversions.twist_to_msg(Twist2D(0.5, 0.1))
    guard._odometry, guard._pass_on = None, None
    guard._on_odometry(msg)
    return guard


@pytest.mark.parametrize(
    ("age", "fresh"), [(0.0, True), (0.4, True), (-0.4, True), (0.6, False), (-0.6, False)]
)
def test_a_velocity_older_than_half_a_second_is_unknown(age, fresh):
    assert guard_with_odometry(10.0).twist(10.0 + age) == (Twist2D(0.5, 0.1) if fresh else None)


def test_without_odometry_the_velocity_is_unknown():
    guard = Guard.__new__(Guard)
    guard._odometry = None
    assert guard.twist(1.0) is None


def test_only_the_newest_odometry_and_scan_are_judged(monkeypatch):
    """A queue would let a guard that is late stop the robot for where it was."""
    queues = {}

    def subscribe(topic, _kind, _callback, queue_size, **_how):
        queues[topic] = queue_size

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(rospy, "get_param", lambda *_: {**vars(ServiceConfig()), **vars(ProximityConfig())})
    monkeypatch.setattr(proximity_stop.tf2_ros, "Buffer", object)
    monkeypatch.setattr(proximity_stop.tf2_ros, "TransformListener", lambda _: None)
    proximity_stop.ProximityStopNode()
    assert queues == {"odometry/filtered": 1, "front/scan": 1}
