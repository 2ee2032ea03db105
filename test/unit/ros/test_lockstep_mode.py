"""Lockstep: one scan, one command; and never a wait without an end."""

import threading

import pytest
import rospy

from husky_highlevel_controller.ros.simulator import lockstep
from husky_highlevel_controller.ros.simulator.lockstep import Lockstep


def make(wanted, asleep=True):
    return Lockstep(wanted, Controller(asleep))


def nothing():
    """A callback without effect."""


@pytest.fixture
def warnings(monkeypatch):
    warnings = []
    monkeypatch.setattr(rospy, "logwarn", warnings.append)
    return warnings


@pytest.fixture
def impatient(monkeypatch):
    """Lockstep that gives up at once."""
    monkeypatch.setattr(lockstep, "ANSWER_TIMEOUT", 0.02)
    monkeypatch.setattr(lockstep, "POLL_PERIOD", 0.005)


def test_it_waits_until_a_command_answers_the_scan(warnings):
    steps, during = make(True), []
    steps.begin_scan()

    def meanwhile():
        during.append("a service call")
        threading.Thread(target=steps.command_arrived, args=("cmd_vel",)).start()

    steps.wait_for_answer(meanwhile, nothing, nothing)
    assert during
    assert warnings == []


def test_without_an_answer_it_runs_free_from_then_on_says_so_once_and_obeys_every_command(
    impatient, warnings
):
    steps, during = make(True), []
    steps.command_arrived("cmd_vel")  # from before the scan, which it does not answer
    for _ in range(3):
        steps.begin_scan()
        steps.wait_for_answer(lambda: during.append(1), nothing, nothing)
        during.append(0)
    assert during[-2:] == [0, 0], "no waiting any more"
    words = "lockstep: after 0.02 s of wall time no command answers the scan; running free from now on"
    assert warnings == [words]
    steps.command_arrived("cmd_vel")
    assert not steps.drops("cmd_vel")


def test_switched_off_it_never_waits_and_obeys_every_command(warnings):
    steps = make(False)
    steps.begin_scan()
    steps.wait_for_answer(pytest.fail, pytest.fail, pytest.fail)
    steps.command_arrived("cmd_vel")
    assert not steps.drops("cmd_vel")
    assert warnings == []


def test_of_several_commands_for_one_scan_the_first_counts_on_each_topic():
    steps = make(True)
    assert not steps.drops("cmd_vel"), "before the first scan"
    for number in range(10):
        answer(steps)
        assert steps.drops("cmd_vel") == (number == 9), "while it is watched, each has its moment"
    steps.begin_scan()
    assert not steps.drops("cmd_vel")
    steps.command_arrived("cmd_vel")
    assert steps.drops("cmd_vel")
    assert not steps.drops("joy_teleop/cmd_vel"), "which may take over"
    steps.begin_scan()
    assert not steps.drops("cmd_vel")


# ---------------------------------------------------------------------------- how long it waits


class Clock:
    """Wall time that goes on by what is waited for, and by 0.05 s with each look for service calls."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds

    def look(self):
        self.now += 0.05


class Controller:
    """Stands in for the processes that receive the scans."""

    def __init__(self, asleep):
        self.is_asleep = asleep

    def asleep(self):
        return self.is_asleep


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(lockstep, "time", clock)
    monkeypatch.setattr(lockstep, "POLL_PERIOD", 0.0)
    monkeypatch.setattr(rospy, "loginfo", nothing_of)
    monkeypatch.setattr(rospy, "loginfo_once", nothing_of)
    return clock


def nothing_of(_):
    """A log without lines."""


def begun(asleep):
    """Lockstep that has had its first command."""
    steps = make(True, asleep)
    steps.command_arrived("cmd_vel")
    return steps


def answer(steps):
    """A scan that is answered at once."""
    steps.begin_scan()
    steps.command_arrived("cmd_vel")
    steps.wait_for_answer(nothing, pytest.fail, pytest.fail)


def wait(steps, clock, nudge=nothing):
    """A scan that gets no command from outside; the scan is not sent again."""
    steps.begin_scan()
    steps.wait_for_answer(clock.look, pytest.fail, nudge)


def answer_at_ticks(steps, count=12):
    """Scans answered before a tick of the clock."""
    for _ in range(count):
        steps.begin_scan()
        steps.command_arrived("cmd_vel")
        steps.tick(nothing, nothing)
        steps.wait_for_answer(nothing, pytest.fail, pytest.fail)


def test_a_controller_that_computes_has_five_seconds_for_a_command(clock, warnings):
    wait(begun(asleep=False), clock)
    assert clock.now == pytest.approx(5.0, abs=0.2)
    assert "after 5 s of wall time no command answers the scan" in warnings[0]


def test_without_a_controller_time_begins_after_a_minute(clock, warnings):
    class Nobody:
        scan_topic, command_topics = "/front/scan", "/cmd_vel"

        def joined(self):
            return False

    make(True).wait_for_partners(Nobody(), clock.look)
    assert clock.now == pytest.approx(60.0, abs=0.2)
    assert "after 60 s of wall time there is no subscriber of /front/scan" in warnings[0]


def test_the_first_scan_is_sent_again_after_a_second(clock):
    steps, sent = make(True, asleep=False), []

    def resend():
        sent.append(clock.now)
        steps.command_arrived("cmd_vel")

    steps.begin_scan()
    steps.wait_for_answer(clock.look, resend, pytest.fail)
    assert sent == [pytest.approx(1.0, abs=0.1)]


def test_a_controller_that_sleeps_is_waited_for_twice_and_then_no_longer(clock, warnings):
    steps = begun(asleep=True)
    wait(steps, clock)
    assert clock.now == pytest.approx(2 * 0.3, abs=0.1)  # the second one for a sleep that is over soon
    asleep_from = clock.now
    for _ in range(20):
        wait(steps, clock)
    assert clock.now - asleep_from < 20 * 0.1
    assert warnings == []


def test_ten_scans_answered_in_a_row_end_the_sleep(clock):
    steps = begun(asleep=True)
    wait(steps, clock)
    for answered in range(1, 11):
        steps.begin_scan()
        steps.command_arrived("cmd_vel")
        assert not steps.drops("cmd_vel"), f"asleep, after {answered - 1} answers"
        steps.wait_for_answer(clock.look, pytest.fail, pytest.fail)
    steps.begin_scan()
    steps.command_arrived("cmd_vel")
    assert steps.drops("cmd_vel"), "it answers every scan again"


def test_a_sleeping_controller_that_stays_busy_ends_lockstep(clock, warnings):
    listeners = Controller(asleep=True)
    steps = Lockstep(True, listeners)
    steps.command_arrived("cmd_vel")
    wait(steps, clock)
    listeners.is_asleep = False
    before = clock.now
    steps.tick(clock.look, nothing)
    assert clock.now - before == pytest.approx(5.0, abs=0.2)
    assert "a controller that sleeps between scans is still busy" in warnings[0]


def test_one_that_sleeps_between_two_ticks_of_the_clock_is_woken_and_watched_to_the_end(clock, warnings):
    steps, nudged = begun(asleep=True), []

    def nudge():
        nudged.append(clock.now)
        steps.command_arrived("cmd_vel")

    for _ in range(10):
        answer(steps)
    wait(steps, clock, nudge)
    assert nudged == [pytest.approx(0.3, abs=0.1)]
    for _ in range(12):
        answer(steps)
        assert not steps.drops("cmd_vel"), "it is watched"
    assert warnings == []


@pytest.mark.parametrize("slept", [False, True])
def test_one_that_commands_at_a_tick_of_the_clock_is_watched_to_the_end_also_when_it_is_awake(slept, clock):
    steps = begun(asleep=True)
    if slept:
        wait(steps, clock)
    answer_at_ticks(steps)
    assert not steps.drops("cmd_vel")
    for _ in range(12):
        answer(steps)
    assert not steps.drops("cmd_vel")


def test_a_tick_comes_twice_for_those_that_may_have_missed_it_while_they_are_watched(clock):
    steps, again = begun(asleep=True), []
    for _ in range(12):
        steps.begin_scan()
        steps.tick(nothing, lambda: again.append(1))
        steps.command_arrived("cmd_vel")
        steps.wait_for_answer(nothing, pytest.fail, pytest.fail)
    assert len(again) == 10


def test_what_never_sleeps_is_watched_for_a_second_only(clock, warnings):
    steps = begun(asleep=False)
    steps.begin_scan()
    steps.tick(clock.look, nothing)
    assert clock.now == pytest.approx(1.0, abs=0.1)
    steps.command_arrived("cmd_vel")
    steps.wait_for_answer(clock.look, pytest.fail, pytest.fail)
    steps.begin_scan()
    steps.tick(pytest.fail, pytest.fail)
    assert clock.now == pytest.approx(1.0, abs=0.1)
    assert warnings == []


def test_a_controller_that_answered_before_it_slept_is_not_watched_when_it_is_awake(clock):
    steps = begun(asleep=True)
    for _ in range(10):
        answer(steps)
    wait(steps, clock)
    for _ in range(10):
        answer(steps)
    steps.tick(nothing, pytest.fail)
