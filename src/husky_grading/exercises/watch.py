"""Watch of a drive: what an exercise does in it, what it keeps of it, and when it is over.

The recorder calls it, and does for it all that takes ROS: so a watch is plain Python.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Collection, Dict, FrozenSet, Mapping, NamedTuple, Optional, Protocol, Tuple

from husky_grading.notes import Kind, Note
from husky_grading.recording import EstimatedPath, Recording
from husky_highlevel_controller.datatypes import TrueState, Vector3


class Answer(NamedTuple):
    """Answer of a service, or what went wrong."""

    success: bool
    text: str


class RosAccess(Protocol):
    """Access of a watch to the ROS network of a drive."""

    def advertise_commands(self) -> None:
        """Take the part of a node that publishes velocity commands."""

    def command(self, speed: float) -> None:
        """Publish a command to drive ahead at this speed [m/s]."""

    def service_types(self, names: Collection[str]) -> Mapping[str, str]:
        """Return the types of services as far as they are known; those of new names are asked for."""

    def call(self, name: str, value: bool) -> None:
        """Call a service of type std_srvs/SetBool; `answer` gives what comes of it."""

    def answer(self) -> Optional[Answer]:
        """Return the answer to the last call, or that none came in time; None while it is waited for."""

    def callers(self, service: str) -> Mapping[str, int]:
        """Return how often each node of the submission has looked a service up, as each call of it does."""

    def parameters(self) -> Mapping[str, Any]:
        """Return the values of the submission's parameters by their names."""

    def place(self, frame: str) -> Optional[Vector3]:
        """Return the place of a frame in base_link by the newest transforms [m]; None: none connect them."""

    def places(self) -> Mapping[str, Vector3]:
        """Return the place in base_link of each frame [m] that transforms connect with it."""


@dataclass(frozen=True)
class DriveState:
    """State of a drive at one look."""

    now: float  # [s], simulated
    speed: float  # [m/s], true
    subscribed: bool = False  # the submission listens to the `input_topic` of the watch
    listens: bool = False  # it listens to a topic that not every node has
    advertises: bool = False  # it has a publisher of velocity commands
    commands: int = 0  # that have come
    abandoned: bool = False  # none of its nodes runs any more
    services: Tuple[str, ...] = ()  # that it offers


class Watch:
    """Watch of a submission that drives by the scans up to the deadline; the base of all others."""

    follows: FrozenSet[str] = frozenset()  # types of messages; those on the submission's topics come in
    reads_scans = True  # the recorder subscribes to the scans, too

    def __init__(self, known: Recording, ros: RosAccess) -> None:
        """Prepare for a drive of which so much is known before it begins."""
        self._known, self._ros = known, ros

    @property
    def input_topic(self) -> str:
        """Topic that the submission has to listen to."""
        return self._known.scan_topic

    def takes_part(self, state: DriveState) -> bool:
        """Whether the submission is ready: time begins then, and not before."""
        return state.subscribed and state.advertises

    def on_truth(self, state: TrueState) -> None:
        """Follow the next true state."""

    def on_scan(self, stamp: float) -> None:
        """Answer a scan of this time [s]."""

    def on_message(self, topic: str, message: Any) -> None:
        """Take a message of the submission, whose type is one of `follows`."""

    def look(self, state: DriveState) -> Optional[Note]:
        """Do what is due, and return why the drive is over; None if the drive goes on.

        The recorder calls it several times a second.
        """
        if state.now >= self._known.deadline:
            return Note(Kind.DEADLINE, f"the deadline of {self._known.deadline:g} s")
        return None

    def has_silenced(self, last_command: float) -> bool:
        """Whether the submission was asked to send nothing since its last command [s, simulated]."""
        return False

    def kept(self) -> Dict[str, Any]:
        """Return what the judge needs beside the rest of the recording: records, arrays and plain values."""
        return {}

    @property
    def estimate(self) -> Optional[EstimatedPath]:
        """Path of the robot that the submission estimates; None: that is not its task."""
        return None
