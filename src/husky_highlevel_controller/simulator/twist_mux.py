"""Command priorities and locks of a twist_mux: which sender drives the robot.

In: topic and time of each command. Out: whether the robot obeys the command.

Several nodes may send velocity commands, each on an input (topic) of its own, for example a joystick and a
controller. The strongest input that is not silent drives the robot.

This module replaces the node of twist_mux 3.1 (Noetic) on the Husky and the SMB. Inputs and timeout are from
twist_mux.yaml of husky_control 0.6.10 and of smb_control. No test runs the original, which Debian does not
have. `test_twist_mux.py` tests the rule that a weaker input waits until all stronger inputs were silent for
the timeout.
"""

from __future__ import annotations

from typing import Dict, Optional, Sequence

TIMEOUT = 0.5  # [s] a topic without a command for longer than this loses its priority over other topics


class CommandMux:
    """Filter of commands: the strongest input that is not silent passes, but a lock stops all inputs."""

    def __init__(self, inputs: Sequence[str]) -> None:
        """`inputs`: topics, the strongest first."""
        self._ranks = {topic: rank for rank, topic in enumerate(inputs)}  # 0 is the strongest
        self.locked = False  # true while a lock, such as the emergency stop, stops the robot
        self.forget()

    def forget(self) -> None:
        """Treat every input as silent; a lock stays."""
        self._last_stamps: Dict[str, float] = {}  # [s] time of the last command on each input

    def passes(self, topic: str, now: float) -> bool:
        """Note that an input has sent a command at `now` [s]; return whether the robot obeys the command."""
        self._last_stamps[topic] = now
        return not self.locked and self.stronger(topic, now) is None

    def stronger(self, topic: str, now: float) -> Optional[str]:
        """Return the strongest input that is obeyed instead of `topic` at `now` [s], or None."""
        stronger_inputs = [
            other
            for other, stamp in self._last_stamps.items()
            if now - stamp <= TIMEOUT and self._ranks[other] < self._ranks[topic]
        ]
        return min(stronger_inputs, key=lambda other: self._ranks[other], default=None)
