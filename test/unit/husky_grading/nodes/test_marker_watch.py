"""Markers as RViz would draw them, or not; what a submission sends costs the recorder a bounded memory."""

import tracemalloc
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
import tf2_ros
from geometry_msgs.msg import Point, TransformStamped
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from husky_grading.nodes.marker_watch import (
    MAX_ALL_POINTS,
    MAX_MESSAGE,
    MAX_TOPICS,
    MarkerWatch,
)
from husky_highlevel_controller.datatypes import Pose


@pytest.fixture
def watch(monkeypatch):
    monkeypatch.setattr(tf2_ros, "TransformListener", lambda buffer: None)  # it would want a ROS master
    return MarkerWatch(lambda: 1.0, [str(Path(__file__).parents[1])])


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
    assert first.problem == f"there is no frame {frame!r}"
    assert not first.has_frame
    assert (second.problem, second.has_frame) == ("", True)


def test_a_marker_in_a_frame_of_tf_is_placed(watch):
    laser = TransformStamped(child_frame_id="front_laser")
    laser.header.frame_id, laser.transform.translation.x, laser.transform.rotation.w = "base_link", 0.5, 1.0
    watch._buffer.set_transform_static(laser, "")
    watch.add([marker("front_laser"), marker("base_laser")], "/viz")
    first, second = samples(watch)
    assert (first.problem, first.position[0]) == ("", pytest.approx(0.5))
    assert second.problem == "there is no frame 'base_laser'"


def test_messages_that_are_no_markers_are_counted_and_end_nothing(watch):
    whole = BytesIO()
    marker().serialize(whole)
    for content in (b"junkjunk\xff\xff\xff\xff", whole.getvalue()[:50], whole.getvalue()):
        watch._on_message(SimpleNamespace(_buff=content), ("/viz", Marker))
    assert len(samples(watch)) == 1
    (note,) = watch.notes
    assert note.text == "2 messages on /viz are not of its type, so they are ignored"


POINTS = [Point(10.0, 0.0, 0.0)] * 4
MESH = str(Path(__file__).relative_to(Path(__file__).parents[1]))  # as if its folder were a package
CLEAR = ColorRGBA(1.0, 0.0, 0.0, 0.0)
OWN_COLORS = {
    "type": Marker.MESH_RESOURCE, "mesh_resource": f"package://{MESH}", "mesh_use_embedded_materials": True
}  # fmt: skip


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"type": Marker.SPHERE_LIST}, "it has no points"),
        ({"type": Marker.LINE_STRIP, "points": POINTS[:1]}, "it has no points"),
        ({"type": 77}, "its type 77 is not a type of"),
        ({"type": Marker.POINTS, "points": POINTS, "colors": [CLEAR] * 4}, "its alpha is 0"),
        ({**OWN_COLORS, "color": ColorRGBA()}, ""),
        ({**OWN_COLORS, "color": CLEAR}, "its alpha is 0"),
        ({**OWN_COLORS, "color": ColorRGBA(), "mesh_use_embedded_materials": False}, "its alpha is 0"),
        ({"type": Marker.TEXT_VIEW_FACING}, "its text is empty"),
        *[
            ({"type": Marker.MESH_RESOURCE, "mesh_resource": address}, "its mesh does not exist")
            for address in (
                "pillar.dae",
                "file:///no/such.dae",
                "file:///etc/passwd",
                "package://husky_highlevel_controller/../../../../../../../../../../../etc/passwd",
                "package://no_such_package/pillar.dae",
                "package://husky_highlevel_controller/no_such.dae",
                "http://127.0.0.1/pillar.dae",
            )
        ],
        ({"type": Marker.MESH_RESOURCE, "mesh_resource": f"package://{MESH}"}, ""),
        ({"type": Marker.MESH_RESOURCE, "mesh_resource": f"file://{Path(__file__)}"}, ""),
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


@pytest.fixture
def kept():
    """Returns how many bytes were allocated and not freed since the test began."""
    tracemalloc.start()
    yield lambda: tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()


def test_millions_of_points_are_not_kept(watch, kept):
    many = [marker(id=number) for number in range(500)]
    for each in many:
        each.type, each.points = Marker.POINTS, [Point()] * 5000
    watch.add(many, "/viz")
    del each, many
    assert 8 * MAX_ALL_POINTS < kept() < 12 * MAX_ALL_POINTS, "bytes, of 5 times as many"


def test_long_names_and_many_topics_are_not_kept(watch, kept, monkeypatch):
    watch.add([marker(**{each: each * 100_000 for each in ("ns", "text", "mesh_resource")})], "/viz")
    watch.add([marker("f" * 100_000)], "/viz")
    assert kept() < 100_000
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    watch.follow("/" + "v" * 100_000, "visualization_msgs/Marker")
    assert not watch.topics, "RViz's displays are compared up to 200 letters"
    for number in range(1000):
        watch.follow(f"/viz_{number}", "visualization_msgs/Marker")
    assert len(watch.topics) == MAX_TOPICS


def test_a_message_of_many_megabytes_is_not_taken_apart(watch, monkeypatch):
    receive = []

    def subscribe(_topic, _kind, call, source, **_):
        receive.append(lambda raw: call(raw, source))

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    watch.follow("/viz", "visualization_msgs/MarkerArray")
    assert watch.types == {"/viz": "visualization_msgs/MarkerArray"}
    raw = rospy.AnyMsg()
    raw._buff = bytes(MAX_MESSAGE + 1)
    receive[0](raw)
    (seen,) = samples(watch)
    assert (seen.namespace, bool(seen.problem)) == (f"larger than {MAX_MESSAGE} bytes", True)
