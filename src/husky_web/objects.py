"""Interactive markers, the objects of the world: drawn, dragged over the ground and deleted, as in RViz."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, NamedTuple, Tuple
from urllib.parse import quote

import rospy
import viser
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerControl,
    InteractiveMarkerFeedback,
    InteractiveMarkerInit,
    InteractiveMarkerUpdate,
)

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import publish
from husky_web.backdrop import SHADOW_HEIGHT, contact_shadow
from husky_web.drawing import add_pieces, bounds, clickable, on_error_log_and_skip
from husky_web.frames import Frames
from husky_web.markers import frame_of_message, pose_of, primitives
from husky_web.shapes import Piece, Solid
from husky_web.topics import Received
from husky_web.viser_private import place

# [m] if a part of an object is wider than this, the part counts as ground, and is not drawn, because the page
# draws its own ground
WIDEST = 50.0
CONTROL = "body"  # name of the control in the simulator's interactive markers
MOVABLE = (
    InteractiveMarkerControl.MOVE_PLANE,
    InteractiveMarkerControl.MOVE_ROTATE,
    InteractiveMarkerControl.MOVE_3D,
    InteractiveMarkerControl.MOVE_ROTATE_3D,
)


class ObjectKey(NamedTuple):
    """Name of an interactive marker on the network."""

    topic: str  # topic on which the server of the marker sends its changes
    name: str


class Object(NamedTuple):
    """Interactive marker that is drawn."""

    node: Any
    frame: str
    pose_in_frame: Pose
    shapes: List[Any]  # nodes of the scene that can be clicked
    menu: Tuple[Tuple[int, str], ...]  # id and title of each entry of the menu
    is_movable: bool


class Objects:
    """The interactive markers of every server on the network."""

    def __init__(self, server: viser.ViserServer, frames: Frames, fixed_frame: str) -> None:
        self._scene, self._frames, self._fixed_frame = server.scene, frames, fixed_frame
        self.shown: Dict[ObjectKey, Object] = {}
        # function that binds the mouse to a new object
        self.on_new: Callable[[ObjectKey, Object], None] = lambda key, shown: None
        self.dragged: Dict[ObjectKey, Pose] = {}  # pose of each object that a page drags, in the fixed frame
        # publisher of feedback to each server; the key is the server's name
        self._feedback: Dict[str, rospy.Publisher] = {}

    def update(self, received: List[Received]) -> None:
        """Take in messages of servers, then move all objects to their present poses."""
        for topic, msg in received:
            with on_error_log_and_skip(topic):
                self._take(topic, msg)
        for key, shown in self.shown.items():
            with on_error_log_and_skip(f"'{key.name}' of {key.topic}"):
                frame_in_fixed = self._frames.pose(shown.frame, self._fixed_frame)
                # a dragged object follows the mouse; poses that its server sends do not count
                if key in self.dragged:
                    place(shown.node, self.dragged[key])
                elif frame_in_fixed is not None:
                    place(shown.node, compose(frame_in_fixed, shown.pose_in_frame))

    def _take(self, topic: str, msg: Any) -> None:
        """Take in a server's change, or the message with all its markers that a server sends at the start."""
        if isinstance(msg, InteractiveMarkerInit):
            # this message has come on SERVER/update_full, but the keys of `shown` have the topic
            # SERVER/update, so the ending is removed
            update_topic = topic[: -len("_full")]
            names = {marker.name for marker in msg.markers}
            # objects that the server no longer has are removed, and objects that are not shown yet are added;
            # the others stay, because their changes come on the other topic
            for key in list(self.shown):
                if key.topic == update_topic and key.name not in names:
                    self._erase(key)
            for marker in msg.markers:
                if ObjectKey(update_topic, marker.name) not in self.shown:
                    self._insert(update_topic, marker)
        elif msg.type == InteractiveMarkerUpdate.UPDATE:
            for marker in msg.markers:
                self._insert(topic, marker)
            for moved in msg.poses:
                key, pose = ObjectKey(topic, moved.name), conversions.pose_from_msg(moved.pose)
                if key in self.shown:
                    self.shown[key] = self.shown[key]._replace(pose_in_frame=pose)
            for name in msg.erases:
                self._erase(ObjectKey(topic, name))

    def clear(self) -> None:
        """Remove all objects, and the publishers to their servers."""
        for key in list(self.shown):
            self._erase(key)
        for publisher in self._feedback.values():
            publisher.unregister()
        self._feedback.clear()

    def drop(self, key: ObjectKey, pose_in_fixed: Pose) -> None:
        """Report to the server that a marker was dragged to a pose in the fixed frame.

        The server then moves the object. Without a report, the object goes back to its pose before the drag.
        """
        shown = self.shown.get(key)
        if shown is None:  # the server has removed the marker during the drag
            return
        frame_in_fixed = self._frames.pose(shown.frame, self._fixed_frame)
        if frame_in_fixed is None:  # the report needs the pose in the marker's frame, which is unknown now
            return
        pose = compose(inverse(frame_in_fixed), pose_in_fixed)  # pose of the marker in its frame
        # RViz sends the same two events at the end of a drag: the new pose, and the release of the mouse
        for event in (InteractiveMarkerFeedback.POSE_UPDATE, InteractiveMarkerFeedback.MOUSE_UP):
            self._send(key, shown, pose, event, entry=0)

    def delete(self, key: ObjectKey) -> bool:
        """Choose *Delete* in a marker's menu, and return whether it has such an entry."""
        shown = self.shown[key]
        for number, title in shown.menu:
            if title.lower() == "delete":
                event = InteractiveMarkerFeedback.MENU_SELECT
                self._send(key, shown, shown.pose_in_frame, event, number)
                return True
        return False

    def _send(self, key: ObjectKey, shown: Object, pose: Pose, event: int, entry: int) -> None:
        """Report an event on a marker to its server.

        Args:
            key: name of the marker, and topic of its server.
            shown: the marker.
            pose: pose of the marker in its frame.
            event: type of the event, a constant of InteractiveMarkerFeedback.
            entry: id of the chosen entry of the menu; 0 if there is none.
        """
        msg = InteractiveMarkerFeedback(
            client_id=rospy.get_name(),
            marker_name=key.name,
            control_name=CONTROL,
            event_type=event,
            menu_entry_id=entry,
            pose=conversions.pose_to_msg(pose),
        )
        msg.header.frame_id = shown.frame
        publish(self._feedback_publisher(key.topic), msg)

    def _feedback_publisher(self, topic: str) -> rospy.Publisher:
        """Return the publisher of feedback to the server with this topic, a new one if there is none yet."""
        server = topic.rsplit("/", 1)[0]
        if server not in self._feedback:
            self._feedback[server] = rospy.Publisher(
                f"{server}/feedback", InteractiveMarkerFeedback, queue_size=10
            )
        return self._feedback[server]

    def _insert(self, topic: str, marker: InteractiveMarker) -> None:
        """Draw an interactive marker of the server with this topic, in place of its earlier drawing."""
        key = ObjectKey(topic, marker.name)
        self._erase(key)
        # the publisher is made now, so that it is connected before the first drag ends
        self._feedback_publisher(topic)
        # slashes in the names are replaced, because viser would read each as a level of its tree of nodes
        path = f"/objects/{quote(topic, safe='')}/{quote(marker.name, safe='')}"
        node = self._scene.add_frame(path, show_axes=False)
        shapes = self._draw_parts(path, marker)
        if shapes:
            low, high = bounds(shapes)
            # the shadow is just above the height of the object's lowest point
            x, y, _ = (low + high) / 2.0
            center = (x, y, low[2] + SHADOW_HEIGHT)
            contact_shadow(self._scene, f"{path}/shadow", high - low, center)
        self.shown[key] = Object(
            node=node,
            frame=frame_of_message(marker),
            pose_in_frame=conversions.pose_from_msg(marker.pose),
            shapes=shapes,
            menu=tuple((entry.id, entry.title) for entry in marker.menu_entries),
            is_movable=any(control.interaction_mode in MOVABLE for control in marker.controls),
        )
        self.on_new(key, self.shown[key])

    def _draw_parts(self, path: str, marker: InteractiveMarker) -> List[Any]:
        """Draw the parts of an interactive marker below the node at `path`, and return the drawn shapes.

        A part without a valid pose is left out, as in RViz. A ground is left out, because the page draws its
        own.
        """
        shapes: List[Any] = []
        parts = [part for control in marker.controls for part in control.markers]
        for number, part in enumerate(parts):
            pose = pose_of(part)
            if pose is not None:
                pieces = [piece for piece in primitives(part) if not _is_ground(piece)]
                shapes += clickable(add_pieces(self._scene, f"{path}/{number}", pieces, pose))
        return shapes

    def _erase(self, key: ObjectKey) -> None:
        """Remove an object from the view, if it is shown."""
        shown = self.shown.pop(key, None)
        self.dragged.pop(key, None)
        if shown is not None:
            shown.node.remove()


def _is_ground(piece: Piece) -> bool:
    """Return whether a piece is so wide that the page's own ground replaces it."""
    return isinstance(piece, Solid) and bool(piece.extents[:2].min() > WIDEST)
