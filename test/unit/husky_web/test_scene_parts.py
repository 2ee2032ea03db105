"""Camera, backdrop and plan of the page's scene."""

import io
from contextlib import contextmanager
from math import dist, inf, nan, pi
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import viser
from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import LaserScan
from std_msgs.msg import ColorRGBA
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.ros.controller.display import PATH, marker
from husky_web import backdrop, camera, drawing, shapes
from husky_web.drawing import DASH, dashes
from husky_web.scene import Scene
from husky_web.shapes import MeshFile


class Browser:
    """A page's camera as its server sees it: what is sent to it, and what it reports some updates later."""

    def __init__(self, monkeypatch):
        self.camera = SimpleNamespace(update_timestamp=1.0)
        self.sent = []
        monkeypatch.setattr(camera, "look", lambda _, position, target: self.sent.append((position, target)))
        self.report((3.0, 3.0, 3.0), (0.0, 0.0, 0.0))

    @contextmanager
    def atomic(self):
        yield

    def report(self, position, look_at):
        z = np.array(look_at) - position
        z /= np.linalg.norm(z)
        x = np.cross(z, (0.0, 0.0, 1.0))
        x /= np.linalg.norm(x)
        rotation = np.eye(4)
        rotation[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        self.camera.wxyz = trimesh.transformations.quaternion_from_matrix(rotation)
        self.camera.position, self.camera.look_at = np.array(position), np.array(look_at)


def pose(x, y=0.0, yaw=0.0):
    return Pose((x, y, 0.0), quat_from_rpy(0.0, 0.0, yaw))


def test_the_camera_comes_to_stand_behind_a_robot_that_turns_though_the_page_reports_late(monkeypatch):
    browser = Browser(monkeypatch)
    follow = camera.Camera(browser)
    for update in range(200):
        follow.update(pose(0.05 * update, yaw=min(0.02 * update, pi / 2.0)), None)
        browser.report(*browser.sent[max(0, update - 10)])
    (x, y, z), (at_x, at_y, at_z) = browser.sent[-1]
    behind, left, above = camera.OFFSETS[camera.FOLLOW]
    assert (x - at_x, y - at_y, z - at_z) == pytest.approx((-left, behind, above), abs=0.05)


def test_the_camera_keeps_the_side_that_the_mouse_has_turned_it_to(monkeypatch):
    browser = Browser(monkeypatch)
    follow = camera.Camera(browser)
    follow.update(pose(0.0), None)
    browser.report(*browser.sent[-1])
    follow.update(pose(0.05), None)
    browser.report((0.05, 6.0, 1.0), (0.05, 0.0, 0.0))  # by the mouse
    for update in range(2, 50):
        follow.update(pose(0.05 * update), None)
        browser.report(*browser.sent[-1])
    position, target = browser.sent[-1]
    assert np.subtract(position, target) == pytest.approx((0.0, 6.0, 1.0), abs=0.01)


def test_the_camera_is_sent_nothing_while_the_robot_stands(monkeypatch):
    browser = Browser(monkeypatch)
    follow = camera.Camera(browser)
    for _ in range(10):
        follow.update(pose(1.0), None)
    assert len(browser.sent) == 1


@pytest.mark.parametrize("name", ["day", "night"])
def test_the_ground_reaches_to_a_horizon_below_a_closed_sky(name):
    (part,) = trimesh.load(io.BytesIO(backdrop.scenery(backdrop.LOOKS[name])), file_type="glb").dump()
    lengths = np.linalg.norm(part.vertices, axis=1)
    assert -0.02 < part.vertices[:, 2].min() <= 0.0
    assert lengths.max() == pytest.approx(backdrop.RADIUS)
    assert part.vertices[:, 2].max() == pytest.approx(backdrop.RADIUS)


def test_the_ground_shows_metres_near_the_robot_and_no_pattern_far_away():
    look = backdrop.LOOKS["day"]
    quads, colors = backdrop.checker(look)

    def contrast(x, y):
        from_middle = np.linalg.norm(quads.mean(axis=1) - (x + 0.5, y + 0.5, 0.0), axis=1)
        return colors[from_middle.argmin(), 0, 0] / look.ground[0] - 1.0

    assert np.sign([contrast(x, y) for x, y in ((1, 1), (1, 2), (2, 2), (2, 1))]).tolist() == [1, -1, 1, -1]
    assert abs(contrast(1, 1)) > 0.05
    assert abs(contrast(24, 7)) < 0.01


def test_a_mesh_with_more_triangles_than_are_seen_is_drawn_with_fewer(tmp_path):
    trimesh.creation.icosphere(subdivisions=5, radius=0.2).export(tmp_path / "fine.stl")
    (solid,) = shapes.solids_of(MeshFile((tmp_path / "fine.stl").as_uri(), (1.0, 1.0, 1.0), None))
    assert len(solid.mesh.faces) < 0.5 * 20 * 4**5
    assert solid.extents == pytest.approx([0.4, 0.4, 0.4], abs=0.02)


def test_dashes_stay_while_the_end_comes_nearer():
    long, short = (dashes((0.0, 0.0, 0.0), (length, 0.0, 0.0)) for length in (4.0, 2.1))
    assert np.array_equal(long[: len(short)], short)
    assert [dist(*dash) for dash in long] == pytest.approx([DASH] * len(long), abs=1e-6)
    assert len(dashes((1.0, 1.0, 0.0), (1.0, 1.0, 0.0))) == 0


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


def test_a_page_opened_after_the_drive_shows_the_way_that_the_controller_has_driven(server):
    scene = Scene(server, "odom", "/controller")
    scene.frames.update("odom", "base_link", 30.0, pose(19.4))
    path = [Point(0.1 * step, 0.0, 0.0) for step in range(194)]
    line = marker(Marker.LINE_STRIP, PATH, 30.0, "odom", (0.04, 0.0, 0.0), points=path)
    markers = [("/controller/visualization_marker_array", MarkerArray([line]))]
    scene.update(incoming(markers=markers))
    trail = server.scene.get_handle_by_name("/trail")
    assert trail.points[0, 0].tolist() == pytest.approx([0.0, 0.0, 0.025])
    assert trail.points[-1, 1].tolist() == pytest.approx([19.3, 0.0, 0.025])
