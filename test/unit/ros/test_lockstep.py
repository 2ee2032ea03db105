"""Lockstep: one scan, one command; and never a wait without an end."""

from __future__ import annotations

import threading

import pytest
import rospy

from husky_highlevel_controller.ros.simulator import lockstep
from husky_highlevel_controller.ros.simulator.lockstep import Lockstep


def make(wanted):
    return Lockstep(wanted, scans=None)  # whose listeners are asked only after SLEEP_TIMEOUT


def nothing():
    """A callback without effect."""


@pytest.fixture
def warnings(monkeypatch):
    said = []
    monkeypatch.setattr(rospy, "logwarn", said.append)
    return said


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
        threading.Thread(target=steps.answer, args=("cmd_vel",)).start()

    steps.wait_for_answer(meanwhile, nothing)
    assert during
    assert warnings == []


def test_a_command_from_before_the_scan_does_not_answer_it(impatient, warnings):
    steps = make(True)
    steps.answer("cmd_vel")
    steps.begin_scan()
    steps.wait_for_answer(nothing, nothing)
    assert warnings == [
        "lockstep: after 0.02 s of wall time no command answers the scan; running free from now on"
    ]


def test_without_an_answer_it_runs_free_from_then_on_and_says_so_once(impatient, warnings):
    steps, during = make(True), []
    for _ in range(3):
        steps.begin_scan()
        steps.wait_for_answer(lambda: during.append(1), nothing)
        during.append(0)
    assert during[-2:] == [0, 0], "no waiting any more"
    assert len(warnings) == 1


def test_switched_off_it_never_waits(warnings):
    steps = make(False)
    steps.begin_scan()
    steps.wait_for_answer(pytest.fail, pytest.fail)
    assert warnings == []


def test_the_scan_is_sent_again_if_the_very_first_command_does_not_come(monkeypatch):
    monkeypatch.setattr(lockstep, "RESEND_TIMEOUT", 0.0)
    steps, sent, checks = make(True), [], []

    def resend():
        sent.append(1)
        steps.answer("cmd_vel")

    steps.begin_scan()
    steps.wait_for_answer(nothing, resend)
    assert len(sent) == 1

    def answer_late():
        checks.append(1)
        if len(checks) == 3:
            steps.answer("cmd_vel")

    steps.begin_scan()
    steps.wait_for_answer(answer_late, pytest.fail)


def test_of_several_commands_for_one_scan_the_first_counts_on_each_topic():
    steps = make(True)
    assert not steps.drops("cmd_vel"), "before the first scan"
    steps.answer("cmd_vel")
    assert not steps.drops("cmd_vel"), "before the first scan"
    steps.begin_scan()
    assert not steps.drops("cmd_vel")
    steps.answer("cmd_vel")
    assert steps.drops("cmd_vel")
    assert not steps.drops("joy_teleop/cmd_vel"), "which may take over"
    steps.begin_scan()
    assert not steps.drops("cmd_vel")


def test_free_running_obeys_every_command(impatient, warnings):
    for steps in (make(False), make(True)):
        steps.begin_scan()
        steps.wait_for_answer(nothing, nothing)  # in vain
        steps.answer("cmd_vel")
        assert not steps.drops("cmd_vel")
