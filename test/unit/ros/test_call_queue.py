"""Calls from service threads into the thread that owns the simulation."""

import threading

import pytest
import rospy

from husky_highlevel_controller.ros.simulator.call_queue import CallQueue

DEADLINE = 10.0  # [s]


class Caller(threading.Thread):
    """A thread that makes one call and keeps its outcome."""

    def __init__(self, queue, work, between_steps=False):
        super().__init__(daemon=True)
        self._call = lambda: queue.call(work, between_steps)
        self.outcome = None
        self.start()

    def run(self):
        try:
            self.outcome = self._call()
        except Exception as error:
            self.outcome = error

    def ended(self):
        self.join(DEADLINE)
        return not self.is_alive()


@pytest.fixture
def queue():
    return CallQueue()


def test_the_owner_does_the_work_and_the_caller_gets_the_result(queue):
    caller = Caller(queue, threading.get_ident)
    queue.process(DEADLINE)
    assert caller.ended()
    assert caller.outcome == threading.get_ident()


def test_an_error_is_raised_in_the_caller_and_the_owner_goes_on(queue):
    caller = Caller(queue, lambda: 1 / 0)
    queue.process(DEADLINE)
    assert caller.ended()
    assert isinstance(caller.outcome, ZeroDivisionError)
    second = Caller(queue, lambda: 2)
    queue.process(DEADLINE)
    assert second.ended()
    assert second.outcome == 2


def test_a_call_that_advances_the_simulation_waits_until_the_step_is_over(queue):
    caller = Caller(queue, lambda: "stepped", between_steps=True)
    other = Caller(queue, lambda: "paused")
    while other.outcome is None:
        queue.process_during_step()
    assert caller.outcome is None
    while caller.outcome is None:
        queue.process()
    assert (caller.outcome, other.outcome) == ("stepped", "paused")


def test_a_step_never_runs_inside_another(queue):
    depth, deepest = 0, 0

    def step():
        nonlocal depth, deepest
        depth += 1
        deepest = max(deepest, depth)
        queue.process_during_step()  # as lockstep does while it waits for an answer
        depth -= 1

    callers = [Caller(queue, step, between_steps=True) for _ in range(5)]
    while any(caller.is_alive() for caller in callers):
        queue.process(0.01)
    assert deepest == 1


def test_a_caller_is_released_when_the_node_ends(queue, monkeypatch):
    monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
    with pytest.raises(rospy.ROSInterruptException, match="the simulator ends"):
        queue.call(lambda: None)
