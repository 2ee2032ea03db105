"""Holds the simulated clock until a controller has answered the scan before."""

from __future__ import annotations

import threading
import time
from typing import Callable

import rospy

PARTNER_DEADLINE = 30.0  # [s] of wall time for a controller to join
ANSWER_DEADLINE = 5.0  # [s] of wall time for it to answer a scan
GLANCE = 0.05  # [s] of wall time between two looks at whether the node is to end


class Lockstep:
    """One scan, one command: then a whole ROS run is repeatable, however busy the machine is.

    Where nobody answers in time it says so, once, and the simulation runs free from then on.
    """

    def __init__(self, wanted: bool) -> None:
        self._on = wanted
        self._answered = threading.Event()

    def answer(self) -> None:
        """Note that a command has arrived; any thread may call this."""
        self._answered.set()

    def wait_for_partner(
        self, scans: rospy.Publisher, commands: rospy.Subscriber, meanwhile: Callable[[], None]
    ) -> None:
        """Wait until somebody listens to the scans and sends commands, doing `meanwhile` now and then."""

        def joined() -> bool:
            meanwhile()
            return bool(scans.get_num_connections() and commands.get_num_connections())

        failing = f"nobody listens to {scans.resolved_name} and sends {commands.resolved_name}"
        self._wait(joined, PARTNER_DEADLINE, failing)

    def expect_answer(self) -> None:
        """Call before a scan is published: what was answered so far does not count."""
        self._answered.clear()

    def wait_for_answer(self) -> None:
        """Wait until a command has arrived since `expect_answer`."""
        if self._on and not self._answered.is_set():
            self._wait(lambda: self._answered.wait(GLANCE), ANSWER_DEADLINE, "no command answers the scan")

    def _wait(self, done: Callable[[], bool], deadline: float, failing: str) -> None:
        end = time.monotonic() + deadline
        while self._on and not rospy.is_shutdown() and not done():
            if time.monotonic() > end:
                rospy.logwarn(
                    f"lockstep: after {deadline:g} s of wall time {failing}; running free from now on"
                )
                self._on = False
            time.sleep(0.001)
