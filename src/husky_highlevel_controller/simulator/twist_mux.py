"""Command priorities and locks of a twist_mux: which sender drives the robot.

In: who sent a command, and when. Out: whether it is obeyed.

Source: twist_mux.yaml of husky_control 0.6.10 and of smb_control, which have the same timeout.
"""

from __future__ import annotations

from typing import Dict, Sequence

TIMEOUT = 0.5  # [s], an input that was silent for longer gives way


class CommandMux:
    """Passes on the commands of the strongest input that is not silent; a lock stops them all."""

    def __init__(self, inputs: Sequence[str]) -> None:
        """`inputs`: topics, the strongest first."""
        self._ranks = {topic: rank for rank, topic in enumerate(inputs)}
        self.locked = False
        self.forget()

    def forget(self) -> None:
        """Take every input for silent; a lock stays."""
        self._last_stamps: Dict[str, float] = {}

    def passes(self, topic: str, now: float) -> bool:
        """Note that an input sent a command at `now` [s]; whether it is the one to obey."""
        self._last_stamps[topic] = now
        rank = self._ranks[topic]
        return not self.locked and not any(
            self._ranks[other] < rank and now - stamp <= TIMEOUT for other, stamp in self._last_stamps.items()
        )
