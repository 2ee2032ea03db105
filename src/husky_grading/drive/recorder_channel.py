"""Channel between marking and the recorder of a drive: one connection with messages of these types.

The recorder is a program that marking forks, so each holds an end of it, and nobody else does: nothing that a
submission could write or print has to be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass
from multiprocessing import Pipe
from typing import Any, Optional, Tuple

from husky_grading.isolation.forked import RECORDER
from husky_grading.isolation.ros_network import Network
from husky_grading.recording import Recording


@dataclass(frozen=True)
class Assignment:
    """First message to the recorder: its task."""

    recording: Recording  # as far as it is known before the drive
    truth_socket: str  # where the simulator connects
    exercise: int  # whose watch follows the drive
    ours: Tuple[str, ...]  # nodes that are not the submission's
    packages: Tuple[str, ...] = ()  # folders of the submission's packages, for meshes


@dataclass(frozen=True)
class GoOn:
    """Message to the recorder: take part without the submission, for which lockstep would wait."""


@dataclass(frozen=True)
class Abandoned:
    """Message to the recorder: no node of the submission is left."""


@dataclass(frozen=True)
class HandOver:
    """Message to the recorder: the drive is cut off; hand over what there is of it."""


@dataclass(frozen=True)
class Ready:
    """Message of the recorder: it listens for the simulator."""


@dataclass(frozen=True)
class Joined:
    """Message of the recorder: the submission takes part, or does not in time."""


@dataclass(frozen=True)
class Now:
    """Message of the recorder, several times a second."""

    at: float  # [s], simulated
    subscribed: bool  # the submission listens to what it has to


@dataclass(frozen=True)
class Over:
    """Message of the recorder: the drive is over; the last message, a `Recording`, follows."""


class RecorderChannel:
    """Marking's end: the state of a recorder, by what it has told up to the last `update`."""

    def __init__(self, network: Network, assignment: Assignment) -> None:
        """Start the recorder of a drive in its network."""
        self._connection, recorder_end = Pipe()
        with recorder_end:
            self.process = network.start("recorder", [RECORDER], handed=(recorder_end,))
        self.is_open = True  # the recorder may tell more
        self.ready = self.joined = self.subscribed = self.over = False
        self.now = 0.0  # [s], simulated
        self.recording: Optional[Recording] = None
        self.tell(assignment)

    def tell(self, message: Any) -> None:
        """Send a message; a recorder that has ended needs none."""
        try:
            self._connection.send(message)
        except OSError:
            self.is_open = False

    def update(self) -> RecorderChannel:
        """Take in what the recorder has told since; the channel itself."""
        try:
            while self.is_open and self._connection.poll():
                self._take(self._connection.recv())
        except (EOFError, OSError):  # it has ended
            self.is_open = False
        return self

    def _take(self, message: Any) -> None:
        if isinstance(message, Now):
            self.now, self.subscribed = message.at, message.subscribed
        elif isinstance(message, Recording):
            self.recording = message
        else:
            self.ready |= isinstance(message, Ready)
            self.joined |= isinstance(message, Joined)
            self.over |= isinstance(message, Over)
