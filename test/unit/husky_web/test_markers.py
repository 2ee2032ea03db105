"""Markers as shapes, and which of them are shown."""

import numpy as np
import pytest
from genpy import Duration
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from husky_web.markers import MAX_COLORS, Markers, markers_of, primitives
from husky_web.shapes import Label, Lines, MeshFile, Points, Solid

RED, GREEN = ColorRGBA(1, 0, 0, 1), ColorRGBA(0, 1, 0, 1)


def marker(kind, size=(1.0, 1.0, 1.0), points=(), colors=(), **fields):
    msg = Marker(type=kind, color=RED, points=[Point(*p) for p in points], colors=list(colors), **fields)
    msg.scale.x, msg.scale.y, msg.scale.z = size
    msg.pose.orientation.w = 1.0
    return msg


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


@pytest.mark.parametrize("kind", [Marker.TRIANGLE_LIST, Marker.CUBE_LIST])
def test_a_list_of_many_colours_is_few_solids_of_about_these_colours(kind):
    heights = np.linspace(0.0, 1.0, 1500)
    points, colors = (
        [(row, 0.0, 0.0) for row in range(1500)],
        [ColorRGBA(z, 0.3, 1.0 - z, 1.0) for z in heights],
    )
    drawn = primitives(marker(kind, points=points, colors=colors))
    assert 8 <= len(drawn) <= MAX_COLORS
    reds = sorted(solid.rgba[0] for solid in drawn)
    assert (reds[0], reds[-1]) == (0.0, 1.0)


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
    markers.expire(3.0)
    assert set(markers.shown) == {("/a", "x", 1), ("/b", "x", 1)}
    markers.apply("/c", Marker(lifetime=Duration(100)), 3.0)
    markers.expire(2.5)  # the simulation was reset
    assert set(markers.shown) == {("/a", "x", 1), ("/b", "x", 1)}
    markers.apply("/b", Marker(ns="x", id=1, action=Marker.DELETE), 3.0)
    markers.apply("/a", Marker(action=Marker.DELETEALL), 3.0)
    assert not markers.shown


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
