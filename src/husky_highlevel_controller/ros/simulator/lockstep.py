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
POLL_PERIOD = 0.05  # between two checks for service calls during a wait

AWAKE = 10  # scans answered in a row: the controller does not sleep any more


class Lockstep:
    """One scan, one command: then a whole ROS run is repeatable, however busy the machine is.

    A controller that sleeps by simulated time answers no scan meanwhile. The clock then goes on scan by scan,
    each time as soon as every process that receives scans is asleep again: that run, too, repeats itself.
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
        self._scanned = False
        self._answered_on: Set[str] = set()  # topics with a command since the last scan

    def drops(self, topic: str) -> bool:
        """Whether a command that arrives on this topic is one too many: the last scan has one. Any thread.

        Such a command arrives before or after the next physics step as the machine pleases, so a run that
        obeyed it would not be repeatable.
        """
        return self._on and self._scanned and not self._sleeps and topic in self._answered_on

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
                f"lockstep: time waits for a subscriber of {partners.topics} and a sender of "
                f"{partners.command_topic}"
            )
        missing = f"there is no subscriber of {partners.topics} or no sender of {partners.command_topic}"
        self._wait(joined, PARTNER_TIMEOUT, missing)

    def begin_scan(self) -> None:
        """Call before a scan is published: commands until now do not answer it."""
        self._scanned = True
        self._answered_on.clear()
        self._answered.clear()

    def wait_for_answer(self, meanwhile: Callable[[], None], resend: Callable[[], None]) -> None:
        """Wait until a command has arrived since `begin_scan`, calling `meanwhile` for service calls.

        A controller's very first command may be lost while its publisher connects: until one has come, the
        scan is sent again.
        """
        if not self._on:
            return
        if self._sleeps:
            self.settle(meanwhile)
            self._in_a_row = self._in_a_row + 1 if self._answered.is_set() else 0
            self._sleeps = self._in_a_row < AWAKE
            return
        sent, again = time.monotonic(), not self._begun

        def answered() -> bool:
            nonlocal sent, again
            meanwhile()
            waited = time.monotonic() - sent
            if again and not self._begun and waited > RESEND_TIMEOUT:
                sent, again = time.monotonic(), False
                resend()
            elif not again and waited > SLEEP_TIMEOUT and self._listeners.asleep():
                self._sleeps, self._in_a_row = True, 0
            return self._sleeps or self._answered.wait(POLL_PERIOD)

        if not self._answered.is_set():
            self._wait(answered, ANSWER_TIMEOUT, "no command answers the scan")
            if self._sleeps:
                rospy.loginfo_once("lockstep: a controller sleeps; the clock goes on scan by scan meanwhile")
                self._on_unanswered(
                    "it does not answer every scan with a command: simulated time goes on while it sleeps"
                )

    def settle(self, meanwhile: Callable[[], None]) -> None:
        """While the controller sleeps by simulated time: wait until it has done what is due at this time."""

        def settled() -> bool:
            meanwhile()
            return self._listeners.asleep()

        if self._on and self._sleeps:
            self._wait(settled, ANSWER_TIMEOUT, "a controller that sleeps between scans is still busy")

    def _wait(self, done: Callable[[], bool], timeout: float, missing: str) -> None:
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
            time.sleep(0.001)
