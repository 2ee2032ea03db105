"""The 3D view: robot, scan, TF frames, trail, depth points, markers and objects, in one fixed frame."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from math import ceil, dist
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union
from urllib.parse import quote

import numpy as np
import rospy
import viser
from visualization_msgs.msg import Marker

from husky_highlevel_controller.datatypes import HuskyError, Pose, Vector3
from husky_highlevel_controller.geometry import compose, transform_points
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.clouds import MAX_POINTS, points_from_msg, points_from_scan
from husky_highlevel_controller.ros.transforms import is_pose
from husky_web import shapes
from husky_web.backdrop import SHADOW_HEIGHT, Backdrop, contact_shadow
from husky_web.drawing import (
    add_pieces,
    bounds,
    clickable,
    dashes,
    on_error_log_and_skip,
    redraw,
    warn_left_out,
)
from husky_web.frames import Frames
from husky_web.legend import (
    CLOUD_COLOR,
    LAYERS,
    PLAN_COLOR,
    RAY_COLOR,
    SCAN_COLOR,
    TRAIL_COLOR,
)
from husky_web.markers import (
    MarkerKey,
    Markers,
    appearance,
    frame_of_message,
    markers_of,
    points_of,
    pose_of,
    primitives,
)
from husky_web.robot import Visual, rigid_groups
from husky_web.topics import Topics
from husky_web.viser_private import place

POINT_SIZE = 0.05  # [m] size of the scan's points
RAYS = 60  # largest number of beams that are drawn; they are enough to show which beams meet an object
# [m] distance between two points of the trail; largest number of its points
TRAIL_STEP, TRAIL_POINTS = 0.25, 1000
LINE_WIDTH, TRAIL_WIDTH = 0.03, 0.015  # [m]
# [m] lengths of trail behind the robot: up to FADE_BEGINS, the trail has its full colour; between the two
# lengths, it fades; beyond FADE_ENDS, it has FADED_COLOR
FADE_BEGINS, FADE_ENDS = 3.0, 15.0
# colour of the faded trail, visible on a light and on a dark page
FADED_COLOR = (125, 148, 176)
LINE_HEIGHT = 0.025  # [m] height of trail and plan above the ground
GAMMA = 2.2  # exponent by which the colours of a screen become linear
# [m] if the robot has moved farther than this in one update, a service has moved it, so the trail begins
# again
TRAIL_JUMP = 1.0
# size [m] and colour of the box that stands for the robot while the mouse drags it
GHOST_SIZE, GHOST_COLOR = (1.0, 0.7, 0.4), (0.95, 0.72, 0.05, 0.4)
_NAME_LABEL: Any = {"font_size_mode": "scene", "font_scene_height": 0.06, "anchor": "bottom-center"}
# [s] the robot is drawn at its pose at the time of the newest scan; but if the times of this scan and of the
# robot's newest pose differ by MAX_SCAN_AGE or more, the robot is drawn at its newest pose
MAX_SCAN_AGE = 0.3
LOOKS_PERIOD = 0.2  # [s] time between two updates of the appearance of markers and plan
MAX_AXES = 200  # largest number of TF frames that are shown
BASE, FOOTPRINT = "base_link", "base_footprint"
# namespaces of three markers of the controller: its stop point, the path that the robot has driven, and the
# controller's state
TARGET, PATH, STATE = "target", "path", "state"


@dataclass
class DrawnMarker:
    """Marker in the view."""

    node: Any  # node of viser; its pose is the marker's pose in the fixed frame
    placed: Optional[Marker] = None  # message that has set the pose of the node; None while it is unknown
    drawn: Optional[Marker] = None  # message that has set the parts
    appearance: Optional[Tuple[Any, ...]] = None  # shape and colours of the parts
    parts: List[Any] = field(default_factory=list)  # nodes of the marker's parts, children of `node`


class RobotFrame(NamedTuple):
    """Frame of the robot in the view."""

    node: Any  # node of viser
    parent: str  # TF frame in which the node has its pose


class Scene:
    """Scene that is drawn; updated by one thread."""

    def __init__(self, server: viser.ViserServer, fixed_frame: str, controller: str) -> None:
        """Begin empty; all is drawn in `fixed_frame`, and `controller` is the controller's node."""
        self._scene, self.fixed_frame = server.scene, fixed_frame
        self._controller = f"{controller}/"  # text with which the names of the controller's topics begin
        # `frames` has the poses of the TF frames, and `markers` has the newest messages of all markers
        self.frames, self.markers = Frames(), Markers()
        # name of each layer, and true if the layer is shown; the boxes of the page call `show_layer`
        self.layers = {layer.name: layer.is_shown for layer in LAYERS}
        self.scan_stamp = 0.0  # [s] stamp of the newest scan
        # [s] the robot is drawn at its pose at this time, the stamp of the drawn scan; None if the robot is
        # drawn at its newest pose
        self.moment: Optional[float] = None
        self._robot: Dict[str, RobotFrame] = {}  # the key is the name of the TF frame
        self.robot_name = ""  # name of the robot in its URDF; empty before the first URDF
        # node of the shadow below the robot, a child of the node of base_link; None without a robot
        self._shadow: Any = None
        self.robot_shapes: List[Any] = []  # nodes of the robot that the mouse can grasp
        self._drawn: Dict[MarkerKey, DrawnMarker] = {}  # markers that have a node in the scene
        self._axes: Dict[str, Any] = {}  # object of viser that draws the axes of each TF frame
        self._trail: List[Tuple[float, float, float]] = []  # [m] points in the fixed frame, the oldest first
        self._backdrop = Backdrop(self._scene)
        # nodes of points and lines are made once, empty, and get their points later
        empty = np.zeros((0, 3), np.float32)
        exact: Any = {"point_shape": "circle", "precision": "float32"}
        add_points = self._scene.add_point_cloud
        self._scan = add_points("/scan", empty, SCAN_COLOR, point_size=POINT_SIZE, **exact)
        self._cloud = add_points("/depth", empty, CLOUD_COLOR, point_size=0.03, **exact)
        self._rays = self._add_lines("/rays", RAY_COLOR, thickness=1.0, thickness_units="screen")
        # the colours are an array, still empty, because viser would later draw the line white if it began
        # with a single colour
        self._trail_line = self._add_lines("/trail", np.zeros((0, 2, 3), np.uint8), thickness=TRAIL_WIDTH)
        self._plan_line = self._add_lines("/plan", PLAN_COLOR, thickness=LINE_WIDTH)
        # [s] wall time at which the markers' colours and shapes, and the plan, are drawn again
        self._looks_due = 0.0
        box = shapes.Solid(shapes.cube(), GHOST_COLOR, GHOST_SIZE)
        # transparent box at the pose to which the mouse drags the robot
        self._ghost = self._scene.add_frame("/ghost", show_axes=False, visible=False)
        add_pieces(self._scene, "/ghost", [box], Pose())

    def _add_lines(self, name: str, color: Union[Tuple[int, int, int], np.ndarray], **looks: Any) -> Any:
        """Add a node of line segments, still without any, and return it."""
        return self._scene.add_line_segments(name, np.zeros((0, 2, 3), np.float32), color, **looks)

    def draw_robot(self, description: str) -> None:
        """Draw the robot of a URDF, or log a warning if it cannot be read."""
        # nodes are removed in reverse order, so that children are removed before their parents
        for shown in reversed(self._robot.values()):
            shown.node.remove()
        self._robot, self.robot_shapes, self._shadow = {}, [], None
        try:
            self.robot_name, groups = rigid_groups(description)
        except HuskyError as error:
            rospy.logwarn(str(error))
            return
        # the base comes first, because its node is the parent of the nodes of the other frames
        frames = sorted(groups, key=lambda frame: frame != BASE)  # False is sorted before True
        for frame in frames:
            meshes = self._draw_frame(frame, groups[frame])
            self.robot_shapes += meshes
            if frame == BASE and meshes:
                name = f"{self._robot[BASE].node.name}/shadow"
                low, high = bounds(meshes)
                # the shadow is below the middle of the base; `_update_shadow` moves it down to the ground
                self._shadow = contact_shadow(self._scene, name, high - low, (low + high) / 2.0)

    def _draw_frame(self, frame: str, visuals: Sequence[Visual]) -> List[Any]:
        """Add a node for a frame of the robot, and nodes for its visuals; return the nodes of meshes."""
        # nodes are children of the base's node, so that the pose of the base moves all of them
        if BASE in self._robot:
            path, parent = f"/robot/{BASE}", BASE
        else:  # `frame` is the base, or the robot has no frame with the name BASE
            path, parent = "/robot", self.fixed_frame
        # slashes in the name are replaced, because viser would read each as a level of its tree of nodes
        name = f"{path}/{quote(frame, safe='')}"
        node = self._scene.add_frame(name, show_axes=False, visible=False)
        self._robot[frame] = RobotFrame(node, parent)
        meshes: List[Any] = []
        for number, visual in enumerate(visuals):
            with on_error_log_and_skip(f"a visual of {frame} in robot_description"):
                nodes = add_pieces(self._scene, f"{name}/{number}", [visual.shape], visual.pose_in_frame)
                meshes += clickable(nodes)
        return meshes

    @property
    def base(self) -> Optional[Pose]:
        """Return the pose of base_link in the fixed frame at the drawn moment, or None."""
        return self.frames.pose(BASE, self.fixed_frame, self.moment)

    @property
    def ground(self) -> float:
        """Return the height of the ground in the fixed frame [m]: the height of base_footprint, or 0."""
        pose = self.frames.pose(FOOTPRINT, self.fixed_frame)
        return 0.0 if pose is None else pose.position[2]

    def update(self, topics: Topics) -> None:
        """Draw the new messages.

        The robot has its pose at the moment of the drawn scan, so the scan's points are on the walls.
        """
        self._take_transforms(topics)
        with on_error_log_and_skip(topics.names["scan"]):
            self._update_scan(topics.take("scan"))
        self._move_robot()
        with on_error_log_and_skip(topics.names["cloud"]):
            self._update_cloud(topics.take("cloud"))
        self._update_trail()
        now = time.monotonic()
        # markers move in each update, but their colours and shapes are drawn again only each LOOKS_PERIOD,
        # because drawing takes longer
        are_looks_due = now >= self._looks_due
        self._update_markers(topics, are_looks_due)
        self._update_axes()
        if are_looks_due:
            self._looks_due = now + LOOKS_PERIOD
            self._update_plan()
        self._backdrop.update(self.ground, None if self.base is None else self.base.position)
        self._update_shadow()

    def _update_shadow(self) -> None:
        """Move the shadow up or down to the ground, which has the height of the frame base_footprint."""
        footprint = self.frames.pose(FOOTPRINT, BASE)
        if self._shadow is not None and footprint is not None:
            _set_height(self._shadow, footprint.position[2] + SHADOW_HEIGHT)

    def show_layer(self, name: str, is_shown: bool) -> None:
        """Show or hide a layer, for every page, from the next update on."""
        self.layers[name] = is_shown

    def show_ghost(self, pose: Optional[Pose]) -> None:
        """Show the pose to which the robot would be moved, or nothing."""
        self._show(self._ghost, pose)

    def forget(self) -> None:
        """Remove the trail and all markers, because they would be old when the next page opens."""
        self._trail.clear()
        self.markers.clear()
        for drawing in self._drawn.values():
            drawing.node.remove()
        self._drawn.clear()

    def _show(self, node: Any, pose: Optional[Pose]) -> None:
        """Show a node at a pose in its parent, or hide it if the pose is None."""
        if pose is not None:
            place(node, pose)
        node.visible = pose is not None

    def _update_scan(self, msg: Optional[Any]) -> None:
        """Draw the points and some of the beams of a new scan; None if there is no new one."""
        self._scan.visible, self._rays.visible = self.layers["scan"], self.layers["rays"]
        if msg is None:
            return
        scan = conversions.scan_from_msg(msg)
        self.scan_stamp = scan.stamp
        pose = self.frames.pose(scan.frame, self.fixed_frame, scan.stamp)
        if pose is not None and (self.layers["scan"] or self.layers["rays"]):
            points = transform_points(pose, points_from_scan(scan)).astype(np.float32)
            points = _thinned(points, MAX_POINTS)
            hits = _thinned(points, RAYS)
            self._scan.points = points
            lidar = np.array(pose.position, np.float32)
            # (N, 2, 3) for each of N points, a line from the lidar to this point
            self._rays.points = np.stack([np.broadcast_to(lidar, hits.shape), hits], axis=1)

    def _update_cloud(self, msg: Optional[Any]) -> None:
        """Draw the points of a new cloud; None if there is no new one."""
        self._cloud.visible = self.layers["depth"]
        if msg is None or not self.layers["depth"]:
            return
        pose = self.frames.pose(frame_of_message(msg), self.fixed_frame, msg.header.stamp.to_sec())
        if pose is not None:
            self._cloud.points = transform_points(pose, points_from_msg(msg)).astype(np.float32)

    def _update_trail(self) -> None:
        """Add the robot's position to the trail, if it is at least TRAIL_STEP from the trail's last point."""
        self._trail_line.visible = self.layers["trail"]
        base = self.base
        if base is None:
            return
        x, y, _ = base.position
        point = (x, y, self.ground + LINE_HEIGHT)
        if self._trail:
            step = dist(self._trail[-1], point)
            if step < TRAIL_STEP:
                return
            if step > TRAIL_JUMP:  # a service has moved the robot
                self._trail.clear()
        self._replace_trail([*self._trail, point])

    def _begin_trail(self, path: Marker) -> None:
        """Begin the trail with the controller's path, which the robot drove before a page was open.

        A trail that already has a line stays as it is.
        """
        if len(self._trail) >= 2:
            return
        points = points_of(path)
        if len(points) < 2 or not np.isfinite(points).all():
            return
        frame = self.frames.pose(frame_of_message(path), self.fixed_frame)
        if frame is None:  # the pose of the path's frame is unknown
            return
        height = self.ground + LINE_HEIGHT
        positions = transform_points(frame, points).tolist()
        self._replace_trail([(x, y, height) for x, y, _ in positions])

    def _replace_trail(self, trail: List[Tuple[float, float, float]]) -> None:
        """Replace the trail by the last TRAIL_POINTS of these points, and draw it.

        The points [m] are in the fixed frame, the oldest first.
        """
        self._trail = trail[-TRAIL_POINTS:]
        line = np.array(self._trail, np.float32)
        # (N - 1, 2, 3) for N points of the trail, a line from each point to the next one; each end of a line
        # has the colour of its point
        self._trail_line.points = np.stack([line[:-1], line[1:]], axis=1)
        colors = trail_colors(line)
        self._trail_line.colors = np.stack([colors[:-1], colors[1:]], axis=1)

    def _update_plan(self) -> None:
        """Draw dashes from the controller's stop point to the robot."""
        base, stop_point = self.base, self._stop_point()
        if not self.layers["plan"] or base is None or stop_point is None:
            self._plan_line.points = np.zeros((0, 2, 3), np.float32)
            return
        # both ends are on the ground
        height = self.ground + LINE_HEIGHT
        start = (stop_point[0], stop_point[1], height)
        end = (base.position[0], base.position[1], height)
        self._plan_line.points = dashes(start, end)

    def _stop_point(self) -> Optional[Vector3]:
        """Return the controller's stop point in the fixed frame [m], from its marker TARGET.

        None if there is no such marker, or if its frame is not connected with the fixed frame.
        """
        newest: Optional[Marker] = None
        for key, marker in self.markers.shown.items():  # the newest marker comes last
            if key.namespace == TARGET and key.topic.startswith(self._controller):
                newest = marker
        if newest is None:
            return None
        frame = self.frames.pose(frame_of_message(newest), self.fixed_frame)
        if frame is None:
            return None
        # if a number of the marker's pose is inf or nan, the origin of its frame takes its place
        return compose(frame, pose_of(newest) or Pose()).position

    def _take_transforms(self, topics: Topics) -> None:
        """Take in new TF frames."""
        for _, transforms in topics.take_all("tf"):
            for msg in transforms.transforms:
                if not is_pose(msg.transform):  # a number is not finite, or too large
                    continue
                stamp, pose = msg.header.stamp.to_sec(), conversions.pose_from_transform(msg)
                self.frames.update(frame_of_message(msg), msg.child_frame_id.lstrip("/"), stamp, pose)

    def _move_robot(self) -> None:
        """Move the robot to its pose at the moment of the drawn scan.

        If there is no recent scan, for example because the lidar is off, the robot gets its newest pose.
        """
        newest_pose_stamp = self.frames.stamp(BASE)
        is_recent = newest_pose_stamp is not None and abs(newest_pose_stamp - self.scan_stamp) < MAX_SCAN_AGE
        self.moment = self.scan_stamp if is_recent else None
        for frame, shown in self._robot.items():
            self._show(shown.node, self.frames.pose(frame, shown.parent, self.moment))

    def _update_markers(self, topics: Topics, are_looks_due: bool) -> None:
        """Take in new markers, and draw all markers that are shown.

        Args:
            topics: messages since the last call.
            are_looks_due: whether shapes and colours are drawn again, too. This takes longer than moving the
                markers, so it is done less often. Until then, a new marker is an empty node.
        """
        ros_time = rospy.get_time()  # lifetimes end by ROS time, as in RViz, so they stop during a pause
        self._take_markers(topics, ros_time)
        self.markers.expire(ros_time)
        shown = self.markers.shown if self.layers["markers"] else {}
        for key in self._drawn.keys() - shown.keys():
            self._drawn.pop(key).node.remove()
        for key, marker in shown.items():
            with on_error_log_and_skip(f"a marker of {key.topic}"):
                self._place_marker(key, marker)
                if are_looks_due:
                    self._draw_marker(self._drawn[key], marker)

    def _take_markers(self, topics: Topics, ros_time: float) -> None:
        """Take in new markers that came at this ROS time [s], except the markers PATH and STATE.

        The page draws the trail of the robot by itself, so it uses the marker PATH only for the way that the
        robot drove before the page was open. The state bar shows the state, so STATE is not used.
        """
        for topic, msg in topics.take_all("markers"):
            with on_error_log_and_skip(topic):
                for marker in markers_of(msg):
                    is_of_controller = topic.startswith(self._controller)
                    if is_of_controller and marker.ns == PATH:
                        self._begin_trail(marker)
                    elif not (is_of_controller and marker.ns == STATE):
                        self.markers.apply(topic, marker, ros_time)
        if self.markers.is_full:
            warn_left_out("a part of the markers", "there are more than a browser can draw in time")

    def _place_marker(self, key: MarkerKey, marker: Marker) -> None:
        """Move a marker's node to its pose in the fixed frame; a new marker gets a node first."""
        drawing = self._drawn.get(key)
        if drawing is None:
            name = f"/markers/{quote(key.topic, safe='')}/{quote(key.namespace, safe='')}_{key.id}"
            drawing = DrawnMarker(self._scene.add_frame(name, show_axes=False, visible=False))
            self._drawn[key] = drawing
        # only a marker that is locked to its frame moves with the frame
        if not marker.frame_locked and drawing.placed is marker:
            return
        stamp: Optional[float] = marker.header.stamp.to_sec()
        if marker.frame_locked or stamp == 0.0:
            stamp = None  # requests the newest pose of the frame
        frame = self.frames.pose(frame_of_message(marker), self.fixed_frame, stamp)
        pose_in_frame = pose_of(marker)
        if frame is None or pose_in_frame is None:  # the next update tries again
            drawing.placed = None
            self._show(drawing.node, None)
        else:
            drawing.placed = marker
            self._show(drawing.node, compose(frame, pose_in_frame))

    def _draw_marker(self, drawing: DrawnMarker, marker: Marker) -> None:
        """Draw a marker's parts again if it looks different from the drawing."""
        if drawing.drawn is marker:  # no new message has come
            return
        drawing.drawn = marker
        new_appearance = appearance(marker)
        if drawing.appearance == new_appearance:  # the new message has only changed the pose
            return
        drawing.appearance = new_appearance
        pieces = primitives(marker)
        if not redraw(drawing.parts, pieces):  # the nodes cannot be changed to these pieces
            for part in drawing.parts:
                part.remove()
            drawing.parts = add_pieces(self._scene, drawing.node.name, pieces, Pose())

    def _update_axes(self) -> None:
        """Show the axes and names of all TF frames if their layer is on."""
        names = self.frames.names[:MAX_AXES] if self.layers["frames"] else []
        for name in set(self._axes) - set(names):
            self._axes.pop(name).remove()
        for name in names:
            if name not in self._axes:
                path = f"/frames/{quote(name, safe='')}"
                axes = self._scene.add_frame(path, axes_length=0.25, axes_radius=0.01, visible=False)
                self._scene.add_label(f"{path}/name", name, **_NAME_LABEL)
                self._axes[name] = axes
            self._show(self._axes[name], self.frames.pose(name, self.fixed_frame))


def _set_height(node: Any, height: float) -> None:
    """Move a node up or down to a height in its parent [m]; its x and y stay."""
    x, y, _ = node.position.tolist()
    place(node, Pose((x, y, height)))


def _thinned(points: np.ndarray, count: int) -> np.ndarray:
    """Return every n-th point of (N, 3), at most `count` points."""
    step = max(ceil(len(points) / count), 1)
    return points[::step]


def trail_colors(trail: np.ndarray) -> np.ndarray:
    """Return colours (N, 3) of the points of a trail (N, 3) [m], the oldest first; far points have faded.

    TRAIL_COLOR and FADED_COLOR are colours of a screen (sRGB), but the browser expects linear colours for the
    points of a line. So the colours are made linear here; otherwise the line would be too bright.
    """
    steps = np.linalg.norm(np.diff(trail, axis=0), axis=1)
    # (N,) [m] length of the trail from each point to the robot: the sum of all steps after the point
    sums_from_the_end = np.cumsum(steps[::-1])[::-1]
    behind = np.concatenate([sums_from_the_end, [0.0]])
    # (N, 1) 0 for the full colour, 1 for the faded one
    faded = np.clip((behind - FADE_BEGINS) / (FADE_ENDS - FADE_BEGINS), 0.0, 1.0)[:, None]
    colors = (1.0 - faded) * TRAIL_COLOR + faded * FADED_COLOR
    linear: np.ndarray = np.round(255.0 * (colors / 255.0) ** GAMMA).astype(np.uint8)
    return linear
