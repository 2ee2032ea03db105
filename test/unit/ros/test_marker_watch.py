"""Markers that nothing could place: each is a sample with a problem, and the recording goes on."""

import numpy as np
import pytest
import rospy
import tf2_ros
from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.ros.grading.marker_watch import MarkerWatch


@pytest.fixture
def watch(monkeypatch):
    monkeypatch.setattr(tf2_ros, "TransformListener", lambda buffer: None)  # it would want a ROS master
    return MarkerWatch(lambda: 1.0)


def marker(frame="base_link", **fields):
    made = Marker(type=Marker.SPHERE, action=Marker.ADD, **fields)
    made.header.frame_id, made.color.a, made.pose.orientation.w = frame, 1.0, 1.0
    made.scale.x = made.scale.y = made.scale.z = 0.4
    return made


def samples(watch):
    return watch.samples(np.array([0.0, 2.0]), [Pose(), Pose()], (10.0, 0.0))


@pytest.mark.parametrize("frame", ["a\0b", "no_such_frame", "\udc80"])
@pytest.mark.parametrize("stamp", [0.0, 1.0])
def test_a_frame_that_tf_refuses_costs_its_marker_only(watch, frame, stamp):
    strange = marker(frame)
    strange.header.stamp = rospy.Time.from_sec(stamp)
    watch._on_marker(MarkerArray([strange, marker()]), "/viz")
    first, second = samples(watch)
    assert first.problem
    assert not second.problem
