"""The scene as a whole: what it shows of messages, and when."""

from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
import viser
from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import LaserScan
from std_msgs.msg import ColorRGBA
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.ros.controller.display import PATH, marker
from husky_web import drawing
from husky_web.legend import TRAIL_COLOR
from husky_web.scene import FADE_BEGINS, FADE_ENDS, FADED_COLOR, Scene, trail_colors


@pytest.fixture(autouse=True)
def ros_time(monkeypatch):
    """ROS time [s] that the scene reads; a test sets the item "now"."""
    time = {"now": 30.0}
    monkeypatch.setattr(rospy, "get_time", lambda: time["now"])
    return time


@pytest.fixture
def server():
    server = viser.ViserServer("127.0.0.1", verbose=False)
    yield server
    server.stop()


def incoming(**messages):
    """Topics with messages by their use."""
    return SimpleNamespace(
        names={"scan": "/scan", "cloud": "/cloud"},
        take=messages.get,
        take_all=lambda use: messages.get(use, []),
    )


def test_what_cannot_be_drawn_is_told_once_and_the_rest_is_drawn(server, monkeypatch):
    told = []
    monkeypatch.setattr(drawing, "_warned", set())
    monkeypatch.setattr(drawing.rospy, "logwarn", told.append)
    scene = Scene(server, "odom", "/controller")
    good, colorless, mesh = (marker(Marker.CUBE, PATH, 0.0, "odom", (1.0, 1.0, 1.0)) for _ in range(3))
    colorless.ns, colorless.color = "colorless", ColorRGBA(nan, 1.0, 1.0, 1.0)
    mesh.ns, mesh.type, mesh.mesh_resource = "mesh", Marker.MESH_RESOURCE, "file:///etc/hostname"
    markers = [("/hostile", each) for each in (colorless, mesh, good)]
    away = TransformStamped(good.header, "base_link", Transform(Vector3(x=inf), Quaternion(w=1.0)))
    tf, scan = [("/tf", TFMessage([away]))], LaserScan(ranges=[1.0, 1.0])
    for _ in range(3):
        scene.update(incoming(markers=markers, tf=tf, scan=scan))
    assert [text.partition(" is not shown: ")[0] for text in told] == ["/scan", "a marker of /hostile"]
    assert server.scene.get_handle_by_name(f"/markers/%2Fhostile/{PATH}_0").visible
    assert scene.base is None, "no place is infinitely far"


def test_a_lifetime_of_a_marker_ends_by_ros_time(server, ros_time):
    scene = Scene(server, "odom", "/controller")
    short = marker(Marker.CUBE, PATH, 30.0, "odom", (1.0, 1.0, 1.0))
    short.lifetime = rospy.Duration(0.5)
    scene.update(incoming(markers=[("/any", short)]))
    scene.update(incoming())
    assert len(scene.markers.shown) == 1, "simulated time is paused"
    ros_time["now"] = 30.5
    scene.update(incoming())
    assert not scene.markers.shown


def test_a_page_opened_after_the_drive_shows_the_way_that_the_controller_has_driven(server):
    scene = Scene(server, "odom", "/controller")
    trail = server.scene.get_handle_by_name("/trail")
    assert trail.colors.shape == trail.points.shape == (0, 2, 3), "one colour at first would make it white"
    scene.frames.update("odom", "base_link", 30.0, Pose((19.4, 0.0, 0.0)))
    path = [Point(0.1 * step, 0.0, 0.0) for step in range(194)]
    line = marker(Marker.LINE_STRIP, PATH, 30.0, "odom", (0.04, 0.0, 0.0), points=path)
    markers = [("/controller/visualization_marker_array", MarkerArray([line]))]
    scene.update(incoming(markers=markers))
    assert trail.points[0, 0].tolist() == pytest.approx([0.0, 0.0, 0.025])
    assert trail.points[-1, 1].tolist() == pytest.approx([19.3, 0.0, 0.025])


def test_a_trail_fades_with_its_length_behind_the_robot():
    trail = np.array([(x, 0.0, 0.0) for x in (0.0, 1.0, 1.0 + FADE_ENDS - FADE_BEGINS, 1.0 + FADE_ENDS)])
    shown = 255.0 * (trail_colors(trail) / 255.0) ** (1.0 / 2.2)
    assert shown == pytest.approx(np.array([FADED_COLOR, FADED_COLOR, TRAIL_COLOR, TRAIL_COLOR]), abs=5)
    steps = np.diff(trail_colors(np.linspace(0, 20, 201)[:, None] * (1, 0, 0)).astype(int), axis=0)
    assert (np.abs(steps) < 5).all()
