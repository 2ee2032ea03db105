"""The guards judge the newest odometry and scan."""

import re
import threading
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy
import tf2_ros
from nav_msgs.msg import Odometry

from husky_highlevel_controller.controller.crash_detection import CrashConfig
from husky_highlevel_controller.controller.safety import ProximityConfig
from husky_highlevel_controller.datatypes import ImuSample, Pose, Scan, Twist2D
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.registration import RegistrationWatch
from husky_highlevel_controller.ros.safety import crash_stop, proximity_stop
from husky_highlevel_controller.ros.safety import guard as guard_module
from husky_highlevel_controller.ros.safety.guard import Guard, ServiceConfig
from husky_highlevel_controller.ros.safety.stop_request import StopRequest


def odometry(stamp, twist):
    msg = Odometry(header=conversions.header(stamp, "odom"))
    msg.twist.twist = conversions.twist_to_msg(twist)
    return msg


@pytest.mark.parametrize(
    ("age", "fresh"), [(0.0, True), (0.4, True), (-0.4, True), (0.6, False), (-0.6, False)]
)
def test_a_velocity_older_than_half_a_second_is_unknown(monkeypatch, age, fresh):
    for name in ("Subscriber", "Publisher"):
        monkeypatch.setattr(rospy, name, lambda *_, **__: None)
    guard = Guard(ServiceConfig(), load_robot(), 0.3)
    assert guard.twist(10.0) is None
    guard.on_odometry(odometry(10.0, Twist2D(0.5, 0.1)))
    assert guard.twist(10.0 + age) == (Twist2D(0.5, 0.1) if fresh else None)


class Robot:
    """A guard's node without a network: its topics are called by hand, at a wall time that is set by hand."""

    def __init__(self, monkeypatch, make, config):
        self.queues, self.callbacks, self.warnings, self.stops, self.now = {}, {}, [], [], 5000.0
        parameters = {**vars(ServiceConfig()), **vars(config)}
        monkeypatch.setattr(rospy, "Subscriber", self.subscribe)
        monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
        monkeypatch.setattr(rospy, "get_param", lambda *_: parameters)
        monkeypatch.setattr(rospy, "get_time", lambda: self.now)
        monkeypatch.setattr(rospy, "logwarn_throttle", lambda _, text: self.warnings.append(text))
        monkeypatch.setattr(guard_module, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(StopRequest, "start", lambda _, danger: self.stops.append(danger))
        monkeypatch.setattr(tf2_ros, "Buffer", object)
        monkeypatch.setattr(tf2_ros, "TransformListener", lambda _: None)
        make()

    def subscribe(self, topic, _kind, callback, queue_size, **_how):
        name = topic.lstrip("/")
        self.queues[name], self.callbacks[name] = queue_size, callback

    def drive(self, sensor, message, ahead, accelerations, lost=0.0):
        """Odometry at 50 Hz, messages at 100 Hz stamped `ahead` of it; accelerations of 10 ms each [m/s^2].

        `lost` is a speed that the robot loses within 80 ms at the end, and not the wheels [m/s].
        """
        speed = 0.0
        for step, acceleration in enumerate(accelerations):
            self.now += 0.01
            speed += 0.01 * acceleration
            if step % 2 == 0:
                self.callbacks["odometry/filtered"](odometry(self.now, Twist2D(speed, 0.0)))
            braked = lost / 0.08 if len(accelerations) - step in range(50, 58) else 0.0
            self.callbacks[sensor](message(self.now + ahead, acceleration - braked))


def imu(stamp, acceleration):
    return conversions.imu_to_msg(
        ImuSample(stamp, (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (acceleration, 0.0, 9.8)), "base_link"
    )


SMOOTH = [0.0] * 300 + [3.0] * 33 + [0.0] * 200 + [-3.0] * 33 + [0.0] * 100  # to 1 m/s, and back to standing


@pytest.mark.parametrize("ahead", [0.5, 1.0, 2.5, -0.5, -1.0, -2.5])
def test_a_smooth_drive_is_no_crash_where_imu_and_odometry_have_clocks_of_their_own(monkeypatch, ahead):
    robot = Robot(monkeypatch, crash_stop.CrashStopNode, CrashConfig())
    robot.drive("imu/data", imu, ahead, SMOOTH)
    assert robot.stops == []
    way = "ahead of" if ahead > 0.0 else "behind"
    told = re.compile(
        rf"IMU samples are stamped (\d\.\d\d) s {way} odometry; set the clocks \(chrony\); until then"
    )
    assert float(told.match(robot.warnings[-1]).group(1)) == pytest.approx(abs(ahead), abs=0.03)
    assert all(map(told.match, robot.warnings)), "and no other cause is named"


def test_with_clocks_alike_a_crash_is_felt_and_nothing_is_said(monkeypatch):
    robot = Robot(monkeypatch, crash_stop.CrashStopNode, CrashConfig())
    robot.drive("imu/data", imu, 0.0, SMOOTH)
    assert (robot.stops, robot.warnings) == ([], [])
    robot.drive("imu/data", imu, 0.0, [3.0] * 33 + [0.0] * 200, lost=0.4)
    assert [stop[:6] for stop in robot.stops] == ["crash:"]


def scan_of_a_wall(stamp, _):
    scan = Scan(stamp, "base_link", -1.5, 1.5, 0.1, 30.0, np.full(100, 0.8))
    return conversions.scan_to_msg(scan)


@pytest.mark.parametrize(
    ("ahead", "told"),
    [
        (0.0, None),
        (0.5, r"scans are stamped 0.5\d s ahead of odometry; set the clocks \(chrony\)"),
        (2.5, r"scans are stamped 2.5\d s ahead of odometry"),
        (-3600.0, r"scans are stamped 3600.\d\d s behind odometry"),
        (None, "scans are stamped 0; set the stamps in their driver"),
    ],
)
def test_proximity_stop_guards_by_the_newest_odometry_where_the_clocks_differ(monkeypatch, ahead, told):
    robot = Robot(monkeypatch, proximity_stop.ProximityStopNode, ProximityConfig())
    monkeypatch.setattr(proximity_stop, "lookup_pose", lambda *_: Pose())
    stamp = (lambda now: 0.0) if ahead is None else (lambda now: now + ahead)
    robot.drive("front/scan", lambda _, a: scan_of_a_wall(stamp(robot.now), a), 0.0, SMOOTH[:400])
    assert [stop[:9] for stop in robot.stops] == ["something"], "one danger is one request"
    assert bool(robot.warnings) is (told is not None)
    assert all(re.match(told, warning) for warning in robot.warnings)


def test_only_the_newest_odometry_and_scan_are_judged(monkeypatch):
    """A queue would let a guard that is late stop the robot for where it was."""
    robot = Robot(monkeypatch, proximity_stop.ProximityStopNode, ProximityConfig())
    assert robot.queues == {"odometry/filtered": 1, "front/scan": 1}


def test_a_second_without_odometry_is_a_start_and_more_is_a_warning(monkeypatch):
    robot = Robot(monkeypatch, proximity_stop.ProximityStopNode, ProximityConfig())
    monkeypatch.setattr(proximity_stop, "lookup_pose", lambda *_: Pose())

    def warnings(*times):
        robot.warnings.clear()
        for robot.now in times:
            robot.callbacks["front/scan"](scan_of_a_wall(robot.now, 0.0))
        return len(robot.warnings)

    assert warnings(10.0, 10.5, 10.95) == 0
    assert warnings(11.05) == 1
    robot.callbacks["odometry/filtered"](odometry(11.5, Twist2D(0.0, 0.0)))
    assert warnings(11.6, 12.2, 13.1) == 0
    assert warnings(0.0, 0.9) == 0, "the simulation begins again"
    assert warnings(1.1) == 1


@pytest.mark.parametrize(("paused", "warns"), [(False, True), (True, False)])
def test_a_guard_whose_sensor_is_silent_says_so(monkeypatch, paused, warns):
    subscribed, warnings, looks = {}, [], []
    end = []  # function that ends the wait

    def subscribe(topic, _kind, callback, **_):
        subscribed[topic] = callback
        return SimpleNamespace(resolved_name=topic)

    def get_time():
        looks.append(None)
        if len(looks) == 4:  # the sensor is switched on, and sends a message before the next look
            subscribed["/scan"]("message")
        if len(looks) == 7:
            end[0]()
        return 100.0 if paused else 100.0 + len(looks)

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "on_shutdown", end.append)
    monkeypatch.setattr(rospy, "get_time", get_time)
    monkeypatch.setattr(rospy, "logwarn", warnings.append)
    monkeypatch.setattr(guard_module, "REPORT_PERIOD", 0.01)
    guard, heard = Guard(ServiceConfig(), load_robot(), 0.3), []
    guard.watch("/scan", object, heard.append)
    guard._warn_while_sensor_is_silent()
    assert heard == ["message"]
    # six looks, of which one has seen the message; after it, the sensor has ended
    assert len(warnings) == (5 if warns else 0)
    assert all("guard inactive: no message on /scan for 0.01 s" in warning for warning in warnings)


def test_a_guard_ends_if_the_shutdown_begins_while_it_looks_for_the_service(monkeypatch):
    hooks = []

    def begin_shutdown(*_, **__):
        for hook in hooks:
            hook()
        hooks.clear()  # rospy never calls a hook that is added later; `is_shutdown()` is not true yet

    for name in ("Subscriber", "Publisher", "loginfo"):
        monkeypatch.setattr(rospy, name, lambda *_, **__: None)
    monkeypatch.setattr(rospy, "on_shutdown", hooks.append)
    monkeypatch.setattr(rospy, "wait_for_service", begin_shutdown)
    monkeypatch.setattr(rospy, "get_time", lambda: 0.0)
    monkeypatch.setattr(StopRequest, "run", lambda *_: None)
    monkeypatch.setattr(RegistrationWatch, "start", lambda _: None)
    running = threading.Thread(target=Guard(ServiceConfig(), load_robot(), 0.3).run, daemon=True)
    running.start()
    running.join(timeout=20.0)
    assert not running.is_alive()
