"""Interactive markers of bodies: every shape where it is, level handles, muted planes."""

from math import pi, sqrt

import numpy as np
import pytest
from visualization_msgs.msg import InteractiveMarkerControl, Marker

from husky_highlevel_controller.datatypes import Body, Box, Cylinder, Geometry, Plane, Pose, Sphere
from husky_highlevel_controller.geometry import compose, quat_from_rpy, rotate, transform_point
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.simulator.object_markers import body_to_msg, upwards

RED = (1.0, 0.0, 0.0, 0.5)
PLACE = Pose((1.0, 2.0, 3.0), quat_from_rpy(0.1, -0.2, 0.3))


def marker_of(shape, pose=PLACE, rgba=RED):
    body = Body("it", Pose(), (), (Geometry(shape, pose, rgba),))
    (marker,) = body_to_msg(body, Pose(), "odom").controls[0].markers
    return marker


def corners(marker):
    pose = conversions.pose_from_msg(marker.pose)
    return np.array([transform_point(pose, (point.x, point.y, point.z)) for point in marker.points])


def color(message):
    return (message.r, message.g, message.b, message.a)


@pytest.mark.parametrize(
    ("shape", "kind", "scale"),
    [
        (Box((1.0, 2.0, 3.0)), Marker.CUBE, (1.0, 2.0, 3.0)),
        (Cylinder(0.5, 3.0), Marker.CYLINDER, (0.95, 0.95, 3.0)),  # slim, so that a marker of it is seen
        (Sphere(0.5), Marker.SPHERE, (1.0, 1.0, 1.0)),
    ],
)
def test_a_shape_is_drawn_in_its_size_place_and_colour(shape, kind, scale):
    marker = marker_of(shape)
    assert (marker.type, marker.action) == (kind, Marker.ADD)
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == scale
    assert conversions.pose_from_msg(marker.pose) == PLACE
    assert color(marker.color) == RED


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.6, 0.0, -0.8)])
def test_a_plane_is_drawn_across_its_normal_in_a_quiet_colour(normal):
    marker = marker_of(Plane(normal, (4.0, 2.0)), Pose((0.0, 0.0, 5.0)))
    found = corners(marker) - (0.0, 0.0, 5.0)
    assert np.allclose(found @ normal, 0.0)
    assert np.allclose(np.linalg.norm(found, axis=1), sqrt(5.0)), "half a diagonal from its middle"
    assert max(color(marker.colors[0])[:3]) < 0.3
    assert len(marker.colors) == len(marker.points), "or RViz lights it"


def test_a_line_on_a_field_is_drawn_as_paint_on_its_upper_side():
    marker = marker_of(Box((9.0, 0.05, 0.002)), Pose((0.0, 3.0, 0.006)))
    found = corners(marker)
    assert np.allclose(found.min(axis=0), (-4.5, 2.975, 0.007))
    assert np.allclose(found.max(axis=0), (4.5, 3.025, 0.007))
    assert color(marker.colors[0]) == RED


def test_a_body_is_placed_in_the_frame_with_all_its_geometries():
    body = Body("table", Pose(), (), (Geometry(Sphere(0.1)), Geometry(Sphere(0.2), PLACE)))
    marker = body_to_msg(body, PLACE, "odom")
    assert (marker.name, marker.header.frame_id) == ("table", "odom")
    assert marker.header.stamp.is_zero(), "or RViz waits for TF of that moment"
    assert conversions.pose_from_msg(marker.pose) == PLACE
    assert len(marker.controls[0].markers) == 2
    assert marker.controls[0].always_visible, "not only while the tool Interact is chosen"


def test_only_what_can_move_can_be_dragged_and_deleted():
    static, movable = (
        body_to_msg(Body("it", Pose(), (), (Geometry(Sphere(0.1)),), mass), PLACE, "odom")
        for mass in (0.0, 1.0)
    )
    assert static.controls[0].interaction_mode == InteractiveMarkerControl.NONE
    assert static.menu_entries == []
    assert movable.controls[0].interaction_mode == InteractiveMarkerControl.MOVE_PLANE
    assert [entry.title for entry in movable.menu_entries] == ["Delete"]


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 1.0), (0.3, 0.2, 0.0), (pi / 2, 0.0, 2.0), (0.0, pi / 2, 0.0)])
def test_a_body_is_dragged_on_the_level_however_it_lies(rpy):
    pose = Pose((1.0, 2.0, 3.0), quat_from_rpy(*rpy))
    control = body_to_msg(Body("it", Pose(), (), (), 1.0), pose, "odom").controls[0]
    q = control.orientation
    across = compose(pose, Pose(quat_xyzw=(q.x, q.y, q.z, q.w)))
    assert np.allclose(rotate(across.quat_xyzw, (1.0, 0.0, 0.0)), (0.0, 0.0, 1.0)), "RViz drags across x"
    assert np.allclose(rotate(pose.quat_xyzw, upwards(pose)), (0.0, 0.0, 1.0))
