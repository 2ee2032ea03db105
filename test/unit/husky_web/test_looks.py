"""What is drawn: meshes of shapes and markers, frames, clouds, the robot's visuals."""

import numpy as np
import pytest
import trimesh
from genpy import Duration
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from husky_highlevel_controller.datatypes import HuskyError, Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.ros.clouds import points_from_msg
from husky_web import shapes
from husky_web.frames import Frames
from husky_web.markers import Markers, markers_of, primitives
from husky_web.robot import rigid_groups
from husky_web.shapes import Label, Lines, MeshFile, Points, Solid

RED, GREEN = ColorRGBA(1, 0, 0, 1), ColorRGBA(0, 1, 0, 1)


def marker(kind, size=(1.0, 1.0, 1.0), points=(), colors=(), **fields):
    msg = Marker(type=kind, color=RED, points=[Point(*p) for p in points], colors=list(colors), **fields)
    msg.scale.x, msg.scale.y, msg.scale.z = size
    msg.pose.orientation.w = 1.0
    return msg


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (shapes.cube(), 1.0),
        (shapes.cylinder(), np.pi / 4.0),
        (shapes.sphere(), np.pi / 6.0),
        (shapes.arrow(1.0, 0.2, 0.5, 0.4), np.pi * (0.01 + 0.04 * 0.5 / 3.0)),
    ],
)
def test_shapes_are_closed_and_turn_outwards(mesh, expected):
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)  # its corners are shared
    assert solid.is_watertight
    assert solid.volume == pytest.approx(expected, rel=0.03), "negative where faces turn inwards"


@pytest.mark.parametrize("kind", [Marker.CUBE, Marker.SPHERE, Marker.CYLINDER])
def test_a_solid_marker_has_the_size_of_its_scale(kind):
    (solid,) = primitives(marker(kind, (1.0, 2.0, 3.0)))
    assert solid.extents == pytest.approx([1.0, 2.0, 3.0])
    assert solid.rgba == (1, 0, 0, 1)


def test_an_arrow_goes_from_its_first_point_to_its_second():
    (solid,) = primitives(marker(Marker.ARROW, (0.1, 0.2, 0.0), [(1, 1, 0), (1, 3, 0)]))
    assert solid.mesh.vertices[:, 1].min() == pytest.approx(1.0)
    assert solid.mesh.vertices[:, 1].max() == pytest.approx(3.0)
    assert np.abs(solid.mesh.vertices[:, 0] - 1.0).max() == pytest.approx(0.1, abs=1e-6)


def test_a_path_is_a_line_in_its_frame_that_an_empty_path_deletes():
    path = Path(poses=[PoseStamped() for _ in range(3)])
    path.header.frame_id = "map"
    for x, stamped in enumerate(path.poses):
        stamped.pose.position.x = x
    shown = Markers()
    for marker in markers_of(path):
        shown.apply("/plan", marker, 0.0)
    (line,) = shown.shown.values()
    assert line.header.frame_id == "map"
    (lines,) = primitives(line)
    assert lines.points.tolist() == [[[0, 0, 0], [1, 0, 0]], [[1, 0, 0], [2, 0, 0]]]
    assert lines.width > 0.0
    for marker in markers_of(Path()):
        shown.apply("/plan", marker, 1.0)
    assert shown.shown == {}


def test_a_strip_joins_neighbours_and_a_list_pairs():
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    (strip,), (pairs,) = (
        primitives(marker(kind, points=corners)) for kind in (Marker.LINE_STRIP, Marker.LINE_LIST)
    )
    assert isinstance(strip, Lines)
    assert len(strip.points) == 3
    assert pairs.points.tolist() == [[[0, 0, 0], [1, 0, 0]], [[1, 1, 0], [0, 1, 0]]]


def test_lists_are_one_solid_for_each_colour():
    drawn = primitives(
        marker(Marker.CUBE_LIST, points=[(0, 0, 0), (5, 0, 0), (9, 0, 0)], colors=[RED, GREEN, RED])
    )
    assert [piece.rgba for piece in drawn] == [(1, 0, 0, 1), (0, 1, 0, 1)]
    assert drawn[0].mesh.vertices[:, 0].max() == pytest.approx(9.5)


def test_points_texts_meshes_and_triangles():
    (dots,) = primitives(marker(Marker.POINTS, (0.1, 0.1, 0.0), [(0, 0, 1)]))
    assert dots == Points(dots.points, dots.colors, 0.1)
    assert primitives(marker(Marker.TEXT_VIEW_FACING, (0, 0, 0.3), text="arrived")) == [Label("arrived")]
    (file,) = primitives(marker(Marker.MESH_RESOURCE, mesh_resource="package://a/b.stl"))
    assert file == MeshFile("package://a/b.stl", (1.0, 1.0, 1.0), (1, 0, 0, 1))
    (sheet,) = primitives(marker(Marker.TRIANGLE_LIST, points=[(0, 0, 0), (1, 0, 0), (0, 1, 0), (7, 7, 7)]))
    assert isinstance(sheet, Solid)
    assert len(sheet.mesh.faces) == 1


@pytest.mark.parametrize("broken", [float("nan"), float("inf")])
def test_what_is_not_finite_is_not_drawn(broken):
    assert primitives(marker(Marker.CUBE, (broken, 1.0, 1.0))) == []
    assert primitives(marker(Marker.LINE_STRIP, points=[(0, 0, 0), (broken, 0, 0)])) == []


def test_markers_are_replaced_deleted_and_die():
    markers = Markers()
    markers.apply("/a", Marker(ns="x", id=1), 0.0)
    markers.apply("/a", Marker(ns="y", id=1, lifetime=Duration(2)), 0.0)
    markers.apply("/b", Marker(ns="x", id=1), 0.0)
    markers.apply("/a", Marker(ns="x", id=1, text="new"), 1.0)
    assert markers.shown["/a", "x", 1].text == "new"
    markers.expire(1.9)
    assert len(markers.shown) == 3
    markers.expire(2.0)
    assert set(markers.shown) == {("/a", "x", 1), ("/b", "x", 1)}
    markers.apply("/b", Marker(ns="x", id=1, action=Marker.DELETE), 3.0)
    markers.apply("/a", Marker(action=Marker.DELETEALL), 3.0)
    assert not markers.shown


def test_frames_are_joined_over_a_common_root_at_a_moment():
    frames = Frames()
    frames.update("odom", "base", 1.0, Pose((1.0, 0.0, 0.0)))
    frames.update("odom", "base", 2.0, Pose((2.0, 0.0, 0.0), quat_from_rpy(0.0, 0.0, np.pi / 2.0)))
    frames.update("base", "laser", 0.0, Pose((0.5, 0.0, 0.0)))
    frames.update("odom", "map", 0.0, Pose((0.0, 3.0, 0.0)))
    assert frames.pose("laser", "odom", 1.1).position == pytest.approx((1.5, 0.0, 0.0))
    assert frames.pose("laser", "odom").position == pytest.approx((2.0, 0.5, 0.0))
    assert frames.pose("laser", "map").position == pytest.approx((2.0, -2.5, 0.0))
    assert frames.pose("elsewhere", "odom") is None
    assert (frames.stamp("base"), frames.stamp("odom")) == (2.0, None)


def test_frames_survive_a_circle_and_a_clock_that_runs_backwards():
    frames = Frames()
    frames.update("a", "b", 5.0, Pose())
    frames.update("b", "a", 5.0, Pose())
    assert frames.pose("a", "c") is None
    frames.update("odom", "base", 9.0, Pose((9.0, 0.0, 0.0)))
    frames.update("odom", "base", 1.0, Pose((1.0, 0.0, 0.0)))
    assert frames.pose("base", "odom", 9.0).position == (1.0, 0.0, 0.0)


def points_of(data, height, width, point_step, row_step, **more):
    fields = [PointField(axis, 4 * i, PointField.FLOAT32, 1) for i, axis in enumerate("xyz")]
    sizes = {"height": height, "width": width, "point_step": point_step, "row_step": row_step}
    return points_from_msg(PointCloud2(fields=fields, data=data, **sizes), **more).tolist()


def test_a_cloud_is_thinned_and_loses_what_is_not_finite():
    points = np.array([[0, 0, 0, 9], [np.nan, 0, 0, 9], [1, 2, 3, 9], [4, 5, 6, 9]], "<f4").tobytes()
    assert points_of(points, 1, 4, 16, 64) == [[0, 0, 0], [1, 2, 3], [4, 5, 6]]
    assert points_of(points, 1, 4, 16, 64, max_points=2) == [[0, 0, 0], [1, 2, 3]]
    assert points_of(b"", 1, 4, 16, 0) == []


@pytest.mark.parametrize("step", [0, 4, 11])
def test_a_cloud_whose_points_are_too_short_has_none(step):
    assert points_of(bytes(5 * step), 1, 5, step, 5 * step) == []


@pytest.mark.parametrize(("row_step", "count"), [(36, 4), (0, 4), (23, 0), (37, 0)])
def test_a_cloud_with_padded_rows_keeps_its_points(row_step, count):
    rows = np.array([[1, 2, 3, 4, 5, 6, 99, 99, 99], [7, 8, 9, 10, 11, 12, 99, 99, 99]], "<f4")
    data = (rows if row_step else rows[:, :6]).tobytes()
    expected = [[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]]
    assert points_of(data[:-13] if row_step == 37 else data, 2, 2, 12, row_step) == expected[:count]


URDF = """<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><geometry><box size="1 2 3"/></geometry><material name="red"/></visual></link>
<link name="plate"><visual><origin xyz="0 0 1"/><geometry><mesh filename="file:///x.stl"/></geometry></visual></link>
<link name="wheel"><visual><geometry><cylinder radius="0.5" length="0.1"/></geometry></visual></link>
<joint name="a" type="fixed"><origin xyz="0 0 2"/><parent link="base"/><child link="plate"/></joint>
<joint name="b" type="continuous"><parent link="plate"/><child link="wheel"/></joint></robot>"""


def test_visuals_hang_on_the_link_that_moves_them():
    name, groups = rigid_groups(URDF)
    assert name == "r"
    assert set(groups) == {"base", "wheel"}
    box, mesh = groups["base"]
    assert box.shape.rgba == (1, 0, 0, 1)
    assert mesh.shape.uri == "file:///x.stl"
    assert mesh.pose_in_frame.position == (0, 0, 3)


@pytest.mark.parametrize("text", ["no xml", URDF.replace("1 2 3", "1 2"), URDF.replace("0.5", "half")])
def test_a_broken_description_is_an_error_in_words(text):
    with pytest.raises(HuskyError, match="robot description"):
        rigid_groups(text)


@pytest.mark.parametrize(
    ("kind", "points", "drawn"),
    [
        (Marker.TEXT_VIEW_FACING, 0, 500),
        (Marker.CUBE, 0, 2000),
        (Marker.POINTS, 1_000_000, 3),
        (Marker.SPHERE_LIST, 1_000_000, 5),
    ],
)
def test_what_a_browser_could_not_draw_in_time_is_left_out(kind, points, drawn):
    markers = Markers()
    for number in range(5000 if points == 0 else 6):
        marker = Marker(type=kind, id=number, text="x" * 10_000, points=[Point()] * points)
        markers.apply("/flood", marker, 0.0)
    assert len(markers.shown) == drawn
    assert markers.is_full
    assert max(len(marker.points) for marker in markers.shown.values()) <= 100_000
    assert max(len(marker.text) for marker in markers.shown.values()) <= 500
    markers.apply("/flood", Marker(action=Marker.DELETEALL), 1.0)
    markers.apply("/flood", Marker(type=kind, id=1), 1.0)
    assert markers.shown, "there is room again"
