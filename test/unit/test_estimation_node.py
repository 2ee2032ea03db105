"""The filter's node: poses that it is given by hand."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped

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
