"""Interactive markers of RViz for the bodies of the world.

In: a `Body`, and where it is. Out: messages.
"""

from __future__ import annotations

from typing import Sequence

from geometry_msgs.msg import Point
from geometry_msgs.msg import Quaternion as QuaternionMsg
from geometry_msgs.msg import Vector3 as Vector3Msg
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import InteractiveMarker, InteractiveMarkerControl, Marker, MenuEntry

from husky_highlevel_controller.datatypes import (
    Body,
    Box,
    Cylinder,
    Geometry,
    Plane,
    Pose,
    Rgba,
    Sphere,
    TriangleMesh,
    Vector3,
)
from husky_highlevel_controller.geometry import compose, quat_between, quat_inverse, rotate
from husky_highlevel_controller.meshes import simplified
from husky_highlevel_controller.ros import conversions

DELETE = 1  # id of the only entry in the menu of a marker
# colour of every plane, so dark that grid, scan and robot are well visible on it
PLANE_COLOR = (0.2, 0.21, 0.22, 1.0)
PAINT_HEIGHT = 0.005  # [m] a box that is lower than this is drawn as a painted area on the surface below it
# a cylinder is drawn with this fraction of its radius, so that the marker of a found pillar stays visible
DRAWN_RADIUS_FRACTION = 0.95
MAX_DRAWN_FACES = 20_000  # largest number of faces of a drawn mesh; a mesh with more faces is simplified
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def body_to_msg(body: Body, pose_in_frame: Pose, frame: str) -> InteractiveMarker:
    """Return the interactive marker of a body.

    If the body has a mass, a user of RViz can drag it in the horizontal plane, and delete it by its menu.

    Args:
        body: the body.
        pose_in_frame: pose of the body in a level frame.
        frame: name of this frame.
    """
    marker = InteractiveMarker(
        # the header has no stamp, so in RViz the marker moves together with its frame
        header=Header(frame_id=frame),
        name=body.name,
        description=body.name,
        pose=conversions.pose_to_msg(pose_in_frame),
        scale=1.0,
    )
    control = InteractiveMarkerControl(
        name="body",
        interaction_mode=InteractiveMarkerControl.NONE,
        orientation=QuaternionMsg(w=1.0),
        always_visible=True,
        markers=[_geometry_to_msg(geometry) for geometry in body.visuals],
    )
    if body.mass > 0.0:
        # RViz moves the control perpendicular to its x axis, so a vertical x axis makes all moves horizontal
        control.interaction_mode = InteractiveMarkerControl.MOVE_PLANE
        control.orientation = QuaternionMsg(*quat_between(X, upwards(pose_in_frame)))
        # if the user chooses the entry, RViz sends it to this node (FEEDBACK), and the node deletes the body
        marker.menu_entries = [MenuEntry(id=DELETE, title="Delete", command_type=MenuEntry.FEEDBACK)]
    marker.controls = [control]
    return marker


def upwards(pose: Pose) -> Vector3:
    """Return the vertical unit vector, in the axes of a body; `pose` is the body's pose in a level frame."""
    return rotate(quat_inverse(pose.quat_xyzw), Z)


def _geometry_to_msg(geometry: Geometry) -> Marker:
    """Return the marker of one visible part of a body.

    A plane becomes a rectangle of its size. So does a box that is lower than PAINT_HEIGHT, such as a painted
    line. A cylinder is drawn with DRAWN_RADIUS_FRACTION of its radius, so that the controller's marker of a
    found pillar stays visible around it.
    """
    shape, pose = geometry.shape, geometry.pose_in_body
    if isinstance(shape, Plane):
        # rotation that turns the z axis of the sheet to the normal of the plane
        turned = Pose(quat_xyzw=quat_between(Z, shape.normal))
        return _sheet(compose(pose, turned), shape.size, PLANE_COLOR)
    if isinstance(shape, Box) and shape.size[2] < PAINT_HEIGHT:
        top = Pose((0.0, 0.0, shape.size[2] / 2.0))
        return _sheet(compose(pose, top), shape.size[:2], geometry.rgba)
    if isinstance(shape, TriangleMesh):
        mesh = simplified(shape, MAX_DRAWN_FACES)
        # corners of the F triangles, (3 F, 3) [m]: three rows for each triangle
        corners = mesh.vertices[mesh.faces].reshape(-1, 3).tolist()
        return _triangles(pose, corners, geometry.rgba)
    kind = {Box: Marker.CUBE, Cylinder: Marker.CYLINDER, Sphere: Marker.SPHERE}[type(shape)]
    color, scale = ColorRGBA(*geometry.rgba), Vector3Msg(*shape.size)
    if kind == Marker.CYLINDER:
        scale.x, scale.y = DRAWN_RADIUS_FRACTION * scale.x, DRAWN_RADIUS_FRACTION * scale.y
    return Marker(type=kind, pose=conversions.pose_to_msg(pose), scale=scale, color=color)


def _sheet(pose: Pose, size: Sequence[float], rgba: Rgba) -> Marker:
    """Return the marker of a rectangle in the x-y plane of a pose; `size` is its length along x and y [m]."""
    x, y = size[0] / 2.0, size[1] / 2.0
    first, second, third, fourth = (-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)
    corners = [first, second, third, first, third, fourth]  # two triangles
    marker = _triangles(pose, corners, rgba)
    # RViz shades triangles of one colour, so a rectangle may look black; a colour for each corner avoids this
    marker.colors = [marker.color] * len(corners)
    return marker


def _triangles(pose: Pose, corners: Sequence[Vector3], rgba: Rgba) -> Marker:
    """Return the marker of triangles; each three successive corners [m] are one triangle."""
    return Marker(
        type=Marker.TRIANGLE_LIST,
        pose=conversions.pose_to_msg(pose),
        scale=Vector3Msg(1.0, 1.0, 1.0),
        color=ColorRGBA(*rgba),
        points=[Point(*corner) for corner in corners],
    )
