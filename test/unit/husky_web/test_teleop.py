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
from husky_web.teleop import EXPIRY, RELEASE_AFTER, HoldToDrive, Teleop, clamp_axis, set_speed

DEADLINE = 20.0  # [s]
AHEAD, TURN = Twist2D(0.5, 0.0), Twist2D(0.0, 0.8)


@pytest.fixture
def network(monkeypatch):
    """Callbacks of topics by name, commands and values of e_stop that were sent, subscribers of e_stop.

    The event `ends` ends the thread; `listener` is the function that is told of a new subscriber.
    """
    network = SimpleNamespace(
        callbacks={}, sent=threading.Semaphore(0), ends=threading.Event(), errors=[], e_stop=[]
    )
    network.subscribers = SimpleNamespace(impl=SimpleNamespace(connections=[]))

    def subscribe(topic, _kind, callback, **_):
        network.callbacks[topic] = callback

    def advertise(*_, subscriber_listener=None, **__):
        if subscriber_listener is None:
            return None
        network.listener = subscriber_listener.peer_subscribe
        return network.subscribers

    def publish(_publisher, message):
        if isinstance(message, Bool):
            network.e_stop.append(message.data)
            return
        network.sent.release()
        raise ValueError("field linear must be a number")

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(rospy, "Publisher", advertise)
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
    network.callbacks["e_stop"](e_stop(True))  # of a real robot, which tells nothing
    assert page.is_locked


def e_stop(value, sender="/rostopic_1"):
    message = Bool(value)
    message._connection_header = {"callerid": sender}
    return message


def test_a_double_click_on_the_emergency_stop_does_not_release_it(network):
    page = Teleop("/husky_simulator")
    page.on_message(1, {"e_stop": True})
    page.on_message(1, {"e_stop": False})
    assert page.is_locked
    page._locked_at -= RELEASE_AFTER
    page.on_message(1, {"e_stop": False})
    assert not page.is_locked
    assert network.e_stop == [True, False]


def told(network):
    """The values that a node gets that subscribes to e_stop now."""
    values = []
    network.listener("/e_stop", None, lambda message: values.append(message.data))
    return values


def test_a_new_subscriber_is_told_the_last_value_but_no_release_that_another_program_has_sent(network):
    page = Teleop("/husky_simulator")
    assert told(network) == []
    page.on_message(1, {"e_stop": True})
    network.callbacks["e_stop"](e_stop(True, rospy.get_name()))  # the page hears itself
    assert told(network) == [True]
    network.callbacks["e_stop"](e_stop(False))
    assert told(network) == [], "another program has released the stop"
    network.callbacks["e_stop"](e_stop(True))
    assert told(network) == [True], "a stop is told, whoever has sent it"
    page._locked_at -= RELEASE_AFTER
    page.on_message(1, {"e_stop": False})
    network.callbacks["e_stop"](e_stop(False, rospy.get_name()))
    assert told(network) == [False]


@pytest.mark.parametrize(
    ("names", "has_listener"),
    [
        ([], False),
        ([rospy.get_name()], False),
        (["/husky_web", "/record_123", "/robot1/rqt_gui", "/rostopic_1"], False),
        (["/husky_web", "/twist_mux"], True),
        (["/robot1/husky_simulator"], True),
    ],
)
def test_a_tool_that_only_looks_at_the_emergency_stop_does_not_count_as_its_listener(
    network, names, has_listener
):
    page = Teleop("/husky_simulator")
    network.subscribers.impl.connections = [SimpleNamespace(endpoint_id=name) for name in names]
    assert page.has_listener is has_listener


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
