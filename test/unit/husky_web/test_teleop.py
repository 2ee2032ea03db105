"""Teleoperation: the page knows the emergency stop, whoever pressed it, and its thread outlives an error."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")
pytest.importorskip("viser")

import rospy
from std_msgs.msg import Bool

from husky_web import teleop
from husky_web.teleop import Teleop

DEADLINE = 20.0  # [s]


@pytest.fixture
def network(monkeypatch):
    """Callbacks of topics by name, the commands that were sent, and an event that ends the thread."""
    network = SimpleNamespace(callbacks={}, sent=threading.Semaphore(0), ends=threading.Event(), errors=[])

    def subscribe(topic, _kind, callback, **_):
        network.callbacks[topic] = callback

    def publish(_publisher, _message):
        network.sent.release()
        raise ValueError("field linear must be a number")

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "is_shutdown", network.ends.is_set)
    monkeypatch.setattr(rospy, "logerr", network.errors.append)
    monkeypatch.setattr(teleop, "publish", publish)
    yield network
    network.ends.set()


def test_a_page_that_is_started_while_the_simulator_is_locked_knows_it(network):
    page = Teleop("/husky_simulator")
    assert not page.is_locked
    network.callbacks["/husky_simulator/locked"](Bool(True))  # latched: it comes at once
    assert page.is_locked
    network.callbacks["/husky_simulator/locked"](Bool(False))
    assert not page.is_locked
    network.callbacks["e_stop"](Bool(True))  # of a real robot, which tells nothing
    assert page.is_locked


def test_an_error_of_one_command_does_not_end_driving_by_hand(network):
    Teleop("/husky_simulator").on_message(1, {"linear": 1.0, "angular": 0.0})
    for _ in range(3):
        assert network.sent.acquire(timeout=DEADLINE)
