"""As fast as it goes, time waits for a controller that answers every scan, and for no other."""

import threading

import pytest

from husky_highlevel_controller.ros.simulator import lockstep
from husky_highlevel_controller.ros.simulator.lockstep import FOLLOWING_SCANS, MAX_LEAD, LeadLimit


class Arrived(threading.Event):
    """Takes no time; counts in `waits` how often it was waited for in vain."""

    waits = 0

    def wait(self, timeout=None):
        Arrived.waits += not self.is_set()
        return self.is_set()


@pytest.fixture
def limit(monkeypatch):
    Arrived.waits = 0
    monkeypatch.setattr(lockstep.threading, "Event", Arrived)
    return LeadLimit(True)


def drive(limit, scans, answers_each):
    """Send scans; every n-th is answered."""
    before = Arrived.waits
    for number in range(scans):
        limit.before_scan()
        if number % answers_each == 0:
            limit.command_arrived()
    return Arrived.waits - before


def test_one_that_answers_every_scan_is_never_waited_for(limit):
    assert drive(limit, 100, 1) == 0


@pytest.mark.parametrize("answers_each", [MAX_LEAD + 1, 1000])
def test_one_that_does_not_is_waited_for_once(limit, answers_each):
    assert drive(limit, 100, answers_each) == 1


def test_one_that_answers_again_is_waited_for_again(limit):
    assert drive(limit, 100, 1000) == 1
    assert drive(limit, FOLLOWING_SCANS + 1, 1) == 0
    assert drive(limit, 100, 1000) == 1


def test_nobody_is_waited_for_at_another_pace(monkeypatch):
    Arrived.waits = 0
    monkeypatch.setattr(lockstep.threading, "Event", Arrived)
    assert drive(LeadLimit(False), 100, 1000) == 0


def test_time_goes_on_with_the_answer(monkeypatch):
    monkeypatch.setattr(lockstep, "CONTROLLER_TIMEOUT", 60.0)
    limit = LeadLimit(True)
    for _ in range(MAX_LEAD - 1):
        limit.before_scan()
    waiting = threading.Thread(target=limit.before_scan)
    waiting.start()
    limit.command_arrived()
    waiting.join(30.0)
    assert not waiting.is_alive()
