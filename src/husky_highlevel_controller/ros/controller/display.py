"""RViz markers and rqt_plot topics of the controller: pillar, estimate, path, target, state."""

from __future__ import annotations

import threading
from collections import deque
from math import hypot, inf
from typing import Any, Deque, Dict, List, Optional, Sequence, Set, Tuple

import rospy
from geometry_msgs.msg import Point, PointStamped, Pose, Quaternion, Vector3, Vector3Stamped
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller.controller.behaviour import ControlOutput, Observation, State
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.geometry import inverse, transform_point
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import NewSubscribers, publish

ODOM, BASE = "odom", "base_link"
# Namespaces of the markers, and their colours. IN_ODOM and IN_LASER are the markers of the exercise sheet,
# which are sent one by one. The other markers are an addition of this package, and are sent as an array.
IN_ODOM, IN_LASER = "pillar_in_odom", "pillar_in_laser"
ESTIMATE, PATH, TARGET, STATE = "estimate", "path", "target", "state"
COLORS = {
    # this colour is opaque, because at some angles RViz would draw a transparent cylinder over the other
    # markers
    IN_ODOM: ColorRGBA(1.0, 0.45, 0.0, 1.0),
    IN_LASER: ColorRGBA(0.0, 0.6, 1.0, 1.0),
    ESTIMATE: ColorRGBA(0.2, 0.9, 0.3, 0.5),
    PATH: ColorRGBA(0.3, 0.7, 1.0, 1.0),
    TARGET: ColorRGBA(1.0, 1.0, 0.2, 1.0),
    STATE: ColorRGBA(1.0, 1.0, 1.0, 1.0),
}
# [s] time between two arrays of markers, by the stamps of the scans; slightly below 0.1 s, because stamps are
# rounded
ARRAY_PERIOD = 0.099
PATH_STEP = 0.1  # [m] distance between two points of the driven path
PATH_POINTS = 1000  # largest number of points of the driven path; if there are more, the oldest are removed
ABOVE_ROBOT = 1.0  # [m] height above base_link of the text with the state, if no pillar is known
TEXT_ANGLE = 0.022  # [rad] angle that the height of the text covers in the view of RViz's camera
CAMERA_BEHIND = 8.0  # [m] distance of RViz's camera from the robot in rviz/controller.rviz
# The cylinder IN_LASER is drawn smaller than the cylinder IN_ODOM by this factor, because two equal cylinders
# flicker in RViz. So IN_LASER is visible only while IN_ODOM is switched off. The factor is larger than 0.95,
# because the simulator draws its pillar with 0.95 of the real size, and this pillar must not hide IN_LASER.
INNER_SCALE = 0.98
DISC_HEIGHT = 0.02  # [m]
# [m] smallest distance from the pillar to the rim of the disc that shows the uncertainty of the pillar's
# position; with a smaller distance, the disc would not be visible
MIN_SPREAD = 0.05


class Display:
    """Publishes markers for RViz, and numbers for rqt_plot, for each scan that the controller has answered.

    The numbers are the pillar's position and the errors of distance and bearing. A topic without a subscriber
    costs no time.
    """

    def __init__(self, robot: Robot) -> None:
        """Advertise the topics.

        The wheels of `robot` give the height of the ground, which is the same in base_link and in odom.
        """
        # [m] height of the ground in base_link and odom
        self._ground_height = robot.wheels.height - robot.drive.wheel_radius
        self._new_subscribers = NewSubscribers()
        self._marker_publisher = rospy.Publisher(
            "~visualization_marker", Marker, self._new_subscribers, queue_size=10
        )
        self._array_publisher = rospy.Publisher(
            "~visualization_marker_array", MarkerArray, self._new_subscribers, queue_size=10
        )
        self._pillar_publisher = rospy.Publisher("~pillar", PointStamped, queue_size=10)
        self._error_publisher = rospy.Publisher("~error", Vector3Stamped, queue_size=10)
        self._path: Deque[Point] = deque(maxlen=PATH_POINTS)  # driven path, points in odom
        # namespaces of the markers that RViz shows, by topic; RViz keeps a marker until a message deletes it
        self._shown_namespaces: Dict[rospy.Publisher, Set[str]] = {
            self._marker_publisher: set(),
            self._array_publisher: set(),
        }
        # [s] stamp of the scan that the last array of markers shows; -inf if the next array is due at once
        self._array_stamp = -inf
        # state of the controller that the last array of markers shows; None before the first array
        self._array_state: Optional[State] = None
        # arguments of the last `show`, repeated for a subscriber that comes later
        self._last_shown: Optional[Tuple[Observation, ControlOutput, float, float]] = None
        # lock that is held while a scan is shown, because `show` and `update` are called by different threads
        self._lock = threading.Lock()

    def show(
        self, observation: Observation, output: ControlOutput, stop_distance: float, pillar_height: float
    ) -> None:
        """Show a scan and the controller's answer to it.

        Args:
            observation: the scan, and where its lidar was.
            output: the answer to the scan.
            stop_distance: distance from the lidar to the pillar's surface at the stop [m].
            pillar_height: height of the pillar's top above the ground [m].
        """
        with self._lock:
            self._last_shown = (observation, output, stop_distance, pillar_height)
            self._show(*self._last_shown)

    @property
    def viewers(self) -> List[str]:
        """Names of the nodes that show the markers."""
        return [link.endpoint_id for link in self._marker_publisher.impl.connections]

    def update(self) -> None:
        """Show the last scan again if a node has subscribed, because no new scan may come. Call it often."""
        if self._new_subscribers.take():
            with self._lock:
                if self._last_shown is not None:
                    self._array_stamp = -inf  # the array is due at once, also before ARRAY_PERIOD is over
                    self._show(*self._last_shown)

    def _show(
        self, observation: Observation, output: ControlOutput, stop_distance: float, pillar_height: float
    ) -> None:
        """Extend the path, and publish everything that has a subscriber.

        The pillar's markers and the numbers are published for every scan. The array of markers is published
        every ARRAY_PERIOD, and at once if the state has changed.
        """
        stamp = observation.scan.stamp
        # `moved`: the robot was put elsewhere, or odom was reset. A new path begins, because the robot has
        # not driven from the last point of the path to its new place.
        if output.moved:
            self._path.clear()
            self._array_stamp = -inf  # the array is due at once
        if observation.base_in_odom is not None:
            self._extend_path(observation.base_in_odom)
        if self._marker_publisher.get_num_connections():
            pillars = _pillar_markers(observation, output, self._ground_height, pillar_height)
            for each in self._with_deletions(self._marker_publisher, pillars, stamp):
                publish(self._marker_publisher, each)
        has_state_changed = output.state is not self._array_state
        is_array_due = has_state_changed or stamp >= self._array_stamp + ARRAY_PERIOD
        if is_array_due and self._array_publisher.get_num_connections():
            self._publish_array(observation, output, stop_distance, pillar_height)
            self._array_stamp, self._array_state = stamp, output.state
        self._publish_numbers(stamp, output)

    def _publish_array(
        self, observation: Observation, output: ControlOutput, stop_distance: float, pillar_height: float
    ) -> None:
        """Publish the markers of the estimate, the stop point, the state and the driven path as one message.

        Args:
            observation: the scan, and where its lidar was.
            output: the answer to the scan.
            stop_distance: distance from the lidar to the pillar's surface at the stop [m].
            pillar_height: height of the pillar's top above the ground [m].
        """
        stamp = observation.scan.stamp
        markers = _estimate_markers(observation, output, stop_distance)
        top = self._ground_height + pillar_height  # [m] height of the pillar's top in base_link
        markers.append(_state_marker(stamp, output, top))
        if len(self._path) > 1:  # a line needs two points
            # [m] only x is the width of the line in RViz
            points, width = list(self._path), (0.04, 0.0, 0.0)
            markers.append(marker(Marker.LINE_STRIP, PATH, stamp, ODOM, width, points=points))
        markers = self._with_deletions(self._array_publisher, markers, stamp)
        publish(self._array_publisher, MarkerArray(markers))

    def _extend_path(self, base_in_odom: Pose2D) -> None:
        """Add the position of the robot to the driven path if it is PATH_STEP away from the last point."""
        if self._path:
            last = self._path[-1]
            if hypot(base_in_odom.x - last.x, base_in_odom.y - last.y) < PATH_STEP:
                return
        self._path.append(Point(base_in_odom.x, base_in_odom.y, 0.0))

    def _with_deletions(
        self, publisher: rospy.Publisher, markers: List[Marker], stamp: float
    ) -> List[Marker]:
        """Return the markers, and messages that delete the markers that RViz still shows but should not.

        RViz shows a marker until a message deletes it. Each namespace has one marker, so the namespace is
        enough to delete it.

        Args:
            publisher: publisher of the topic on which the markers are sent.
            markers: markers that RViz should show now.
            stamp: stamp of the scan [s].
        """
        namespaces = {each.ns for each in markers}
        ended = self._shown_namespaces[publisher] - namespaces
        header = conversions.header(stamp, BASE)
        deletions = [Marker(header=header, ns=namespace, action=Marker.DELETE) for namespace in ended]
        self._shown_namespaces[publisher] = namespaces
        return markers + deletions

    def _publish_numbers(self, stamp: float, output: ControlOutput) -> None:
        """Publish the pillar's centre in base_link, and the errors of distance [m] and bearing [rad].

        Nothing is published if the position of the pillar is unknown.
        """
        if output.target_in_base is None:
            return
        if self._pillar_publisher.get_num_connections():
            point = Point(*output.target_in_base, 0.0)
            publish(self._pillar_publisher, PointStamped(conversions.header(stamp, BASE), point))
        if self._error_publisher.get_num_connections():
            error = Vector3(output.distance_error, output.bearing_error, 0.0)
            publish(self._error_publisher, Vector3Stamped(conversions.header(stamp, BASE), error))


def marker(
    kind: int,
    namespace: str,
    stamp: float,
    frame: str,
    size: Sequence[float],
    position: Optional[Point] = None,
    **fields: Any,
) -> Marker:
    """Return a marker in the colour of its namespace.

    Args:
        kind: shape, one of the constants of Marker.
        namespace: one of the keys of COLORS; RViz keeps one marker of each namespace.
        stamp: stamp of the scan that the marker shows [s].
        frame: frame of the position.
        size: lengths along x, y and z [m]; of a line (width, 0, 0), of a text (0, 0, height).
        position: centre; the origin of the frame if None.
        **fields: further fields of the message.
    """
    return Marker(
        header=conversions.header(stamp, frame),
        ns=namespace,
        type=kind,
        # w is 1, because a quaternion of zeros would not be a valid rotation
        pose=Pose(position or Point(), Quaternion(w=1.0)),
        scale=Vector3(*size),
        color=COLORS[namespace],
        **fields,
    )


def _pillar_markers(
    observation: Observation, output: ControlOutput, ground: float, height: float
) -> List[Marker]:
    """Return the cylinders of this scan's pillar: in the frame of the lidar and, if TF has it, in odom.

    The diameter of the cylinders is measured. Their height is an argument, because a planar scan does not
    show it.

    Args:
        observation: the scan, and the poses at its stamp.
        output: the answer to the scan, with the pillar; no cylinder if this scan does not show the pillar.
        ground: height of the ground in base_link, and also in odom [m].
        height: height of the pillar's top above the ground [m].
    """
    pillar, stamp = output.pillar, observation.scan.stamp
    if pillar is None:
        return []
    width = 2.0 * pillar.radius  # [m]
    middle = ground + height / 2.0  # [m] height of the pillar's middle in base_link, and also in odom
    # the cylinder in the frame of the lidar is slightly smaller, because two equal cylinders flicker in RViz
    size = (INNER_SCALE * width, INNER_SCALE * width, INNER_SCALE * height)
    center = Point(pillar.x, pillar.y, _height_in_laser(observation, middle))
    markers = [marker(Marker.CYLINDER, IN_LASER, stamp, observation.scan.frame, size, center)]
    if output.pillar_in_odom is not None:
        x, y, _ = output.pillar_in_odom
        size, center = (width, width, height), Point(x, y, middle)
        markers.append(marker(Marker.CYLINDER, IN_ODOM, stamp, ODOM, size, center))
    return markers


def _height_in_laser(observation: Observation, height: float) -> float:
    """Convert a height above base_link [m] to the z coordinate in the frame of the lidar [m].

    The lidar is level, but may be upside-down, so its z axis may point down.
    """
    if observation.laser_in_base is None:
        return 0.0  # the cylinder is then drawn in the plane of the scan
    # for a level lidar, z does not depend on the place, so any point at this height will do
    x, y, _ = observation.laser_in_base.position
    return float(transform_point(inverse(observation.laser_in_base), (x, y, height))[2])


def how_to_drive_again(viewers: Sequence[str], reset_service: str) -> str:
    """Return a sentence for the log on how to drive again; it names RViz and the web page only if they run.

    Args:
        viewers: names of the nodes that show the markers.
        reset_service: name of the simulator's service that puts the robot back; empty for a real robot.
    """
    if not reset_service:
        return "to drive again, move the robot or the pillar; Ctrl-C ends the launch"
    actions = []
    if any("husky_web" in name for name in viewers):
        actions.append("press Drive again in the page")
    if any("rviz" in name for name in viewers):
        actions.append("put the robot elsewhere with RViz's 2D Pose Estimate")
    action = " or ".join(actions) or f"rosservice call {reset_service}"
    return f"to drive again, {action}; Ctrl-C ends the launch"


def _estimate_markers(observation: Observation, output: ControlOutput, stop_distance: float) -> List[Marker]:
    """Return a disc for the remembered pillar, and a ball for the point where the lidar shall stop.

    The part of the disc around the pillar is a ring, which shows the uncertainty of the pillar's position.
    Without a remembered pillar, there is no marker.

    Args:
        observation: the scan, and where its lidar was.
        output: the answer to the scan.
        stop_distance: distance from the lidar to the pillar's surface at the stop [m].
    """
    estimate, stamp = output.estimate, observation.scan.stamp
    if estimate is None:
        return []
    # [m] width of the ring: two standard deviations, but at least MIN_SPREAD
    spread = max(2.0 * estimate.deviation, MIN_SPREAD)
    diameter = 2.0 * (estimate.radius + spread)
    size, center = (diameter, diameter, DISC_HEIGHT), Point(estimate.x, estimate.y, 0.0)
    markers = [marker(Marker.CYLINDER, ESTIMATE, stamp, ODOM, size, center)]
    if output.target_in_base is not None and observation.laser_in_base is not None:
        goal = _stop_point(observation, output, stop_distance + estimate.radius)
        ball_size = (0.16, 0.16, 0.16)  # [m]
        markers.append(marker(Marker.SPHERE, TARGET, stamp, BASE, ball_size, goal))
    return markers


def _state_marker(stamp: float, output: ControlOutput, top: float) -> Marker:
    """Return the state as a text above the pillar, or above the robot if the pillar's position is unknown.

    Args:
        stamp: stamp of the scan [s].
        output: the answer to the scan.
        top: height of the pillar's top in base_link [m].
    """
    text = output.state.value
    if output.target_in_base is not None and output.state is not State.ARRIVED:
        text += f", {output.distance_error:.2f} m to go"
    x, y = output.target_in_base or (0.0, 0.0)
    # [m] height of the letters; it grows with the distance from RViz's camera, which is about CAMERA_BEHIND
    # behind the robot, so that the text always looks equally large
    text_height = TEXT_ANGLE * (CAMERA_BEHIND + hypot(x, y))
    # [m] a text is centred on its position, so `text_height` leaves a gap between the pillar and the text
    z = ABOVE_ROBOT if output.target_in_base is None else top + text_height
    size = (0.0, 0.0, text_height)
    return marker(Marker.TEXT_VIEW_FACING, STATE, stamp, BASE, size, Point(x, y, z), text=text)


def _stop_point(observation: Observation, output: ControlOutput, from_center: float) -> Point:
    """Return the point in base_link at which the lidar is to stop, on the straight way to the pillar.

    `from_center` is the distance of this point from the pillar's centre [m].
    """
    # both are known, because the caller has tested it
    assert output.target_in_base is not None
    assert observation.laser_in_base is not None
    x, y = output.target_in_base
    laser_x, laser_y, _ = observation.laser_in_base.position
    distance = hypot(x - laser_x, y - laser_y)  # [m] pillar's centre to the lidar
    # distance of the stop point from the pillar's centre, as a fraction of the way from the centre to the
    # lidar; the limit avoids a division by 0
    fraction = from_center / max(distance, 1e-6)
    return Point(x + fraction * (laser_x - x), y + fraction * (laser_y - y), 0.0)
