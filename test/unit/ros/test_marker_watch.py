"""Markers as RViz would draw them, or not; what a submission sends costs the recorder a bounded memory."""

import numpy as np
import pytest
import rospy
import tf2_ros
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.ros.grading.marker_watch import MAX_ALL_POINTS, MAX_MESSAGE, MarkerWatch


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
    watch.add([strange, marker()], "/viz")
    first, second = samples(watch)
    assert first.problem
    assert not second.problem


POINTS = [Point(10.0, 0.0, 0.0)] * 4
CLEAR = ColorRGBA(1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"type": Marker.SPHERE_LIST}, "it has no points"),
        ({"type": Marker.LINE_STRIP, "points": POINTS[:1]}, "it has no points"),
        ({"type": 77}, "its type 77 is none of"),
        ({"type": Marker.POINTS, "points": POINTS, "colors": [CLEAR] * 4}, "its alpha is 0"),
        ({"type": Marker.TEXT_VIEW_FACING}, "its text is empty"),
        ({"type": Marker.MESH_RESOURCE, "mesh_resource": "pillar.dae"}, "its mesh_resource is no address"),
        ({"type": Marker.MESH_RESOURCE, "mesh_resource": "file:///no/such.dae"}, "its mesh does not exist"),
        ({"type": Marker.SPHERE_LIST, "points": POINTS}, ""),
        ({"type": Marker.CUBE, "colors": [CLEAR]}, ""),
        ({"type": Marker.TEXT_VIEW_FACING, "text": "pillar"}, ""),
    ],
)
def test_what_rviz_does_not_draw_is_not_to_be_seen(watch, fields, problem):
    made = marker()
    for name, value in fields.items():
        setattr(made, name, value)
    watch.add([made], "/viz")
    (seen,) = samples(watch)
    assert problem in seen.problem
    assert bool(problem) == bool(seen.problem)


def test_millions_of_points_are_not_kept(watch):
    many = [marker() for _ in range(2000)]
    for number, each in enumerate(many):
        each.type, each.id, each.points = Marker.POINTS, number, [Point()] * 5000
    watch.add(many, "/viz")
    assert sum(len(message.marker.points) for message in watch._messages) <= MAX_ALL_POINTS


def test_a_message_of_many_megabytes_is_not_taken_apart(watch):
    raw = rospy.AnyMsg()
    raw._buff = bytes(MAX_MESSAGE + 1)
    watch._on_message(raw, ("/viz", MarkerArray))
    (seen,) = samples(watch)
    assert (seen.namespace, bool(seen.problem)) == (f"larger than {MAX_MESSAGE} bytes", True)
