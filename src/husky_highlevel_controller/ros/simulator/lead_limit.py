"""Limit of the simulated time's lead over a controller that answers every scan, when the clock is not paced.

In: when a scan is about to be sent, when a command has arrived. Out: waits, for milliseconds.
"""

from __future__ import annotations

import threading

MAX_LEAD = 2  # scans sent since the last command
CONTROLLER_TIMEOUT = 0.1  # [s] of wall time: a slower controller is not waited for
FOLLOWING_SCANS = 10  # scans in a row with a command in between: it answers every scan again


class LeadLimit:
    """Lets the simulation be some scans ahead of the controller's answers, and no more.

    At 20 times real time a controller that gets no CPU for 20 ms lets the robot drive blindly for 0.4 s.
    A controller that answers some scans only is not waited for.
    """

    def __init__(self, is_on: bool) -> None:
        self._is_on = self._follows = is_on
        self._arrived = threading.Event()
        self._lead = self._in_a_row = 0

    def command_arrived(self) -> None:
        """Call for every velocity command. Any thread."""
        self._arrived.set()

    def before_scan(self) -> None:
        """Call before a scan is sent: waits where the controller is too far behind."""
        if not self._is_on:
            return
        answered = self._arrived.is_set()
        self._lead, self._in_a_row = (0, self._in_a_row + 1) if answered else (self._lead + 1, 0)
        if self._follows and self._lead >= MAX_LEAD:
            self._follows = self._arrived.wait(CONTROLLER_TIMEOUT)
            self._lead = 0
        self._follows = self._follows or self._in_a_row >= FOLLOWING_SCANS
        self._arrived.clear()
