"""Displays the bodies of the world in RViz as interactive markers, and lets RViz's tools change the world.

Bodies are drawn in odom, because the Husky's TF has no frame of the world. When odom drifts, the markers are
sent again, so that they stay at the points that the lidar measures. A user can drag a body, and delete it by
its menu. The tool *Publish Point* adds a box, and the tool *2D Pose Estimate* moves the robot.
"""

from __future__ import annotations

import threading
from functools import partial
from math import acos, dist
from typing import Any, Callable, Dict, NamedTuple, Optional, Set

import rospy
import tf2_ros
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMsg
from interactive_markers.interactive_marker_server import InteractiveMarkerServer
from visualization_msgs.msg import InteractiveMarkerFeedback

from husky_highlevel_controller.datatypes import Body, Box, Geometry, Pose, Vector3
from husky_highlevel_controller.geometry import compose, inverse, pose_to_2d
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import contained
from husky_highlevel_controller.ros.simulator.call_queue import CallQueue
from husky_highlevel_controller.ros.simulator.object_markers import DELETE, body_to_msg, upwards
from husky_highlevel_controller.ros.simulator.publishers import ODOM, WORLD
from husky_highlevel_controller.ros.transforms import lookup_pose
from husky_highlevel_controller.simulator.bullet.world import ROBOT
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.spawn_request import ObjectError, checked, checked_pose

PERIOD = 0.1  # [s] simulated time between two checks for moved bodies
# [rad] a body that has tipped by more than this gets a new marker, which can be dragged horizontally
TIPPED_ANGLE = 0.1
NOTICEABLE_MOVE = 0.001  # [m] the marker of a body that has moved by less than this is not sent again
# [m] If odom turns so far that a point at this distance moves noticeably, all markers are sent again. Markers
# farther away move more, but the noise of the lidar's points hides this.
TURN_RADIUS = 2.0
# [m] edges of a new box, which is high enough for the lidar's scan plane, 0.44 m above the ground
BOX_SIZE = (0.4, 0.4, 0.8)
BOX_MASS = 5.0  # [kg]
BOX_COLOR = (0.75, 0.55, 0.35, 1.0)


class _Shown(NamedTuple):
    """Marker of a body as it was last sent."""

    body: Body
    # direction in the frame of the body that was vertical when the marker was made; the marker can be dragged
    # only perpendicular to this direction
    up: Vector3
    # pose of the body when the marker was sent; None if RViz has moved the marker since then, in a drag
    pose_in_world: Optional[Pose]

    def must_be_sent_again(self, pose: Pose) -> bool:
        """Return whether the marker is at a wrong place in RViz, when its body is at `pose` in the world."""
        if self.pose_in_world is None:
            return True
        if self.pose_in_world == pose:  # most bodies rest, and this comparison is faster than the next
            return False
        # a turn of the body counts as the motion of a point 1 m away from its origin
        return _noticeable(self.pose_in_world, pose, radius=1.0)


class _Server(InteractiveMarkerServer):
    """Interactive marker server that sends only when its owner calls `send`, in the thread of its owner.

    The library's own server also sends from a timer, and moves markers by itself.
    """

    def __init__(self, name: str, on_feedback: Callable[[InteractiveMarkerFeedback], None]) -> None:
        """Make a server whose topics begin with a name; `on_feedback` gets each action of a user."""
        self._on_feedback = on_feedback
        super().__init__(name)

    def __del__(self) -> None:
        """Send nothing when the process ends; the base class would erase all markers."""

    @property
    def is_watched(self) -> bool:
        """Return whether a node, such as RViz, shows the markers."""
        return bool(self.update_pub.get_num_connections())

    def keepAlive(self, _event: Any) -> None:  # noqa: N802
        """End the library's own timer, which calls this; `send` sends the keep-alives.

        RViz asks for all markers again if the numbers of the messages have a gap. A keep-alive of the timer
        could overtake an update, which makes such a gap. The timer would also wake at every tick of /clock.
        """
        timer = threading.current_thread()
        if isinstance(timer, rospy.Timer):
            timer.shutdown()

    def processFeedback(self, feedback: InteractiveMarkerFeedback) -> None:  # noqa: N802
        """Pass feedback on, and do not move the marker, because the simulation decides where a body is."""
        self._on_feedback(feedback)

    def send(self) -> None:
        """Send the changes of markers, and a keep-alive, without which RViz warns that the server is silent.

        This is also done in a pause, in which the library's timer would send nothing.
        """
        try:
            self.applyChanges()
            super().keepAlive(None)  # the library's method, because this subclass overrides `keepAlive`
        except (rospy.ROSException, ValueError):  # the topics may already be closed at the end of the node
            if not rospy.core.is_shutdown_requested():
                raise


class WorldDisplay:
    """Shows the simulation's bodies; only the thread that owns the simulation makes and updates it."""

    def __init__(self, simulation: Simulation, calls: CallQueue) -> None:
        """Set up the markers, and subscribe to RViz's tools."""
        self._simulation, self._calls = simulation, calls
        self._shown_markers: Dict[str, _Shown] = {}  # last state that was sent of each body, by its name
        self._world_in_odom = Pose()  # pose of the world in odom when all objects were last drawn
        self._next_refresh = 0.0  # [s] simulated time of the next refresh
        self._dragged: Set[str] = set()  # names of the markers that a user is dragging now
        # buffer of TF, which the tools need; None until one of RViz's tools is connected
        self._transforms: Optional[tf2_ros.Buffer] = None
        self._server = _Server("~world", self._on_feedback)
        # the tool Publish Point publishes clicked points, the tool 2D Pose Estimate publishes poses
        on_point, on_pose = partial(self._ask, self._drop_box), partial(self._ask, self._move_robot)
        self._tools = (
            rospy.Subscriber("clicked_point", PointStamped, on_point, queue_size=10),
            rospy.Subscriber("initialpose", PoseWithCovarianceStamped, on_pose, queue_size=10),
        )

    def update(self, stamp: float) -> None:
        """Refresh the markers every PERIOD of simulated time; call this after each step, at `stamp` [s]."""
        if stamp >= self._next_refresh:
            self._next_refresh = stamp + PERIOD - 1e-6  # slightly earlier, because of rounding errors
            self.refresh()

    def refresh(self) -> None:
        """Draw new and moved bodies, and erase deleted bodies, if a node shows the markers."""
        if self._transforms is None and any(tool.get_num_connections() for tool in self._tools):
            # this node listens to TF only when one of RViz's tools is connected, because TF costs CPU time
            self._transforms = tf2_ros.Buffer(debug=False)
            tf2_ros.TransformListener(self._transforms)
        if self._server.is_watched:
            # an error in the drawing does not stop the simulation
            with contained("drawing the world's objects"):
                self._draw()
                self._server.send()

    def _draw(self) -> None:
        """Bring the markers up to date with the world: erase, insert and move them.

        A marker is sent again if its body has moved noticeably, if a user has dragged the marker, or if odom
        has drifted.
        """
        bodies, world_in_odom = self._simulation.bodies, self._simulation.pose_world_in_odom
        # bodies are drawn in odom, so a drift of odom moves all markers
        has_drifted = _noticeable(self._world_in_odom, world_in_odom, TURN_RADIUS)
        if has_drifted:
            self._world_in_odom = world_in_odom
        deleted_bodies = self._shown_markers.keys() - bodies.keys()
        for name in deleted_bodies:
            self._server.erase(name)
            del self._shown_markers[name]
        for name, body in bodies.items():
            shown = self._shown_markers.get(name)  # None if the body has no marker yet
            if shown and shown.body is not body:
                # the marker belongs to a deleted body of the same name, so this body has no marker yet
                shown = None
            pose = self._simulation.pose_of(name)
            if shown is None or has_drifted or shown.must_be_sent_again(pose):
                self._shown_markers[name] = self._send(body, pose, shown)

    def _send(self, body: Body, pose: Pose, shown: Optional[_Shown]) -> _Shown:
        """Move the marker of a body, or send a new marker if it has none, or if the body has tipped.

        A marker can be dragged only in the plane that was horizontal when it was made. So after the body has
        tipped, a drag of its old marker would not be horizontal.

        Args:
            body: the body.
            pose: its pose in the world.
            shown: its marker as it was last sent; None if it has none.

        Returns:
            The marker as it is now sent.
        """
        pose_in_odom, up = compose(self._world_in_odom, pose), upwards(pose)
        has_tipped = shown is not None and dist(shown.up, up) >= TIPPED_ANGLE
        if shown is None or has_tipped:
            self._server.insert(body_to_msg(body, pose_in_odom, ODOM))
            return _Shown(body, up, pose)
        self._server.setPose(body.name, conversions.pose_to_msg(pose_in_odom))
        return shown._replace(pose_in_world=pose)  # `up` stays, because the marker was not made again

    def _drop_box(self, msg: PointStamped) -> str:
        """Put a box on a point that was clicked in RViz, and return a sentence for the log."""
        clicked = self._in_world(PoseMsg(msg.point, Quaternion(w=1.0)), msg.header.frame_id)
        x, y, z = clicked.position
        _, _, height = BOX_SIZE
        upright = Pose((x, y, z + height / 2.0))  # the pose of a box is the pose of its middle
        geometry = Geometry(Box(BOX_SIZE), rgba=BOX_COLOR)
        used_names = {*self._simulation.bodies, *self._simulation.models}
        number = 1
        while f"box_{number}" in used_names:
            number += 1
        box = Body(f"box_{number}", upright, collisions=(geometry,), visuals=(geometry,), mass=BOX_MASS)
        self._simulation.spawn([checked(box)])
        return f"'{box.name}' was added"

    def _move_robot(self, msg: PoseWithCovarianceStamped) -> str:
        """Put the robot at a pose that was set in RViz, and return a sentence for the log."""
        pose = self._in_world(msg.pose.pose, msg.header.frame_id)
        self._simulation.move_robot_level(pose_to_2d(pose))
        return f"'{ROBOT}' was moved"

    def _drag(self, feedback: InteractiveMarkerFeedback) -> str:
        """Put a body where its marker was dragged, and return a sentence for the log."""
        name = feedback.marker_name
        shown = self._shown_markers.get(name)
        if shown is not None:
            # RViz has already moved the marker. The pose None lets `_draw` send the marker again, at the pose
            # of the body. This is also necessary if the body cannot be moved, and stays where it is.
            self._shown_markers[name] = shown._replace(pose_in_world=None)
        x, y, _ = self._in_world(feedback.pose, feedback.header.frame_id).position
        now = self._simulation.pose_of(name)
        _, _, height = now.position  # a body is dragged only horizontally, so it keeps its height
        self._simulation.move(name, now._replace(position=(x, y, height)))
        return f"'{name}' was moved"

    def _delete(self, feedback: InteractiveMarkerFeedback) -> str:
        """Delete the body of a marker, and return a sentence for the log."""
        self._simulation.delete(feedback.marker_name)
        return f"'{feedback.marker_name}' was deleted"

    def _in_world(self, msg: PoseMsg, frame: str) -> Pose:
        """Convert a pose in a frame to the world; ObjectError if the pose or the frame is not valid."""
        pose = checked_pose(conversions.pose_from_msg(msg))
        frame = frame.lstrip("/")
        if frame == WORLD:  # the frame of Gazebo's window, which is not on /tf
            return pose
        odom_in_world = inverse(self._simulation.pose_world_in_odom)
        frame_in_world = compose(odom_in_world, self._frame_in_odom(frame))
        return checked_pose(compose(frame_in_world, pose))

    def _frame_in_odom(self, frame: str) -> Pose:
        """Return the pose of a frame in odom; ObjectError if TF does not have it."""
        if frame == ODOM:
            return Pose()
        # TF is updated faster than a person can click, so the latest transform is good enough
        pose = None if self._transforms is None else lookup_pose(self._transforms, ODOM, frame)
        if pose is None:
            raise ObjectError(f"no transform from '{frame}' to '{ODOM}'")
        return pose

    def _on_feedback(self, feedback: InteractiveMarkerFeedback) -> None:
        """Delete the body of a marker if its menu was used, and move the body at the end of a drag."""
        name, event = feedback.marker_name, feedback.event_type
        if event == InteractiveMarkerFeedback.MENU_SELECT and feedback.menu_entry_id == DELETE:
            self._ask(self._delete, feedback)
        # RViz sends this event again and again during a drag
        elif event == InteractiveMarkerFeedback.POSE_UPDATE:
            self._dragged.add(name)
        elif event == InteractiveMarkerFeedback.MOUSE_UP and name in self._dragged:
            # MOUSE_UP also comes after a click without a drag; then the marker is not in `_dragged`
            self._dragged.remove(name)
            self._ask(self._drag, feedback)

    def _ask(self, work: Callable[[Any], str], msg: Any) -> None:
        """Let the simulation's thread call `work(msg)`, and log the sentence that it returns.

        rospy calls this in other threads, which must not use the simulation.
        """
        done, sentence = self._calls.ask(partial(work, msg))
        if done:
            rospy.loginfo(f"RViz: {sentence}")


def _noticeable(before: Pose, after: Pose, radius: float) -> bool:
    """Return whether a body has moved or turned so far that its marker in RViz must be moved.

    A turn counts as the motion of a point at the distance `radius` [m] from the body's origin.
    """
    # the scalar product of two unit quaternions is the cosine of half the angle between them
    cosine_of_half_turn = abs(sum(a * b for a, b in zip(before.quat_xyzw, after.quat_xyzw)))
    turn = 2.0 * acos(min(1.0, cosine_of_half_turn))
    return dist(before.position, after.position) + radius * turn > NOTICEABLE_MOVE
