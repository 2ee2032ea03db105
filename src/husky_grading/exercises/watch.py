"""Watch of a run: it acts for an exercise, keeps a record for its judge, and decides when the run is over.

The recorder calls the watch and gives it access to ROS, so a watch is plain Python.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Collection, Dict, FrozenSet, Mapping, NamedTuple, Optional, Protocol, Tuple

from husky_grading.notes import Kind, Note
from husky_grading.recording import EstimatedPath, Recording
from husky_highlevel_controller.datatypes import TrueState, Vector3


class Answer(NamedTuple):
    """Answer of a service, or the error."""

    success: bool
    text: str
    is_error: bool = False  # true if the call failed, and `text` is its error


class RosAccess(Protocol):
    """Access of a watch to the ROS network of a run."""

    def advertise_commands(self) -> None:
        """Advertise velocity commands, because the submission does not drive."""

    def command(self, speed: float) -> None:
        """Publish a command to drive ahead at this speed [m/s]."""

    def service_types(self, names: Collection[str]) -> Mapping[str, str]:
        """Return the types of services as far as they are known, and ask for the types of new names."""

    def call(self, name: str, value: bool) -> None:
        """Call a service of type std_srvs/SetBool; `answer` returns its answer later."""

    def answer(self) -> Optional[Answer]:
        """Return the answer to the last call, or the error if none came in time; None while it is awaited."""

    def callers(self, service: str) -> Mapping[str, int]:
        """Return how often each node of the submission has looked a service up; each call is one lookup."""

    def parameters(self) -> Mapping[str, Any]:
        """Return the values of the submission's parameters by their names."""

    def place(self, frame: str) -> Optional[Vector3]:
        """Return the position of a frame in base_link [m] by the newest transforms; None if it has none."""

    def places(self) -> Mapping[str, Vector3]:
        """Return the positions in base_link [m] of all frames that transforms connect with it."""


@dataclass(frozen=True)
class DriveState:
    """State of a run, each time that the recorder calls `Watch.look`."""

    now: float  # [s] simulated time
    speed: float  # [m/s] true speed
    subscribed: bool = False  # true if the submission subscribes to the topic that the exercise needs
    # true if the submission subscribes to a topic; topics to which every ROS node subscribes do not count
    listens: bool = False
    advertises: bool = False  # true if the submission has a publisher of velocity commands
    commands: int = 0  # number of velocity commands that the submission has sent so far
    abandoned: bool = False  # true if no node of the submission runs any more
    services: Tuple[str, ...] = ()  # names of the services that the submission offers


class Watch:
    """Base class of all watches; it fits a submission that reads the scans and drives until the deadline."""

    # types of the messages of the submission that the recorder passes to `on_message`
    follows: FrozenSet[str] = frozenset()
    reads_scans = True  # false in exercise 4, in which a bag is played and no simulator sends scans

    def __init__(self, initial: Recording, ros: RosAccess) -> None:
        """Prepare for a run; `initial` is the recording before the run, with pillar, robot and deadline."""
        self._initial_recording, self._ros = initial, ros

    @property
    def input_topic(self) -> str:
        """Return the topic to which the submission has to subscribe."""
        return self._initial_recording.scan_topic

    def is_submission_ready(self, state: DriveState) -> bool:
        """Return whether the submission is ready, because simulated time begins only then."""
        return state.subscribed and state.advertises

    def on_truth(self, state: TrueState) -> None:
        """Follow the next true state."""

    def on_scan(self, stamp: float) -> None:
        """Answer a scan of this time [s]."""

    def on_message(self, topic: str, message: Any) -> None:
        """Take a message of the submission, whose type is one of `follows`."""

    def look(self, state: DriveState) -> Optional[Note]:
        """Take the action that is due, and return why the run is over, or None if it goes on.

        The recorder calls it several times per second.
        """
        if state.now >= self._initial_recording.deadline:
            return Note(Kind.DEADLINE, f"the deadline of {self._initial_recording.deadline:g} s")
        return None

    def has_silenced(self, last_command: float) -> bool:
        """Return whether the watch told the submission to stop shortly before its last command, or after it.

        Missing commands after such a stop are not a fault. A submission needs a moment to obey, so a few
        commands may come after the stop. If commands come for longer, the submission does not obey, or drives
        again. Only exercise 5 tells a submission to stop.

        Args:
            last_command: simulated time of the submission's last command [s].
        """
        return False

    def kept(self) -> Dict[str, Any]:
        """Return the exercise's own record of the run for the judge: records, arrays and plain values."""
        return {}

    @property
    def estimate(self) -> Optional[EstimatedPath]:
        """Return the path of the robot that the submission estimates; None if this is not its task."""
        return None
