"""Recording of one run: true poses, commands, markers and the ROS graph, as JSON and back."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from math import inf, nan
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Type, TypeVar

import numpy as np

from husky_grading.notes import Kind, Note
from husky_highlevel_controller.config import from_plain, load, to_plain
from husky_highlevel_controller.course import PILLARS, STANDS, PillarSize
from husky_highlevel_controller.datatypes import Pose2D, Scan
from husky_highlevel_controller.robot import load_robot

Record = TypeVar("Record")
ADD, DELETE, DELETE_ALL = "add", "delete", "delete all"  # actions of a marker message


def table(help_text: str, *columns: int) -> Any:
    """Return a dataclass field for an array; by default, the array has no rows.

    With a number in `columns`, the array is (N, columns); without one, it is (N,).
    """
    metadata = {"shape": (-1, *columns), "help": help_text}
    return field(default_factory=lambda: np.zeros((0, *columns)), metadata=metadata)


@dataclass(frozen=True)
class MarkerSample:
    """Marker message, placed in the world; or the removal of markers."""

    topic: str
    namespace: str
    id: int
    at: float  # [s] simulated time at which the marker came
    stamp: float  # [s] stamp in the marker's header; if it is 0, the transforms at the time `at` are used
    frame: str
    # [m] position in the world: tip of an arrow, centre of a solid, mean of points, or end of a line; nan if
    # unknown
    position: Tuple[float, float, float]
    # [m] horizontal distance from the pillar's axis to the nearest point of the marker's shape
    reach: float = inf
    low: float = nan  # [m] height of the lowest point of the marker's shape in the world
    high: float = nan  # [m] height of the highest point of the marker's shape in the world
    until: float = inf  # [s] simulated time at which the marker's lifetime ends; inf if it never ends
    action: str = ADD
    problem: str = ""  # reason why RViz would not draw the marker; empty if RViz draws it
    finite: bool = True  # false if a number of the marker is inf or nan
    has_frame: bool = True  # false if TF never had the frame of the marker's header


@dataclass(frozen=True, eq=False)
class EstimatedPath:
    """Path of the robot as a submission estimates it."""

    topic: str = ""  # topic on which the estimate is published
    points: np.ndarray = table("[s, m, m], x and y by stamps", 3)


@dataclass(frozen=True)
class Closing:
    """Observations of a run by the program that started it; `closed` adds them to the recording."""

    notes: Tuple[Note, ...] = ()
    ended: Optional[Note] = None  # reason why the run was cut off; None if it was not cut off
    output: str = ""  # shortened output of the submission


@dataclass(frozen=True, eq=False)
class Recording:
    """Recording of one run of one submission; arrays are read-only."""

    start: Pose2D  # pose of base_link in the world at the start of the run
    # [m] centre of the pillar in the world at the start; the robot may push the pillar away later
    pillar: Tuple[float, float]
    deadline: float  # [s] simulated time at which the run ends at the latest
    times: np.ndarray = table("(N,) [s] simulated times of the true poses")
    poses: np.ndarray = table("[m, m, rad], true x, y, yaw of base_link in the world", 3)
    speeds: np.ndarray = table("[m/s, rad/s], true, in base_link", 2)
    commands: np.ndarray = table("(K,) [s] times at which commands came, each time once")
    command_count: int = 0  # number of all velocity commands
    zero_count: int = 0  # number of commands with all components zero
    # [m/s] largest absolute value of linear.x in all commands; None if unknown
    fastest: Optional[float] = None
    # [rad/s] largest absolute value of angular.z in all commands; None if unknown
    sharpest: Optional[float] = None
    nearest: np.ndarray = table("[s, m], smallest valid range of each scan; inf for none", 2)
    hits: np.ndarray = table("[s, m, m], points in the world of some of the scans", 3)
    markers: Tuple[MarkerSample, ...] = ()
    # topics on which the submission advertises markers, even if no marker came
    marker_topics: Tuple[str, ...] = ()
    # type of each of these topics, such as "visualization_msgs/Marker"; older recordings have no types
    marker_types: Mapping[str, str] = field(default_factory=dict)
    # true if the submission subscribes to the topic that the exercise needs: in exercise 4 the wheel odometry
    # of the bag, otherwise the scans
    subscribed: bool = False
    advertised: bool = True  # true if the submission has a publisher of velocity commands
    # topics to which the submission has subscribed, but on which no node has ever published
    silent_topics: Tuple[str, ...] = ()
    # topics of type geometry_msgs/Twist on which the submission publishes, but which no node reads
    unread_topics: Tuple[str, ...] = ()
    violations: Tuple[str, ...] = ()  # sentences on broken rules; a single broken rule costs all points
    notes: Tuple[Note, ...] = ()  # problems
    ended: Optional[Note] = None  # reason why the run ended
    output: str = ""  # shortened output of the submission
    robot: str = "husky"  # simulated robot, one of ROBOTS
    # version of the robot, a key of ROBOT_VERSIONS; versions of a robot differ in the topic of the scans
    simulated: str = "husky"
    scan_topic: str = "/front/scan"
    # sentence on a variable that the submission reads before it writes it; empty if no such variable was
    # found
    uninitialised: str = ""
    # keys are TF frames, values are their parent frames
    frames: Mapping[str, str] = field(default_factory=dict)
    # names of the ROS parameters with a robot description; at least one link of the description is a TF frame
    descriptions: Tuple[str, ...] = ()
    # path that the submission has estimated; None if the exercise does not ask for an estimate
    estimate: Optional[EstimatedPath] = None
    # data that only this exercise records; `watched_as` returns them as a record
    watched: Mapping[str, Any] = field(default_factory=dict)

    def watched_as(self, kind: Type[Record]) -> Record:
        """Return the data that only this run's exercise records, as a record.

        Raises:
            ConfigError: the record belongs to another exercise.
        """
        return from_plain(kind, self.watched, "watched: ")

    @property
    def hull_gaps(self) -> np.ndarray:
        """Return the gaps between footprint and pillar, as if the pillar never moved, (N,) [m]."""
        return hull_gaps(self.poses, self.pillar, self.robot)

    @property
    def pillar_size(self) -> PillarSize:
        """Return the size of the pillar on the robot's exercise sheets."""
        return PILLARS[self.robot]

    @property
    def moving(self) -> np.ndarray:
        """Return for each pose whether the robot drives, or turns on the spot, (N,) bool."""
        return (np.abs(self.speeds[:, 0]) > STANDS) | (np.abs(self.speeds[:, 1]) > STANDS)

    @property
    def driving(self) -> np.ndarray:
        """Return for each pose whether the robot drives ahead or back, and not only turns, (N,) bool."""
        return np.abs(self.speeds[:, 0]) > STANDS


RECORDING = "recording.json"  # name of the file with a recording, in the folder of a run
# largest number of commands per simulated second that is not a fault; 50 are enough to answer each scan
FLOOD = 300.0
# reason that the recorder gives if it is stopped before the run is over
CUT_OFF = Note(Kind.CUT_OFF, "it was cut off")


def drive_folders(out: Path) -> Dict[int, Path]:
    """Return the folders of the runs in a folder of results, drive_N, by their numbers, in order."""
    folders = {}
    for path in out.glob("drive_*"):
        number = path.name[len("drive_") :]
        if number.isdecimal():
            folders[int(number)] = path
    return {number: folders[number] for number in sorted(folders)}


def recordings_in(out: Path) -> List[Recording]:
    """Return the recordings of the runs in a folder of results, in order.

    Raises:
        ConfigError: a recording is broken.
    """
    paths = [folder / RECORDING for folder in drive_folders(out).values()]
    return [load(Recording, path) for path in paths if path.exists()]


def closed(recording: Recording, closing: Closing) -> Recording:
    """Return the complete recording of a run, with notes on a flood of commands and on a cut-off.

    Args:
        recording: recording by the recorder, which does not know the submission's process.
        closing: observations of the program that has started the submission's process.
    """
    notes = list(closing.notes)
    ends = (Kind.NODE_ENDED, Kind.NODE_FAILED, Kind.NODE_CRASHED)
    has_node_ended = any(note.kind in ends for note in notes)
    for note in recording.notes:
        # if a node has ended, its end already explains why scans had no answer, so UNANSWERED_SCANS is left
        # out
        if not (has_node_ended and note.kind is Kind.UNANSWERED_SCANS):
            notes.append(note)
    length = float(recording.times[-1]) if len(recording.times) else 0.0  # [s] length of the run
    # [s] time for the rate of commands; at least 1 s, because one command in a very short run is not a flood
    rate_time = max(length, 1.0)
    if recording.command_count / rate_time > FLOOD:
        text = f"it floods cmd_vel: {recording.command_count} commands in {rate_time:.0f} s of simulated time"
        notes.append(Note(Kind.FLOOD, text))
    # `recording.ended` is CUT_OFF if the recorder itself was stopped early
    if closing.ended or recording.ended == CUT_OFF:
        why = closing.ended.text if closing.ended else "the recorder ended early"
        notes.append(Note(Kind.CUT_OFF, f"the run was cut off at {length:.2f} s: {why}", length))
    # if the run was cut off, the reason for the cut-off counts, and not the reason that the recorder gives
    ended = closing.ended or recording.ended
    return replace(recording, notes=tuple(notes), ended=ended, output=closing.output)


def hull_gaps(poses: np.ndarray, pillar: Tuple[float, float], robot: str) -> np.ndarray:
    """Return the gaps between footprint and pillar, seen from above, (N,) [m]; negative if they overlap."""
    return load_robot(robot).footprint.gaps(poses, np.asarray(pillar), PILLARS[robot].radius)


def scan_hits(scans: Sequence[Scan], times: np.ndarray, poses: np.ndarray, robot: str) -> np.ndarray:
    """Return the points at which the beams of the robot's scans ended, (M, 3) [s, m, m] in the world.

    `times` (N,) [s] and `poses` (N, 3) [m, m, rad] are the true poses of base_link in the world.
    """
    if not len(times):  # no point is known without poses
        return np.zeros((0, 3))
    mount = load_robot(robot).lidar_mount  # position of the lidar in base_link
    hits = [np.zeros((0, 3))]  # this empty table gives the result three columns even if there is no scan
    for scan in scans:
        # index of the true pose at the time of the scan
        row = min(int(np.searchsorted(times, scan.stamp)), len(times) - 1)
        x, y, yaw = poses[row]
        ranges = scan.ranges[scan.valid]
        # [rad] directions of the beams in the world; a lidar that is upside down turns the other way
        angles = scan.bearings[scan.valid] * (-1.0 if mount.upside_down else 1.0) + yaw
        lidar_x, lidar_y = x + mount.x * np.cos(yaw), y + mount.x * np.sin(yaw)
        points = lidar_x + ranges * np.cos(angles), lidar_y + ranges * np.sin(angles)
        hits.append(np.column_stack([np.full(len(ranges), scan.stamp), *points]))
    return np.round(np.concatenate(hits), 3)


def recording_to_json(recording: Recording) -> str:
    """Return a recording as JSON."""
    return json.dumps(to_plain(recording))


TWIST_SIZE = 48  # [bytes] size of a serialised geometry_msgs/Twist: six doubles
NOTHING = 1e-6  # [m/s, rad/s] a component of a command counts as zero up to this absolute value


def is_zero(twist: bytes) -> bool:
    """Return whether all components of a serialised Twist are zero.

    Bytes that are not a Twist count as zero only if all of them are 0.
    """
    if len(twist) != TWIST_SIZE:
        return not any(twist)
    return bool((np.abs(np.frombuffer(twist, "<f8")) <= NOTHING).all())


def ahead_and_turn(twist: bytes) -> Tuple[float, float]:
    """Return the absolute values of linear.x [m/s] and angular.z [rad/s] of a serialised Twist.

    A value is inf if it is unknown, so an unknown command counts as a command that moves the robot.
    """
    if len(twist) != TWIST_SIZE:
        return inf, inf
    numbers = np.abs(np.frombuffer(twist, "<f8"))
    numbers = np.where(np.isfinite(numbers), numbers, inf)  # a NaN becomes inf
    return float(numbers[0]), float(numbers[5])  # linear.x is the first number, and angular.z the last one


# [m/s] A robot that moves faster than this has jumped, which breaks the rules. The limit is four times the
# Husky's top speed, because a contact may push the robot.
MAX_ROBOT_SPEED = 4.0
# [m] the robot may move this much farther between two poses than its speed allows, because the physics engine
# corrects contacts by moving the robot
JUMP_SLACK = 0.1


def pose_jumps(times: np.ndarray, poses: np.ndarray) -> List[str]:
    """Return a list with a sentence on the first jump of a run; it is empty if the robot does not jump.

    A robot jumps only if the submission has moved it against the rules. One jump is enough, because a single
    broken rule costs all points. `times` (N,) [s] and `poses` (N, 3) [m, m, rad] are true poses of base_link
    in the world.
    """
    if len(times) < 2:
        return []
    dx, dy = np.diff(poses[:, :2], axis=0).T
    steps = np.hypot(dx, dy)  # (N - 1,) [m] distances between consecutive poses
    jumps = np.flatnonzero(
        steps > JUMP_SLACK + MAX_ROBOT_SPEED * np.diff(times)
    )  # indices of too large steps
    if not len(jumps):
        return []
    first = jumps[0]
    return [f"the robot jumps {steps[first]:.2f} m at {times[first + 1]:.2f} s"]
