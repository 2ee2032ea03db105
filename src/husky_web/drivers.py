"""Drivers: the nodes that command the robot. Finds the node that the robot obeys, as twist_mux does.

In: geometry_msgs/Twist of each input, with its sender. Out: the sender's name, and whether it is a person.
"""

from __future__ import annotations

import re
from typing import Dict, List, NamedTuple, Optional, Tuple

from husky_highlevel_controller.simulator.twist_mux import TIMEOUT
from husky_web.topics import INPUTS, Received

# [s] a command counts at least for this wall time, even if simulated time is faster, because nodes for
# driving by hand repeat their commands in wall-clock time
MIN_WALL_TIME = 0.25
MAX_SENDERS = 100  # largest number of senders whose last command is kept
# end of the name of an anonymous node: the number of its process, and the time of its start
_ANONYMOUS = re.compile(r"_\d+_\d{10,}$")


class Command(NamedTuple):
    """Last command of a sender, if it was not zero."""

    name: str  # input on which the command came, one of INPUTS
    sender: str
    time: Optional[float]  # [s] simulated time at which it came; None if unknown
    now: float  # [s] wall time at which it came

    @property
    def is_by_hand(self) -> bool:
        """Return whether the command came on an input with a higher priority than the controller's."""
        return self.name != INPUTS[-1]

    def counts(self, time: Optional[float], now: float) -> bool:
        """Return whether the robot still obeys the command at `time` (simulated) and `now` (wall time) [s].

        A command counts for TIMEOUT of simulated time, as in twist_mux, but at least for MIN_WALL_TIME. While
        simulated time is unknown, a command counts for TIMEOUT of wall time.
        """
        wall_age = now - self.now
        if time is None:
            return wall_age < TIMEOUT
        if wall_age < MIN_WALL_TIME:
            return True
        # simulated time was unknown when the command came, or has begun again at 0 since then
        if self.time is None or time < self.time:
            return False
        return time - self.time <= TIMEOUT


class Drivers:
    """The last command of each sender."""

    def __init__(self) -> None:
        # last command of each sender on each input; the newest command is the last one in the dictionary
        self._last_commands: Dict[Tuple[str, str], Command] = {}

    def take(self, received: List[Received], time: Optional[float], now: float) -> None:
        """Take in commands of the inputs, which came at `time` (simulated) and `now` (wall) [s]."""
        for name, msg in received:
            sender = msg._connection_header["callerid"]
            # the earlier command is removed, so that the newest command is the last one in the dictionary
            self._last_commands.pop((name, sender), None)
            if msg.linear.x != 0.0 or msg.angular.z != 0.0:
                self._last_commands[name, sender] = Command(name, sender, time, now)
        while len(self._last_commands) > MAX_SENDERS:
            oldest = next(iter(self._last_commands))  # the first key of the dictionary
            self._last_commands.pop(oldest)

    def command(self, time: Optional[float], now: float) -> Optional[Command]:
        """Return the command that the robot obeys at `time` (simulated) and `now` (wall) [s], or None.

        Of all commands that still count, it is the newest one on the input with the highest priority.
        """
        obeyed: Optional[Command] = None
        for command in self._last_commands.values():  # the oldest command first
            if not command.counts(time, now):
                continue
            # INPUTS begins with the highest priority; on the same input, the newer command replaces the older
            if obeyed is None or INPUTS.index(command.name) <= INPUTS.index(obeyed.name):
                obeyed = command
        return obeyed

    def forget(self) -> None:
        """Drop all commands."""
        self._last_commands.clear()


def short_name(node: str) -> str:
    """Return the name of a node, without the numbers of an anonymous node."""
    return _ANONYMOUS.sub("", node)
