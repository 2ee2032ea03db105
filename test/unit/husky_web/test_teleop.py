"""Teleoperation: who drives, how fast, and what its thread outlives; it knows the emergency stop."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")
pytest.importorskip("viser")

import rospy
from std_msgs.msg import Bool

from husky_highlevel_controller.datatypes import STOP, Twist2D
from husky_web import teleop
from husky_web.teleop import EXPIRY, HoldToDrive, Teleop, clamp_axis, set_speed

DEADLINE = 20.0  # [s]
AHEAD, TURN = Twist2D(0.5, 0.0), Twist2D(0.0, 0.8)


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


def test_the_page_that_took_hold_first_drives_until_it_lets_go_is_silent_or_gone():
    hold = HoldToDrive()
    assert hold.command(0.0) is None
    hold.hold(1, AHEAD, 0.0)
    hold.hold(2, TURN, 0.1)
    hold.release(2)
    assert hold.command(EXPIRY - 0.01) == AHEAD
    hold.hold(1, STOP, EXPIRY - 0.01)
    assert [hold.command(0.25), hold.command(0.3)] == [STOP, None], "it stops once"
    hold.hold(1, AHEAD, 1.0)
    assert hold.command(1.0 + EXPIRY + 0.01) == STOP, "silent"
    hold.hold(1, AHEAD, 2.0)
    hold.hold(2, TURN, 3.0)  # page 1 is silent by now
    assert hold.command(3.0) == TURN
    hold.release(2)
    assert hold.command(3.01) == STOP
    assert not hold.is_active


@pytest.mark.parametrize(
    ("value", "axis"),
    [
        *[(value, None) for value in ("1", None, True, float("nan"), float("inf"), [1])],
        *[(3, 1.0), (-0.5, -0.5), (10**400, 1.0)],
    ],
)
def test_an_axis_is_a_number_limited_to_full_speed(value, axis):
    assert clamp_axis(value) == axis


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -5.0, 0.0, 50.0, 1e308])
def test_a_speed_that_no_slider_has_is_not_taken(value):
    teleop = SimpleNamespace(max_linear=0.5)
    for sent, taken in ((value, 0.5), (0.7, 0.7)):
        set_speed(teleop, "max_linear", 1.0, SimpleNamespace(target=SimpleNamespace(value=sent)))
        assert teleop.max_linear == taken
