"""Waiting for a program's nodes: for what still can come, and not for what cannot, on a busy machine too."""

from types import SimpleNamespace

import pytest

from husky_grading.drive import progress
from husky_grading.drive.progress import wait_while_active
from husky_grading.drive.ros_graph import Registered

PROCESS = SimpleNamespace(running=True, popen=SimpleNamespace(pid=1))
NOTHING = Registered()
ADVERTISED = Registered(frozenset({"/n"}), frozenset({"/cmd_vel"}))
LISTENS = Registered(frozenset({"/n"}), frozenset({"/cmd_vel"}), frozenset({"/front/scan"}))


class Machine:
    """Wall time, and a program that computes for a share of it, registers, and is seen to run or not."""

    def __init__(self, monkeypatch, share, registers, runs=lambda now: True):
        self.now, self.share, self.registers = 0.0, share, registers
        monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(progress, "wait", self.wait)
        monkeypatch.setattr(progress, "state_of_tree", lambda _: (runs(self.now), self.share * self.now))

    def wait(self, condition, seconds, period):
        while not condition() and self.now < seconds:
            self.now += period

    def graph(self):
        return [NOTHING, *(seen for at, seen in self.registers if at <= self.now)][-1]


BUSY, SLOW, STARVED = 1.0, 0.3, 0.01  # share of a CPU


@pytest.mark.parametrize(
    ("share", "registers", "nodes", "ends_at"),
    [
        (BUSY, [(6.0, ADVERTISED)], 1, 12.0),  # it publishes in a loop, and never listens
        (SLOW, [(6.0, ADVERTISED)], 1, 23.0),
        (BUSY, [(6.0, LISTENS)], 1, 12.0),  # to another topic than is waited for
        (BUSY, [(6.0, ADVERTISED)], 2, 26.0),  # a node is missing: it may come
        (BUSY, [], 1, 50.0),  # it computes before it registers anything
        (STARVED, [(6.0, ADVERTISED)], 1, 300.0),  # the machine is busy: it may come
    ],
)
def test_a_program_that_is_never_idle_has_settled_soon_after_its_last_registration(
    share, registers, nodes, ends_at, monkeypatch
):
    machine = Machine(monkeypatch, share, registers)
    assert not wait_while_active(PROCESS, nodes, lambda: False, machine.graph)
    assert machine.now == pytest.approx(ends_at, abs=2.0)


def test_a_program_that_publishes_now_and_then_has_settled_too(monkeypatch):
    """It sleeps most of the time, never for long, so that it is not idle."""
    machine = Machine(monkeypatch, 0.05, [(6.0, ADVERTISED)], runs=lambda now: int(now) % 2 == 0)
    assert not wait_while_active(PROCESS, 1, lambda: False, machine.graph)
    assert machine.now == pytest.approx(17.0, abs=2.0)


def test_what_is_registered_later_is_waited_for(monkeypatch):
    machine = Machine(monkeypatch, BUSY, [(3.0, ADVERTISED), (7.0, LISTENS)])
    assert wait_while_active(PROCESS, 1, lambda: bool(machine.graph().subscribed), machine.graph)
    assert machine.now == pytest.approx(7.0, abs=0.2)


@pytest.mark.parametrize(
    ("registers", "ends_at"),
    [([], 12.0), ([(1.0, ADVERTISED)], 12.0), ([(1.0, LISTENS)], 2.0)],
    ids=["it may sleep for 10 s", "likewise after it has advertised", "it listens elsewhere"],
)
def test_a_program_that_is_idle_waits_for_something_else(registers, ends_at, monkeypatch):
    machine = Machine(monkeypatch, 0.01, registers, runs=lambda now: False)
    assert not wait_while_active(PROCESS, 1, lambda: False, machine.graph)
    assert machine.now == pytest.approx(ends_at, abs=1.0)
