"""The guards judge the newest odometry and scan, and repeat a stop until it is answered."""

from __future__ import annotations

import threading

import pytest

pytest.importorskip("rospy")

import rospy
from nav_msgs.msg import Odometry

from husky_highlevel_controller.controller.safety import ProximityConfig
from husky_highlevel_controller.datatypes import Twist2D
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.safety import proximity_stop, stop_request
from husky_highlevel_controller.ros.safety.guard import Guard, ServiceConfig
from husky_highlevel_controller.ros.safety.stop_request import StopRequest

DEADLINE = 20.0  # [s]


def odometry(stamp, twist):
    msg = Odometry(header=conversions.header(stamp, "odom"))
    msg.twist.twist = conversions.twist_to_msg(twist)
    return msg


@pytest.mark.parametrize(
    ("age", "fresh"), [(0.0, True), (0.4, True), (-0.4, True), (0.6, False), (-0.6, False)]
)
def test_a_velocity_older_than_half_a_second_is_unknown(age, fresh):
    guard = Guard(lambda _: None)
    assert guard.twist(10.0) is None
    guard.on_odometry(odometry(10.0, Twist2D(0.5, 0.1)))
    assert guard.twist(10.0 + age) == (Twist2D(0.5, 0.1) if fresh else None)


def test_only_the_newest_odometry_and_scan_are_judged(monkeypatch):
    """A queue would let a guard that is late stop the robot for where it was."""
    queues = {}

    def subscribe(topic, _kind, _callback, queue_size, **_how):
        queues[topic] = queue_size

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "get_param", lambda *_: {**vars(ServiceConfig()), **vars(ProximityConfig())})
    monkeypatch.setattr(proximity_stop.tf2_ros, "Buffer", object)
    monkeypatch.setattr(proximity_stop.tf2_ros, "TransformListener", lambda _: None)
    proximity_stop.ProximityStopNode()
    assert queues == {"odometry/filtered": 1, "front/scan": 1}


def test_one_danger_is_one_request():
    requests = []
    guard = Guard(requests.append)
    guard.on_odometry(odometry(10.0, Twist2D(0.5, 0.0)))
    for step in range(20):
        guard.judge(10.0 + 0.02 * step, "a wall")
    assert requests == ["a wall"]


class Service:
    """A stop request whose service behaves as a list of functions says, one for each call."""

    def __init__(self, *calls):
        self.calls, self.zeros, self.failures = list(calls), threading.Semaphore(0), []
        self.answered, self.ended = threading.Event(), threading.Event()
        self.request = StopRequest(
            lambda: self.calls.pop(0)(),
            self.zeros.release,
            lambda danger, reason: self.failures.append(reason),
            lambda danger: self.answered.set(),
        )
        self.thread = threading.Thread(target=self.request.run, args=(self.ended.is_set,), daemon=True)
        self.thread.start()

    def end(self):
        self.ended.set()
        self.thread.join(DEADLINE)
        assert not self.thread.is_alive()


def test_a_service_that_fails_is_called_again_and_zero_is_commanded_until_it_answers():
    service = Service(lambda: "no such service", lambda: "it answered 'no'", lambda: None)
    service.request.start("a wall")
    assert service.answered.wait(DEADLINE)
    assert service.failures == ["no such service", "it answered 'no'"]
    assert service.zeros.acquire(timeout=DEADLINE)
    service.end()


def test_a_service_that_hangs_is_called_again_and_zero_is_commanded_meanwhile(monkeypatch):
    monkeypatch.setattr(stop_request, "CALL_TIMEOUT", 0.3)
    release = threading.Event()
    service = Service(release.wait, lambda: None)
    service.request.start("a wall")
    for _ in range(3):
        assert service.zeros.acquire(timeout=DEADLINE)
    assert service.answered.wait(DEADLINE)
    assert service.failures == ["it did not answer within 0.3 s"]
    release.set()
    service.end()


def test_calls_that_hang_do_not_pile_up(monkeypatch):
    monkeypatch.setattr(stop_request, "CALL_TIMEOUT", 0.01)
    monkeypatch.setattr(stop_request, "RETRY_PERIOD", 0.01)
    release = threading.Event()
    service = Service(*[release.wait] * 20)
    service.request.start("a wall")
    for _ in range(20):
        assert service.zeros.acquire(timeout=DEADLINE)
    assert len(service.calls) == 20 - stop_request.MAX_HUNG_CALLS
    service.end()
    release.set()


def test_a_request_while_one_is_pending_is_the_same_one():
    answer = threading.Event()
    service = Service(lambda: not answer.wait(DEADLINE) or None, lambda: None)
    service.request.start("a wall")
    service.request.start("a wall")
    answer.set()
    assert service.answered.wait(DEADLINE)
    service.end()
    assert len(service.calls) == 1
