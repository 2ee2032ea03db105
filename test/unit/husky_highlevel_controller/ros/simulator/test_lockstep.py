"""Lockstep: one scan, one command; and never a wait without an end."""

import threading
from types import SimpleNamespace

import pytest
import rospy

from husky_highlevel_controller.ros.simulator import lockstep
from husky_highlevel_controller.ros.simulator.lockstep import (
    FOLLOWING_SCANS,
    MAX_LEAD,
    LeadLimit,
    Lockstep,
)


class Run:
    """Lockstep and its listeners; wall time goes on by what is waited for, and by 0.05 s with each look."""

    def __init__(self, asleep=True, is_on=True, begun=True):
        self.now, self.is_asleep, self.repeated_ticks = 0.0, asleep, 0
        self.told = []  # kinds
        self.lockstep = Lockstep(is_on, self, lambda kind, _: self.told.append(kind))
        if begun:
            self.command()

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds

    def look(self):
        """A look for service calls, and for listeners that sleep."""
        self.now += 0.05

    def asleep(self):
        return self.is_asleep

    def command(self):
        self.lockstep.command_arrived("cmd_vel")

    def drops(self):
        return self.lockstep.drops("cmd_vel")

    def tick(self):
        """A tick of the clock; the wall time that it takes."""
        before = self.now
        self.lockstep.tick(self.look, lambda: setattr(self, "repeated_ticks", self.repeated_ticks + 1))
        return self.now - before

    def scan(self, answers=True, ticks=False, resend=pytest.fail, nudge=pytest.fail):
        """A scan, and its answer at once, before a tick or after; the wall time that it takes."""
        before = self.now
        self.lockstep.begin_scan()
        if answers:
            self.command()
        if ticks:
            self.tick()
        self.lockstep.wait_for_answer(self.look, resend, nudge)
        return self.now - before


@pytest.fixture
def start(monkeypatch):
    """Starts a run by its own wall time."""
    monkeypatch.setattr(lockstep, "POLL_PERIOD", 0.0)

    def begin(**how):
        run = Run(**how)
        monkeypatch.setattr(lockstep, "time", run)
        return run

    return begin


@pytest.fixture
def warnings(monkeypatch):
    warnings = []
    monkeypatch.setattr(rospy, "logwarn", warnings.append)
    return warnings


def nothing():
    """A callback without effect."""


def test_it_waits_until_a_command_answers_the_scan(warnings):
    run, during = Run(begun=False), []
    run.lockstep.begin_scan()

    def meanwhile():
        during.append("a service call")
        threading.Thread(target=run.command).start()

    run.lockstep.wait_for_answer(meanwhile, nothing, nothing)
    assert during
    assert warnings == []


def test_a_controller_that_computes_has_five_seconds_and_then_time_runs_free(start, warnings):
    run = start(asleep=False)
    assert run.scan(answers=False) == pytest.approx(5.0, abs=0.2)
    assert [run.scan(answers=False), run.tick()] == [0.0, 0.0]
    words = "lockstep: after 5 s of wall time no command answers the scan; continuing without lockstep"
    assert warnings == [words]
    run.command()
    assert not run.drops(), "every command is obeyed"


@pytest.mark.parametrize("late", [0.3, 0.6])
def test_a_command_that_comes_while_the_listeners_are_looked_at_is_an_answer(start, late):
    run = start()
    nudges = []

    def asleep():
        """Idle, but the command has come just before."""
        if run.now > late:
            run.command()
        return True

    run.asleep = asleep
    run.scan(answers=False, nudge=lambda: nudges.append(run.now))
    assert len(nudges) == (late > 0.3), "only a controller that is late needs the clock"
    run.asleep = lambda: True
    assert run.scan(answers=False, nudge=nothing) > 0.5, "a controller that is awake is waited for"


def test_switched_off_it_never_waits_and_obeys_every_command(start, warnings):
    run = start(is_on=False)
    assert [run.scan(answers=False), run.tick()] == [0.0, 0.0]
    run.command()
    assert not run.drops()
    assert warnings == []


def test_of_several_commands_for_one_scan_the_first_counts_on_each_topic(start):
    run = start()
    assert not run.drops(), "before the first scan"
    for number in range(10):
        run.scan()
        assert run.drops() == (number == 9), "while it is watched, each has its moment"
    run.lockstep.begin_scan()
    assert not run.drops()
    run.command()
    assert run.drops()
    assert not run.lockstep.drops("joy_teleop/cmd_vel"), "which may take over"


def test_without_a_controller_time_begins_after_a_minute(start, warnings):
    run = start(begun=False)
    partners = SimpleNamespace(scan_topic="/front/scan", command_topics="/cmd_vel", joined=lambda: False)
    run.lockstep.wait_for_partners(partners, run.look)
    assert run.now == pytest.approx(60.0, abs=0.2)
    assert "after 60 s of wall time there is no subscriber of /front/scan" in warnings[0]


def test_the_first_scan_is_sent_again_after_a_second(start):
    run, sent = start(asleep=False, begun=False), []

    def resend():
        sent.append(run.now)
        run.command()

    run.scan(answers=False, resend=resend)
    assert sent == [pytest.approx(1.0, abs=0.1)]


@pytest.mark.parametrize("answered_before", [0, 10])
def test_a_controller_that_sleeps_is_waited_for_twice_and_again_after_ten_answers(
    start, warnings, answered_before
):
    run = start()
    for _ in range(answered_before):
        run.scan()
    # the second time for a sleep that is over soon
    assert run.scan(answers=False, nudge=nothing) == pytest.approx(2 * 0.3, abs=0.1)
    for _ in range(20):
        assert run.scan(answers=False) < 0.1
    for answers in range(10):
        assert not run.drops(), f"asleep, after {answers} answers"
        run.scan()
    assert run.drops(), "it answers every scan again"
    repeated = run.repeated_ticks
    run.tick()
    assert run.repeated_ticks == repeated, "and is not watched"
    assert warnings == []


def test_a_controller_that_waits_until_it_is_called_does_not_sleep_through_scans(start):
    run = start(begun=False)
    for _ in range(3):
        run.scan(answers=False, resend=nothing, nudge=nothing)
    for _ in range(10):
        run.scan()
    assert run.told == []
    for _ in range(2):
        run.scan(answers=False, nudge=nothing)
    assert run.told == ["asleep", "asleep"], "after its first command"


def test_a_sleeping_controller_that_stays_busy_ends_lockstep(start, warnings):
    run = start()
    run.scan(answers=False, nudge=nothing)
    run.is_asleep = False
    assert run.tick() == pytest.approx(5.0, abs=0.2)
    assert "a controller that sleeps between scans is still busy" in warnings[0]
    assert run.told[-1] == "unanswered"


def test_one_that_sleeps_between_two_ticks_of_the_clock_is_woken_and_watched_to_the_end(start, warnings):
    run = start()
    for _ in range(10):
        run.scan()
    assert run.scan(answers=False, nudge=run.command) == pytest.approx(0.3, abs=0.15)
    for _ in range(12):
        run.scan()
        assert not run.drops(), "it is watched"
    assert warnings == []


@pytest.mark.parametrize("slept", [False, True])
def test_one_that_commands_at_a_tick_of_the_clock_is_watched_to_the_end_also_when_it_is_awake(slept, start):
    run = start()
    if slept:
        run.scan(answers=False, nudge=nothing)
    for number in range(24):
        run.scan(ticks=number < 12)
        assert not run.drops()


def test_a_tick_comes_twice_for_those_that_may_have_missed_it_while_they_are_watched(start):
    run = start()
    for _ in range(12):
        run.tick()
        run.scan()
    assert run.repeated_ticks == 10


def test_what_never_sleeps_is_watched_for_a_second_only(start, warnings):
    run = start(asleep=False)
    assert run.tick() == pytest.approx(1.0, abs=0.1)
    assert [run.scan(), run.tick()] == [0.0, 0.0]
    assert warnings == []


# ---------------------------------------------------------------------------- as fast as it goes


class Arrived(threading.Event):
    """Takes no time; counts in `waits` how often it was waited for in vain."""

    waits = 0

    def wait(self, timeout=None):
        Arrived.waits += not self.is_set()
        return self.is_set()


def waits(limit, scans, answers_each):
    """Waits in vain while scans are sent and every n-th is answered."""
    before = Arrived.waits
    for number in range(scans):
        limit.before_scan()
        if number % answers_each == 0:
            limit.command_arrived()
    return Arrived.waits - before


@pytest.mark.parametrize("answers_each", [MAX_LEAD + 1, 1000])
def test_time_waits_once_for_a_controller_that_no_longer_answers_every_scan(monkeypatch, answers_each):
    monkeypatch.setattr(lockstep.threading, "Event", Arrived)
    limit = LeadLimit(True)
    assert waits(limit, 100, 1) == 0
    for _ in range(2):
        assert waits(limit, 100, answers_each) == 1
        assert waits(limit, FOLLOWING_SCANS + 1, 1) == 0, "it answers again"
    at_another_pace = LeadLimit(False)
    assert waits(at_another_pace, 100, 1) + waits(at_another_pace, 100, answers_each) == 0


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
