"""The controller's node: its commands, log, arrivals and markers, in a flat world without a network."""

import re
from dataclasses import fields, replace
from io import BytesIO
from math import atan2, hypot
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy
from geometry_msgs.msg import Twist
from scenes import Toy
from std_srvs.srv import SetBoolRequest
from visualization_msgs.msg import Marker

from husky_highlevel_controller.controller.behaviour import Observation
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.geometry import inverse, pose_from_2d, transform_point
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros.controller import node
from husky_highlevel_controller.ros.controller.node import ControllerNode, ScanTopicConfig, StartStopConfig

X, Y, RADIUS = 4.0, 1.5, 0.2  # [m], of the pillar in odom
STOP_DISTANCE, LASER_X, LASER_Z = 0.4, 0.337, 0.308  # [m]
HEIGHT, GROUND = 2.0, -0.132  # [m], of the pillar, and in base_link


class Topic:
    """A publisher with a subscriber, who gets what was sent by bytes as through a network."""

    impl = SimpleNamespace(connections=())

    def __init__(self, kind, latch):
        self.kind, self.latch, self.sent = kind, latch, []

    def publish(self, msg):
        sent = BytesIO()
        msg.serialize(sent)
        self.sent.append(self.kind().deserialize(sent.getvalue()))

    def get_num_connections(self):
        return 1


class Controller:
    """A node, what it has published and logged, and a robot whose scans it answers."""

    def __init__(self, monkeypatch, **parameters):
        self.topics, self.listener, self.log, self.warnings = {}, None, [], []
        self.toy = Toy([(X, Y, RADIUS)], period=0.1)
        records = (ScanTopicConfig(), StartStopConfig(), ControlConfig(), PillarConfig())
        values = {each.name: each.default for record in records for each in fields(record) if each.metadata}
        for name, value in {
            "Publisher": self.advertise,
            "Subscriber": Mock(),
            "Service": self.offer,
            "on_shutdown": Mock(),
            "get_name": lambda: "/controller",
            "resolve_name": str,
            "get_time": lambda: self.toy.time,
            "loginfo": lambda text, *words: self.log.append(text % words if words else text),
            "logwarn": self.warnings.append,
        }.items():
            monkeypatch.setattr(rospy, name, value)
        monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: False)
        monkeypatch.setattr(node, "parameters_and_robot", lambda: ({**values, **parameters}, load_robot()))
        monkeypatch.setattr(node, "ReconfigureServer", lambda _, *records: SimpleNamespace(records=records))
        monkeypatch.setattr(node, "ScanPlacement", self.place)
        for name in ("tf2_ros", "Listener", "Diagnostics"):
            monkeypatch.setattr(node, name, Mock())
        monkeypatch.setattr(node, "RegistrationWatch", self.watch)
        self.node = ControllerNode(None)

    def advertise(self, name, kind, listener=None, latch=False, **_):
        self.listener = listener or self.listener
        return self.topics.setdefault(name, Topic(kind, latch))

    def offer(self, name, _kind, callback):
        self.service, self.start_stop = name, lambda wanted: callback(SetBoolRequest(wanted))

    def watch(self, stand):
        self.registration = SimpleNamespace(is_lost=False, start=Mock(), lose=stand)
        return self.registration

    def place(self, _transforms, answer, _outline):
        self.answer_observation = answer
        return Mock()

    def answer(self, ranges=None):
        """The command that answers a scan, of what the robot sees unless there are ranges; it drives on."""
        toy = self.toy
        scan = toy.scan() if ranges is None else replace(toy.scan(), ranges=ranges)
        self.answer_observation(Observation(scan, toy.laser_in_base, toy.pose))
        toy.step()
        return self.topics["cmd_vel"].sent[-1]

    def answer_at(self, distance):
        """Answer the scan of a robot so far before the pillar, which it looks at [m]."""
        self.toy.pose = Pose2D(X - RADIUS - LASER_X - distance, Y)
        return self.answer()

    def drive(self, seconds):
        """The last scan's pose of the robot."""
        for _ in range(round(seconds / self.toy.period)):
            pose = self.toy.pose
            self.answer()
        return pose

    def sent(self, topic):
        return self.topics[topic].sent

    def markers(self):
        """Those of the last array, by namespace."""
        last = self.sent("~visualization_marker_array")[-1].markers
        return {marker.ns: marker for marker in last if marker.action == Marker.ADD}


@pytest.fixture
def controller(monkeypatch):
    return Controller(monkeypatch)


def place(marker):
    return marker.pose.position.x, marker.pose.position.y


def near(x, y):
    return pytest.approx((x, y), abs=0.02)


def test_pillar_estimate_path_target_state_and_errors_are_where_they_are(controller):
    pose = controller.drive(1.5)
    x, y, _ = transform_point(inverse(pose_from_2d(pose)), (X, Y, 0.0))
    shown = controller.markers()
    assert set(shown) == {"estimate", "path", "target", "state"}
    assert all(marker.color.a > 0.0 for marker in shown.values())
    assert all(marker.pose.orientation.w == 1.0 for marker in shown.values()), "or RViz complains of each"

    estimate = shown["estimate"]
    assert (estimate.header.frame_id, place(estimate)) == ("odom", near(X, Y))
    assert estimate.scale.x > 2.0 * RADIUS, "its rim says how uncertain it is"
    assert estimate.scale.z < 0.1, "it is flat"

    path = shown["path"]
    assert (path.header.frame_id, path.type) == ("odom", Marker.LINE_STRIP)
    assert (path.points[0].x, path.points[0].y) == near(0.0, 0.0)
    assert (path.points[-1].x, path.points[-1].y) == pytest.approx((pose.x, pose.y), abs=0.1)

    target = shown["target"]
    assert target.header.frame_id == "base_link"
    from_pillar = hypot(x - target.pose.position.x, y - target.pose.position.y)
    assert from_pillar == pytest.approx(STOP_DISTANCE + RADIUS, abs=0.02)

    state, to_go = shown["state"], hypot(x - LASER_X, y) - RADIUS - STOP_DISTANCE
    assert (state.header.frame_id, state.type) == ("base_link", Marker.TEXT_VIEW_FACING)
    assert state.text == f"driving, {to_go:.2f} m to go"
    assert place(state) == near(x, y)
    assert state.pose.position.z > 1.0, "above the pillar"
    assert state.scale.z < 0.03 * (hypot(x, y) + 8.0), "small, as seen from behind the robot"

    single = controller.sent("~visualization_marker")
    assert len({(marker.ns, marker.header.stamp) for marker in single}) == len(single) == 2 * 15
    arrays = [marker for array in controller.sent("~visualization_marker_array") for marker in array.markers]
    assert {marker.lifetime for marker in single + arrays} == {rospy.Duration()}, "drawn until taken away"
    in_laser, in_odom = single[-2:]
    assert (in_laser.ns, in_laser.header.frame_id) == ("pillar_in_laser", "front_laser")
    assert place(in_laser) == near(x - LASER_X, -y), "the lidar hangs upside down"
    assert (in_odom.ns, in_odom.header.frame_id, place(in_odom)) == ("pillar_in_odom", "odom", near(X, Y))
    for marker in (in_laser, in_odom):
        assert marker.type == Marker.CYLINDER
        size = marker.scale.x, marker.scale.y, marker.scale.z
        assert size == pytest.approx((2.0 * RADIUS, 2.0 * RADIUS, HEIGHT), rel=0.03), "the pillar's own"
    assert in_laser.scale.x < 0.99 * in_odom.scale.x, "or RViz would draw flickering patches of both"
    assert in_odom.pose.position.z == pytest.approx(GROUND + HEIGHT / 2.0, abs=0.001), "on the ground"
    above_base = LASER_Z - in_laser.pose.position.z  # the lidar hangs upside down
    assert above_base == pytest.approx(GROUND + HEIGHT / 2.0, abs=0.001)
    assert state.pose.position.z - state.scale.z / 2.0 > GROUND + HEIGHT, "its text hides none of it"

    pillar, error = controller.sent("~pillar")[-1], controller.sent("~error")[-1].vector
    assert (pillar.header.frame_id, (pillar.point.x, pillar.point.y)) == ("base_link", near(x, y))
    assert (error.x, error.y) == near(to_go, atan2(y, x))


def test_what_is_no_more_is_taken_away(controller):
    controller.drive(0.5)
    controller.toy.circles = []
    controller.drive(5.0)
    single, arrays = (controller.sent(f"~visualization_marker{name}") for name in ("", "_array"))
    gone = {marker.ns for array in arrays for marker in array.markers if marker.action == Marker.DELETE}
    assert "target" in gone
    assert controller.markers()["state"].text == "searching"
    gone = {marker.ns for marker in single if marker.action == Marker.DELETE}
    assert gone == {"pillar_in_odom", "pillar_in_laser"}


def test_who_comes_late_is_shown_the_last_scan_once(controller, monkeypatch):
    controller.drive(0.5)
    single, arrays = (controller.sent(f"~visualization_marker{name}") for name in ("", "_array"))
    before = len(single), len(arrays)
    controller.listener.peer_subscribe()
    monkeypatch.setattr(rospy, "is_shutdown", Mock(side_effect=[False, False, True]))
    controller.node.run()
    assert (len(single), len(arrays)) == (before[0] + 2, before[1] + 1)
    assert single[-2:] == single[-4:-2]


def test_an_error_of_one_scan_or_of_the_display_stops_the_robot_and_not_the_node(controller, monkeypatch):
    assert controller.answer().linear.x > 0.0
    with monkeypatch.context() as patch:
        patch.setattr(node, "decide", Mock(side_effect=ZeroDivisionError))
        with pytest.raises(ZeroDivisionError):
            controller.answer()
    assert controller.sent("cmd_vel")[-1] == Twist()
    errors = []
    monkeypatch.setattr(rospy, "logerr", errors.append)
    monkeypatch.setattr(rospy, "is_shutdown", Mock(side_effect=[False, False, True]))
    controller.node._placement.update = controller.node._display.update = Mock(side_effect=KeyError("odom"))
    controller.node.run()
    assert controller.node._placement.update.call_count == 4, "twice both"
    assert [error.split(" failed")[0] for error in errors] == ["placing a scan", "showing the last scan"]
    assert controller.answer().linear.x > 0.0


def test_a_node_that_its_master_does_not_know_stands_still_and_refuses_to_start(controller):
    controller.drive(0.5)
    assert controller.answer().linear.x > 0.0
    controller.registration.is_lost = True
    controller.registration.lose()
    assert controller.sent("cmd_vel")[-1] == Twist(), "at once, not at the next scan"
    assert controller.answer() == Twist()
    answer = controller.start_stop(True)
    assert not answer.success
    assert "start all nodes again" in answer.message
    assert controller.answer() == Twist()


def test_the_path_of_a_robot_that_was_put_elsewhere_begins_there(controller):
    controller.drive(1.0)
    controller.toy.pose = Pose2D(-5.0, 3.0)
    controller.drive(1.0)
    first = controller.markers()["path"].points[0]
    assert (first.x, first.y) == (-5.0, 3.0)


def test_each_stage_of_a_search_is_told_once(controller):
    controller.toy.circles, told = [], len(controller.log)
    for step in range(12):
        controller.toy.pose = Pose2D(yaw=0.5 * step)
        command = controller.answer()
        assert command.linear.x == 0.0
        assert command.angular.z > 0.0, "it turns to look around"
    for step in range(12, 16):
        controller.toy.pose = Pose2D(yaw=0.5 * step)
        command = controller.answer()
    assert command.linear.x > 0.0, "it drives on after a full turn"
    for step in range(40):  # a leg, and a turn
        controller.toy.pose = Pose2D(0.1 * min(step, 20), 0.0, 8.0 + 0.5 * max(step - 20, 0))
        controller.answer()
    controller.toy.circles = [(X, Y, RADIUS)]
    controller.answer_at(3.0)
    turning, widening, driving = (text for text in controller.log[told:] if "commanding" not in text)
    assert "turning to look around" in turning
    assert "widening search" in widening
    assert driving.startswith("driving to the pillar")
    assert "smallest range 3.000 m, pillar at x 3.2" in driving, "with what it sees"


def test_the_smallest_range_is_logged_each_second_as_the_first_number_of_its_line(controller):
    controller.toy.pose = Pose2D(X - 3.0, Y)
    expected = []
    for _ in range(31):
        ranges = controller.toy.scan().ranges.copy()
        expected.append(f"smallest range {np.nanmin(ranges):.3f} m; driving, ")
        ranges[:5] = np.nan, np.inf, -np.inf, 0.001, 200.0  # none of them measures a distance
        command = controller.answer(ranges)
    lines = [text for text in controller.log if "commanding" in text]
    assert [line[: line.index("driving, ") + 9] for line in lines] == expected[::10]
    assert re.search(r"driving, \d\.\d\d m to go, commanding \d\.\d\d m/s, -?\d\.\d\d rad/s$", lines[-1])
    assert f"commanding {command.linear.x:.2f} m/s, {command.angular.z:.2f} rad/s" in lines[-1]
    controller.start_stop(False)
    controller.toy.circles = []
    controller.drive(1.0)
    assert "no valid range; stopped" in controller.log[-1], controller.log[-1]
    (driving,) = (text for text in controller.log if text.startswith("driving to the pillar"))
    assert re.search(r"\d+\.\d+", driving)[0] == expected[0].split()[2], "no other number comes first"


@pytest.mark.parametrize(("stop_distance", "warnings"), [(0.4, 0), (0.0, 0), (0.05, 1)])
def test_a_stop_distance_that_the_lidar_does_not_see_is_told_once(stop_distance, warnings, monkeypatch):
    controller = Controller(monkeypatch, stop_distance=stop_distance)
    for distance in (1.0, 0.8):
        controller.answer_at(distance)
    told = [
        text for text in controller.warnings if "stop_distance = 0.05 m, but the lidar measures no" in text
    ]
    assert len(told) == warnings


def test_each_arrival_is_announced_once(controller):
    def announced():
        return [msg.data for msg in controller.sent("~arrived")]

    for distance in (1.0, 0.8, 0.6, 0.5, 0.45):
        controller.answer_at(distance)
    assert announced() == [False]
    for distance in (0.405, 0.404, 0.406, 0.405, 0.404):
        controller.answer_at(distance)
    for distance in (0.6, 0.8, 0.8):
        controller.answer_at(distance)
    for distance in (0.6, 0.405, 0.405, 0.405):
        controller.answer_at(distance)
    assert announced() == [False, True, False, True]
    assert controller.topics["~arrived"].latch, "who joins late is told as well"
    first, _ = (text for text in controller.log if text.startswith("arrived after"))
    assert first.startswith("arrived after 0.50 s of simulated time, 0.40")
    assert first.endswith("m from the pillar (stop_distance 0.4 m)")
    assert "to drive again, rosservice call husky_simulator/reset; Ctrl-C ends the launch" in controller.log

    for wanted in (False, True, False, True):
        controller.start_stop(wanted)
        for _ in range(3):
            controller.answer_at(0.405)
    assert sum("at the pillar already" in text for text in controller.log) == 2
    assert announced() == [False, True, False, True], "it has not left, nor arrived once more"
    controller.start_stop(False)
    for _ in range(3):
        controller.answer_at(0.8)
    assert not announced()[-1], "it was carried away"


def test_it_starts_and_stops_at_once_by_its_service_and_drives_with_the_parameters_that_it_was_given(
    monkeypatch,
):
    given = dict(start_stop_service_name="let_it_drive", start_enabled=False, stop_distance=1.0)
    controller = Controller(monkeypatch, **given, p_gain_vel=0.3, search=False)
    assert controller.service == "let_it_drive"
    for _ in range(3):
        assert controller.answer_at(3.0) == Twist()
        started = controller.start_stop(True)
        assert (started.success, started.message) == (True, "driving to the pillar")
        assert controller.answer_at(3.0).linear.x == pytest.approx(0.3 * 2.0, abs=0.01)
        told = len(controller.sent("cmd_vel"))
        stopped = controller.start_stop(False)
        assert (stopped.success, stopped.message) == (True, "standing still until started")
        assert controller.sent("cmd_vel")[told:] == [Twist()], "it stops without a scan"
    assert controller.start_stop(False).message.startswith("already")
    controller.start_stop(True)
    assert controller.answer_at(1.005) == Twist(), "at the stop distance"
    controller.toy.circles = []
    assert controller.answer() == Twist(), "search is off"


def test_after_a_start_the_status_does_not_say_why_the_robot_had_stopped(controller):
    def status():
        health = controller.node._examine(False)
        return health.state.value, health.reason

    controller.start_stop(False)
    controller.answer_at(3.0)
    assert status() == ("stopped", "stopped by its start/stop service")
    controller.start_stop(True)
    assert status() == ("waiting", ""), "no scan has come since the start"
    controller.answer_at(3.0)
    assert status()[0] == "driving"


@pytest.mark.parametrize(
    ("ranges", "why"),
    [
        (np.zeros(0), r"standing still: .*it has no valid range\); check that the lidar is uncovered"),
        (np.full(720, 2.0), r"standing still: .*none of its returns looks like one\); set ~search"),
    ],
)
def test_with_search_off_it_stops_says_why_once_and_goes_on_when_the_pillar_is_back(ranges, why, monkeypatch):
    controller = Controller(monkeypatch, search=False)
    assert controller.answer().linear.x > 0.5
    for _ in range(3):
        assert controller.answer(ranges) == Twist()
    (warning,) = controller.warnings
    assert re.search(why, warning)
    controller.answer(np.full(720, 1.0) if len(ranges) == 0 else np.zeros(0))
    assert len(controller.warnings) == 2, "for another reason, which it says"
    told = len(controller.log)
    assert controller.answer().linear.x > 0.5
    (driving,) = controller.log[told:]
    assert driving.startswith("driving to the pillar")


def test_after_the_last_zero_of_the_shutdown_a_late_scan_moves_nothing(controller):
    assert controller.answer().linear.x > 0.0
    (hook,) = (call.args[0] for call in rospy.on_shutdown.call_args_list)
    hook()
    assert controller.sent("cmd_vel")[-1] == Twist()
    assert controller.answer() == Twist()
