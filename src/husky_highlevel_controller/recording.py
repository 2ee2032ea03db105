"""What was seen of one drive: all that marking looks at, written to a file and read again.

In: numbers and words. Out: a `Recording`, as JSON and back. Must not know: ROS, points.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Dict, List, Tuple

import numpy as np

from husky_highlevel_controller.control import HULL_X, HULL_Y
from husky_highlevel_controller.datatypes import HuskyError, Pose2D


class RecordingError(HuskyError):
    """A file that is no recording."""


@dataclass(frozen=True)
class Shown:
    """One marker, as it was published."""

    topic: str
    name: str  # namespace/id
    at: float  # [s], simulated, when it came
    stamp: float  # [s]; 0: whatever is the latest
    frame: str
    position: Tuple[float, float, float]  # [m], in the world, by the transforms of its stamp; nan without
    problem: str = ""  # why nobody could see it


@dataclass(frozen=True)
class Call:
    """One call of a start/stop service."""

    at: float  # [s], simulated
    data: bool  # what was sent
    success: bool
    answer: str  # its words, or what went wrong


@dataclass(frozen=True, eq=False)
class Recording:
    """One drive of one submission; arrays are read-only."""

    start: Pose2D  # of base_link in the world
    pillar: Tuple[float, float]  # [m], its centre in the world, before anybody pushes it
    deadline: float  # [s], simulated
    times: np.ndarray  # (N,) [s], simulated, of the true poses
    poses: np.ndarray  # (N, 3) [m, m, rad], true x, y, yaw of base_link in the world
    speeds: np.ndarray  # (N, 2) [m/s, rad/s], true, in base_link
    commands: np.ndarray  # (M,) [s], simulated, when commands came; at most one for each true pose
    command_count: int = 0  # all of them
    nearest: np.ndarray = field(
        default_factory=lambda: np.zeros((0, 2))
    )  # (K, 2) [s, m], smallest valid range of each scan; inf for none
    markers: Tuple[Shown, ...] = ()
    marker_topics: Tuple[str, ...] = ()  # that the submission publishes, whether or not anything came
    services: Tuple[str, ...] = ()  # std_srvs/SetBool that the submission offers
    calls: Tuple[Call, ...] = ()
    topic_parameters: Tuple[str, ...] = ()  # private parameters whose value is the scans' topic
    queue_parameters: Tuple[
        str, ...
    ] = ()  # private parameters that are a whole number and called ...queue...
    subscribed: bool = False  # the submission listens to the scans
    notes: Tuple[str, ...] = ()  # what went wrong, in sentences
    ended: str = ""  # why the drive ended
    output: str = ""  # what the submission printed, shortened

    @property
    def hull_gaps(self) -> np.ndarray:
        """From the robot's outline to the pillar's surface, were the pillar never moved, (N,) [m]."""
        return hull_gaps(self.poses, self.pillar)

    @property
    def moving(self) -> np.ndarray:
        """When the robot drives or turns, (N,) bool."""
        return (np.abs(self.speeds[:, 0]) > STANDS) | (np.abs(self.speeds[:, 1]) > STANDS)

    @property
    def driving(self) -> np.ndarray:
        """When the robot drives, (N,) bool; one that trembles on the spot does not."""
        return np.abs(self.speeds[:, 0]) > STANDS


def empty_recording(pillar: Tuple[float, float], deadline: float, notes: Tuple[str, ...]) -> Recording:
    """Of a drive that never began."""
    nothing = np.zeros(0)
    return Recording(
        Pose2D(), pillar, deadline, nothing, np.zeros((0, 3)), np.zeros((0, 2)), nothing, notes=notes
    )


CUT_OFF = "it was cut off"  # why a drive ended that the recorder did not end
STANDS = 0.05  # [m/s] and [rad/s], slower is standing
PILLAR_RADIUS = 0.2  # [m], of the course's pillar
_WHEELS = (0.4211, 0.3426)  # [m], half length and half width of the rectangle about the Husky's wheels


def hull_gaps(poses: np.ndarray, pillar: Tuple[float, float]) -> np.ndarray:
    """From the robot's outline, seen from above, to the pillar's surface, (N,) [m]; negative: inside."""
    dx, dy = (np.asarray(pillar) - poses[:, :2]).T
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    along, across = np.abs(c * dx + s * dy), np.abs(c * dy - s * dx)
    to_center = [
        np.hypot(np.maximum(along - length, 0.0), np.maximum(across - width, 0.0))
        for length, width in ((HULL_X, HULL_Y), _WHEELS)
    ]
    return np.min(to_center, axis=0) - PILLAR_RADIUS


_ARRAYS = {"times": (-1,), "poses": (-1, 3), "speeds": (-1, 2), "commands": (-1,), "nearest": (-1, 2)}


def to_json(recording: Recording) -> str:
    """Everything, as text."""
    content = {name: value for name, value in vars(recording).items() if name not in _ARRAYS}
    content["start"] = recording.start._asdict()
    content["markers"] = [asdict(marker) for marker in recording.markers]
    content["calls"] = [asdict(call) for call in recording.calls]
    for name in _ARRAYS:
        content[name] = np.round(getattr(recording, name), 4).tolist()
    return json.dumps(content)


def from_json(text: str) -> Recording:
    """What `to_json` wrote.

    Raises:
        RecordingError: it did not write this.
    """
    try:
        content: Dict[str, Any] = json.loads(text)
        content["start"] = Pose2D(**content["start"])
        content["pillar"] = tuple(content["pillar"])
        content["markers"] = tuple(
            Shown(**{**marker, "position": tuple(marker["position"])}) for marker in content["markers"]
        )
        content["calls"] = tuple(Call(**call) for call in content["calls"])
        for name, shape in _ARRAYS.items():
            array = np.array(content[name], dtype=float).reshape(shape)
            array.setflags(write=False)
            content[name] = array
        lists: List[str] = [name for name, value in content.items() if isinstance(value, list)]
        content.update({name: tuple(content[name]) for name in lists})
        return Recording(**content)
    except (ValueError, TypeError, KeyError) as error:
        raise RecordingError(f"not a recording: {error}") from error


def load(path: Path) -> Recording:
    """A recording from its file.

    Raises:
        RecordingError: there is none, or it is broken.
    """
    try:
        return from_json(path.read_text())
    except OSError as error:
        raise RecordingError(f"no recording: {error}") from error
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
