"""Channel between marking and the recorder of a run: one connection with messages of these types.

Marking forks the recorder, so only these two programs hold an end of the connection. Marking need not trust
anything that a submission could write or print.
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

    recording: Recording  # recording that has only facts from before the run, such as the start pose
    truth_socket: str  # path of the socket on which the simulator sends true poses
    exercise: int  # number of the exercise; its `Watch` decides when the run is over
    # names of our nodes, such as the simulator, which are not nodes of the submission; the recorder adds its
    # own name
    ours: Tuple[str, ...]
    packages: Tuple[str, ...] = ()  # folders of the submission's packages, which may have meshes for markers


@dataclass(frozen=True)
class GoOn:
    """Message to the recorder: join the run, although the submission is not ready, so that time begins."""


@dataclass(frozen=True)
class Abandoned:
    """Message to the recorder: no node of the submission runs any more."""


@dataclass(frozen=True)
class HandOver:
    """Message to the recorder: the run is cut off; send the recording so far."""


@dataclass(frozen=True)
class Ready:
    """Message of the recorder: it listens on the socket for the simulator."""


@dataclass(frozen=True)
class Joined:
    """Message of the recorder: the submission takes part, or the recorder does in its place."""


@dataclass(frozen=True)
class Now:
    """Message of the recorder, several times per second."""

    at: float  # [s] simulated time
    # true if the submission subscribes to the topic that the exercise needs, usually the scans
    subscribed: bool


@dataclass(frozen=True)
class Over:
    """Message of the recorder: the run is over; the last message, a `Recording`, follows."""


class RecorderChannel:
    """Marking's end of the channel; its attributes have the recorder's state at the last `update`."""

    def __init__(self, network: Network, assignment: Assignment) -> None:
        """Start the recorder of a run in its network."""
        self._connection, recorder_end = Pipe()
        # The recorder gets a copy of `recorder_end`. After its start, `with` closes the end in this process.
        with recorder_end:
            self.process = network.start("recorder", [RECORDER], handed=(recorder_end,))
        self.is_open = True  # false if the recorder has ended, so that no more messages come
        # true if the message `Ready`, `Joined` or `Over` has come
        self.ready = self.joined = self.over = False
        # contents of the last message `Now`: simulated time [s], and whether the submission has subscribed
        self.now, self.subscribed = 0.0, False
        self.recording: Optional[Recording] = None  # last message of the recorder; None if it has not come
        self.send(assignment)

    def send(self, message: Any) -> None:
        """Send a message, if the recorder has not ended."""
        try:
            self._connection.send(message)
        except OSError:
            self.is_open = False

    def update(self) -> RecorderChannel:
        """Take in the messages that have come since the last call, and return the channel itself."""
        try:
            while self.is_open and self._connection.poll():
                message = self._connection.recv()
                if isinstance(message, Now):
                    self.now, self.subscribed = message.at, message.subscribed
                elif isinstance(message, Recording):
                    self.recording = message
                else:
                    self.ready |= isinstance(message, Ready)
                    self.joined |= isinstance(message, Joined)
                    self.over |= isinstance(message, Over)
        except (EOFError, OSError):  # the recorder has ended
            self.is_open = False
        return self
