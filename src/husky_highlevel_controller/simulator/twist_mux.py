"""Command priorities and locks of the Husky's twist_mux: which sender drives the robot.

In: who sent a command, and when. Out: whether it is obeyed.
Must not know: ROS, what was commanded.

Numbers: husky_control/config/twist_mux.yaml of husky 0.6.10 (Noetic).
"""

from __future__ import annotations

from typing import Dict, Mapping

# topic: priority
INPUTS = {
    "joy_teleop/cmd_vel": 10,
    "kb_teleop/cmd_vel": 9,
    "twist_marker_server/cmd_vel": 8,
    "cmd_vel": 1,
}
TIMEOUT = 0.5  # [s], an input that was silent for longer gives way


class CommandMux:
    """Passes on the commands of the most important input that is not silent; a lock stops them all."""

    def __init__(self, inputs: Mapping[str, int] = INPUTS, timeout: float = TIMEOUT) -> None:
        self._inputs, self._timeout = inputs, timeout
        self.locked = False
        self.forget()

    def forget(self) -> None:
        """Take every input for silent; a lock stays."""
        self._last_stamps: Dict[str, float] = {}

    def passes(self, topic: str, now: float) -> bool:
        """Note that an input sent a command at `now` [s]; whether it is the one to obey."""
        self._last_stamps[topic] = now
        priority = self._inputs[topic]
        return not self.locked and not any(
            self._inputs[other] > priority and now - stamp <= self._timeout
            for other, stamp in self._last_stamps.items()
        )
