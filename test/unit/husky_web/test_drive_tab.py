"""Drive tab: a stop waits for nothing, an old start is dropped, and lights of ended nodes are stale."""

import threading
from types import SimpleNamespace

import pytest
from page_elements import Element

pytest.importorskip("rospy")
pytest.importorskip("viser")

from husky_highlevel_controller.datatypes import HuskyError
from husky_web import drive_tab
from husky_web.actions import Actions
from husky_web.drive_tab import STALE_LIGHT, START, STOP, DriveTab

CONTROLLER = "/husky_highlevel_controller"
DEADLINE = 20.0  # [s] wall time


@pytest.fixture
def network(monkeypatch):
    """Services that were called, each with its argument, and the emergency stop."""
    network = SimpleNamespace(calls=[], called=threading.Semaphore(0), is_locked=False)
    network.answer = lambda _starts: "done"

    def call(service, _kind, *arguments, **_):
        sentence = network.answer(*arguments) if service.endswith("start_stop") else "done"
        network.calls.append((service.split("/")[-1], *arguments))
        network.called.release()
        return sentence

    monkeypatch.setattr(drive_tab, "call", call)
    monkeypatch.setattr(drive_tab, "parameter", lambda _name, default: default)
    return network


@pytest.fixture
def actions():
    return Actions()


@pytest.fixture
def tab(network, actions):
    server, moves = SimpleNamespace(gui=Element()), lambda _name: Element()
    network.max_linear = network.max_angular = 0.5  # `network` is the teleoperation, too
    return DriveTab(server, actions, network, moves, CONTROLLER, "/husky_simulator")


def press(tab, button):
    notes = []
    client = SimpleNamespace(add_notification=lambda _title, text, **_: notes.append(text))
    tab._on_start_stop(SimpleNamespace(target=SimpleNamespace(value=button), client=client))
    return notes


def test_stop_does_not_wait_for_a_call_that_takes_long(tab, network, actions):
    loaded = threading.Event()
    actions.do(lambda: loaded.wait(DEADLINE) and None, None, "World")
    press(tab, STOP)
    assert network.called.acquire(timeout=DEADLINE)
    assert network.calls == [("start_stop", False)]
    loaded.set()


def finish(actions):
    """Wait until all calls of the queue are done."""
    done = threading.Event()
    actions.do(done.set, None, "test")
    assert done.wait(DEADLINE)


@pytest.mark.parametrize("requested", ["start", "again"])
def test_a_start_that_still_waits_is_dropped_by_the_emergency_stop(requested, tab, network, actions):
    loaded = threading.Event()
    actions.do(lambda: loaded.wait(DEADLINE) and None, None, "World")
    if requested == "start":
        press(tab, START)
    else:
        tab.again(None)
    network.is_locked = True
    tab.stop()  # the page's emergency stop calls it
    assert network.called.acquire(timeout=DEADLINE)
    network.is_locked = False  # released
    loaded.set()
    finish(actions)
    assert ("start_stop", True) not in network.calls
    notes = press(tab, START)
    finish(actions)
    assert network.calls[-1] == ("start_stop", True)
    assert notes == ["done"]


def test_a_stop_during_the_call_of_a_start_has_the_last_word(tab, network, actions):
    def answer(starts):
        if starts:  # the stop overtakes the start that is being called
            tab.stop()
            assert network.called.acquire(timeout=DEADLINE)
        return "done"

    network.answer = answer
    notes = press(tab, START)
    finish(actions)
    assert [call[1] for call in network.calls] == [False, True, False]
    assert notes == ["not started, because a stop was requested after this start; press Start again"]


def test_the_emergency_stop_refuses_a_start(tab, network):
    network.is_locked = True
    with pytest.raises(HuskyError, match="release it first"):
        tab._start_controller(tab._stop_count)


def diagnostics(name="husky_highlevel_controller: controller", state="driving"):
    pair = SimpleNamespace(key="state", value=state)
    return [SimpleNamespace(status=[SimpleNamespace(name=name, level=0, message=state, values=[pair])])]


def test_the_state_of_another_node_whose_name_begins_like_the_controller_is_not_shown(tab):
    tab.take([*diagnostics(), *diagnostics("husky_highlevel_controller_2", "stopped")], now=100.0)
    assert tab.controller_status() == ("driving", 0, "")


def test_a_controller_that_has_ended_is_not_shown_as_driving(tab):
    tab.take(diagnostics(), now=100.0, time=10.0)
    tab.take([], now=100.0 + STALE_LIGHT, time=10.0 + STALE_LIGHT)
    assert tab.controller_status() == ("driving", 0, "")
    tab.take([], now=101.0 + STALE_LIGHT, time=11.0 + STALE_LIGHT)
    sentence = "husky_highlevel_controller: no status for more than 5 s; the node may have ended"
    assert tab.controller_status() == ("", 3, sentence)
    tab.take(diagnostics(), now=200.0, time=100.0)
    assert tab.controller_status() == ("driving", 0, "")


@pytest.mark.parametrize("times", [(10.0, 10.0), (10.0, 0.5), (None, 10.0)])
def test_a_light_of_a_paused_or_slow_or_restarted_simulator_is_not_stale(times, tab):
    for seconds, time in enumerate([*times, times[-1] + 1.0]):
        tab.take(diagnostics() if not seconds else [], now=100.0 * seconds, time=time)
    assert tab.controller_status() == ("driving", 0, "")


def test_without_simulated_time_the_wall_time_counts(tab):
    tab.take(diagnostics(), now=100.0)
    tab.take([], now=101.0 + STALE_LIGHT)
    assert tab.controller_status()[0] == ""
