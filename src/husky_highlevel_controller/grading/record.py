"""A record of a marking that can be checked: what was marked, how, and a hash of where the robot drove.

In: recordings, a folder of a package. Out: `Record`s, as JSON and back; differences in sentences.
Must not know: ROS, how anything is started.
"""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.datatypes import HuskyError, Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.grading.drive.drive_end import ABANDONED, NODES_ENDED, DriveEnd
from husky_highlevel_controller.grading.drive.recording import Recording
from husky_highlevel_controller.grading.drive.truth_feed import TruthRow
from husky_highlevel_controller.grading.isolation.files import read_regular, walk

SCHEMA = "husky_highlevel_controller/record/v1"
LIBRARIES = ("numpy", "pybullet")  # that a drive depends on
SKIPPED = frozenset({".git", "build", "devel", "__pycache__"})


@dataclass(frozen=True)
class Record:
    """One marking of one submission."""

    name: str
    what: Tuple[str, ...]  # --launch PACKAGE FILE [ARGUMENTS] or --node PACKAGE TYPE [ARGUMENTS]
    setups: Tuple[str, ...]  # setup.bash files of its workspace
    packages: Tuple[str, ...]  # folders of packages that need no build
    settings: Dict[str, Any]  # exercise, husky, seed, trials, deadline, pace
    inputs: Dict[str, str]  # SHA-256 of each file of its package, by place in it
    versions: Dict[str, str]  # of Python and libraries
    drives: Tuple[str, ...]  # SHA-256 of the true poses of each drive
    points: Dict[str, Any]  # by item; None: for a person


def hash_of_poses(recording: Recording) -> str:
    """SHA-256 of stamps and true poses up to the moment at which the drive was decided.

    Recording goes on for some fractions of a second of wall time after that, which is never the same.
    """
    end, rows = DriveEnd(recording.pillar, recording.robot), len(recording.times)
    for row, (stamp, (x, y, yaw), (speed, yaw_rate)) in enumerate(
        zip(recording.times, recording.poses, recording.speeds)
    ):
        pose = Pose((float(x), float(y), 0.0), quat_from_rpy(0.0, 0.0, float(yaw)))
        end.update(TruthRow(float(stamp), pose, float(speed), float(yaw_rate)))
        if end.reason():
            rows = row + 1
            break
    else:
        if recording.ended == NODES_ENDED:
            rows = int(np.searchsorted(recording.times, end.moved_at + ABANDONED)) + 1
    table = np.column_stack([recording.times[:rows], recording.poses[:rows]])
    return hashlib.sha256(np.round(table, 4).astype("<f8").tobytes()).hexdigest()


def hashes_of_files(folder: Path) -> Dict[str, str]:
    """SHA-256 of each regular file below a folder."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(read_regular(path, 10**9)).hexdigest()
        for path in walk(folder, SKIPPED)
    }


def versions() -> Dict[str, str]:
    """Of Python and of the libraries that a drive depends on."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for library in LIBRARIES:
        try:
            found[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            found[library] = "unknown"
    return found


def to_json(record: Record) -> str:
    """Everything, as text."""
    return json.dumps({"schema": SCHEMA, **asdict(record)}, indent=2) + "\n"


def load_record(path: Path) -> Record:
    """A record from its file.

    Raises:
        HuskyError: there is none, or it is none.
    """
    try:
        content = json.loads(read_regular(path))
        if content.pop("schema") != SCHEMA:
            raise ValueError(f"its schema is not {SCHEMA}")
        lists: Dict[str, Any] = {
            name: tuple(content[name]) for name in ("what", "setups", "packages", "drives")
        }
        return Record(**{**content, **lists})
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise HuskyError(f"{path}: not a record: {error}") from error


def differences(before: Record, after: Record) -> List[str]:
    """What is not the same, in sentences; versions are named only beside something else."""
    found: List[str] = []
    for place in sorted(set(before.inputs) | set(after.inputs)):
        if before.inputs.get(place) != after.inputs.get(place):
            found.append(f"file {place} {_change(before.inputs, after.inputs, place)}")
    for number, (first, second) in enumerate(_pairs(before.drives, after.drives), 1):
        if first != second:
            found.append(f"drive {number} is another one")
    for item in before.points:
        if before.points[item] != after.points.get(item):
            found.append(f"{item}: {before.points[item]} points before, {after.points.get(item)} now")
    if found:
        found += [
            f"{name} was {version}, is {after.versions.get(name)}"
            for name, version in before.versions.items()
            if after.versions.get(name) != version
        ]
    return found


def _change(before: Dict[str, str], after: Dict[str, str], place: str) -> str:
    return "is new" if place not in before else "is gone" if place not in after else "has changed"


def _pairs(before: Sequence[str], after: Sequence[str]) -> List[Tuple[str, str]]:
    longest = max(len(before), len(after))
    return [
        (before[n] if n < len(before) else "", after[n] if n < len(after) else "") for n in range(longest)
    ]
