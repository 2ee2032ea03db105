"""Calls from service threads into the thread that owns the simulation."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import rospy

from husky_highlevel_controller.ros.simulator.call_queue import CallQueue

DEADLINE = 10.0  # [s]


@pytest.fixture
def queue():
    return CallQueue()


@pytest.fixture
def callers(monkeypatch):
    """Threads, each for one call."""
    with ThreadPoolExecutor(5) as pool:
        yield pool
        monkeypatch.setattr(rospy, "is_shutdown", lambda: True)  # releases calls that are never made


def test_the_owner_does_the_work_and_the_caller_gets_the_result(queue, callers):
    result = callers.submit(queue.call, threading.get_ident)
    queue.process(DEADLINE)
    assert result.result(DEADLINE) == threading.get_ident()


def test_an_error_is_raised_in_the_caller_and_the_owner_goes_on(queue, callers):
    failed = callers.submit(queue.call, lambda: 1 / 0)
    queue.process(DEADLINE)
    assert isinstance(failed.exception(DEADLINE), ZeroDivisionError)
    second = callers.submit(queue.call, lambda: 2)
    queue.process(DEADLINE)
    assert second.result(DEADLINE) == 2


def test_a_call_that_advances_the_simulation_waits_until_the_step_is_over(queue, callers):
    step = callers.submit(queue.call, lambda: "stepped", between_steps=True)
    pause = callers.submit(queue.call, lambda: "paused")
    while not pause.done():
        queue.process_during_step()
    assert not step.done()
    while not step.done():
        queue.process()
    assert (step.result(), pause.result()) == ("stepped", "paused")


def test_a_step_never_runs_inside_another(queue, callers):
    depth, deepest = 0, 0

    def step():
        nonlocal depth, deepest
        depth += 1
        deepest = max(deepest, depth)
        queue.process_during_step()  # as lockstep does while it waits for an answer
        depth -= 1

    calls = [callers.submit(queue.call, step, between_steps=True) for _ in range(5)]
    while not all(call.done() for call in calls):
        queue.process(0.01)
    assert deepest == 1


def test_a_caller_is_released_when_the_node_ends(queue, monkeypatch):
    monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
    with pytest.raises(rospy.ROSInterruptException, match="the simulator ends"):
        queue.call(lambda: None)
