"""Lockstep: holds the simulated clock until a command has answered the last scan."""

from __future__ import annotations

import threading
import time
from typing import Callable, Set

import rospy

from husky_highlevel_controller.ros.simulator.listeners import Listeners
from husky_highlevel_controller.ros.simulator.partners import Partners

# [s] of wall time
PARTNER_TIMEOUT = 60.0  # for a controller to connect
ANSWER_TIMEOUT = 5.0  # for a command to answer a scan
RESEND_TIMEOUT = 1.0  # for the first command, before the scan is published again
SLEEP_TIMEOUT = 0.3  # for an answer of a controller that does nothing meanwhile
WATCH_TIMEOUT = 1.0  # for processes to fall asleep that have answered; some, as RViz, never do
POLL_PERIOD = 0.05  # between two checks for service calls during a wait
PARTNERS_POLL_PERIOD = 0.02  # more often, /clock would take CPU time from those who start

AWAKE = 10  # scans answered in a row: the controller does not sleep, or not any more


class Lockstep:
    """Clock that waits after each scan for one command: a ROS run is repeatable on the busiest machine.

    A controller that sleeps by simulated time answers no scan meanwhile. The clock then goes on scan by scan,
    each time as soon as every process that receives scans is asleep again: that run, too, repeats itself.
    Likewise a controller is watched whose sleep begins before or after a tick of the clock as the machine
    pleases: each is at first, one that commands at a tick or sleeps between two of them to the end.
    Where one computes for too long, a warning is logged once, and the simulation runs free from then on.
    """

    def __init__(
        self, wanted: bool, scans: rospy.Publisher, on_unanswered: Callable[[str], None] = lambda _: None
    ) -> None:
        """Wait for answers to `scans`; `on_unanswered` is called with a sentence when one stays out."""
        self._on, self._begun = wanted, False
        self._answered = threading.Event()
        self._listeners, self._on_unanswered = Listeners(scans), on_unanswered
        self._sleeps, self._in_a_row = False, 0
        self._watched, self._to_the_end = wanted, False
        self._scanned = self._due = False  # a scan was sent; one is about to be sent or answered
        self._answered_on: Set[str] = set()  # topics with a command since the last scan

    def drops(self, topic: str) -> bool:
        """Whether a command that arrives on this topic is one too many: the last scan has one. Any thread.

        Such a command arrives before or after the next physics step as the machine pleases, so a run that
        obeyed it would not be repeatable.
        """
        slow = self._sleeps or self._watched
        return self._on and self._scanned and not slow and topic in self._answered_on

    def command_arrived(self, topic: str) -> None:
        """Take a command on any velocity topic for the answer to the last scan. Any thread."""
        self._answered_on.add(topic)
        self._begun = True
        self._answered.set()

    def wait_for_partners(self, partners: Partners, meanwhile: Callable[[], None]) -> None:
        """Wait until the partners have joined, calling `meanwhile`."""

        def joined() -> bool:
            meanwhile()
            return partners.joined()

        if self._on:
            rospy.loginfo(
                f"lockstep: time waits for a subscriber of {partners.scan_topic} and a sender of "
                f"{partners.command_topics}"
            )
        missing = f"there is no subscriber of {partners.scan_topic} or no sender of {partners.command_topics}"
        self._wait(joined, PARTNER_TIMEOUT, missing, PARTNERS_POLL_PERIOD)

    def begin_scan(self) -> None:
        """Call before a scan is published: commands until now do not answer it."""
        self._scanned = self._due = True
        self._answered_on.clear()
        self._answered.clear()

    def wait_for_answer(
        self, meanwhile: Callable[[], None], resend: Callable[[], None], nudge: Callable[[], None]
    ) -> None:
        """Wait until a command has arrived since `begin_scan`, calling `meanwhile` for service calls.

        A controller's very first command may be lost while its publisher connects: until one has come, the
        scan is sent again. One that sleeps until after the last tick of the clock, but not to the next, is
        woken by `nudge`, which moves the clock and nothing else.
        """
        if not self._on:
            return
        if not self._sleeps:
            self._wait_for_command(meanwhile, resend, nudge)
        self._settle(meanwhile)
        self._due = False
        self._in_a_row = self._in_a_row + 1 if self._answered.is_set() else 0
        self._sleeps = self._sleeps and self._in_a_row < AWAKE
        self._watched = self._watched and (self._to_the_end or self._in_a_row < AWAKE)

    def tick(self, meanwhile: Callable[[], None], again: Callable[[], None]) -> None:
        """Call when the clock went on: waits for a controller that sleeps, or may, to do what is due now.

        rospy.sleep looks at the clock, then waits for the next tick of it: a tick in between is missed, so it
        comes once more, by `again`.
        """
        self._settle(meanwhile)
        if self._on and (self._sleeps or self._watched):
            again()
            self._settle(meanwhile)
        if self._due and self._watched and self._answered.is_set():
            self._to_the_end = True  # a command before the scan was sent: it commands at ticks

    def _wait_for_command(
        self, meanwhile: Callable[[], None], resend: Callable[[], None], nudge: Callable[[], None]
    ) -> None:
        since, may_resend, may_nudge = time.monotonic(), not self._begun, self._begun

        def answered() -> bool:
            nonlocal since, may_resend, may_nudge
            meanwhile()
            waited = time.monotonic() - since
            if may_resend and not self._begun and waited > RESEND_TIMEOUT:
                since, may_resend = time.monotonic(), False
                resend()
            elif not may_resend and waited > SLEEP_TIMEOUT and self._listeners.asleep():
                self._sleeps = not may_nudge
                since, may_nudge = time.monotonic(), False
                if not self._sleeps:
                    nudge()
            return self._sleeps or self._answered.wait(POLL_PERIOD)

        if self._answered.is_set():
            return
        could_nudge = may_nudge
        self._wait(answered, ANSWER_TIMEOUT, "no command answers the scan")
        if self._sleeps:
            rospy.loginfo_once("lockstep: a controller sleeps; the clock goes on scan by scan meanwhile")
            self._on_unanswered(
                "it does not answer every scan with a command; the clock goes on while it waits"
            )
        elif could_nudge and not may_nudge:
            self._watched = self._to_the_end = True

    def _settle(self, meanwhile: Callable[[], None]) -> None:
        def settled() -> bool:
            meanwhile()
            return self._listeners.asleep()

        if self._on and self._sleeps:
            self._wait(settled, ANSWER_TIMEOUT, "a controller that sleeps between scans is still busy")
        elif self._on and self._watched:
            end = time.monotonic() + WATCH_TIMEOUT
            while self._watched and not settled():
                self._watched = time.monotonic() < end and not rospy.is_shutdown()
                time.sleep(0.001)

    def _wait(self, done: Callable[[], bool], timeout: float, missing: str, period: float = 0.001) -> None:
        end = time.monotonic() + timeout
        while self._on and not rospy.is_shutdown() and not done():
            if time.monotonic() > end:
                rospy.logwarn(
                    f"lockstep: after {timeout:g} s of wall time {missing}; running free from now on"
                )
                self._on = False
                self._on_unanswered(
                    "it does not answer every scan with a command, so simulated time ran on without it"
                )
            time.sleep(period)
