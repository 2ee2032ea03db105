"""Records of markings that can be checked: files, settings, versions, and a hash of where the robot drove."""

from __future__ import annotations

import hashlib
import platform
from dataclasses import dataclass
from importlib import metadata
from itertools import zip_longest
from pathlib import Path
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading.drive.plan import Plan, Submission
from husky_highlevel_controller.grading.drive.recording import Recording
from husky_highlevel_controller.grading.isolation.files import read_regular, walk, write_whole
from husky_highlevel_controller.grading.records import Item, Job, Launchable, MarkingConfig, load, to_json

SCHEMA = "husky_highlevel_controller/record/v2"
LIBRARIES = ("numpy", "pybullet")  # that a drive depends on
SKIPPED = frozenset({".git", "build", "devel", "__pycache__"})


@dataclass(frozen=True)
class Record:
    """Record of one marking of one submission, which another machine can check."""

    schema: str
    name: str
    launchable: Launchable
    setups: Tuple[str, ...]  # setup.bash files of its workspace
    packages: Tuple[str, ...]  # folders of packages that need no build
    config: MarkingConfig
    inputs: Mapping[str, str]  # SHA-256 of each file of its package, by place in it
    versions: Mapping[str, str]  # of Python and libraries
    drives: Tuple[str, ...]  # SHA-256 of the true poses of each drive
    points: Mapping[str, Optional[float]]  # by item; None: for a person


def write_record(
    out: Path, job: Job, submission: Submission, planned: Plan, config: MarkingConfig,
    recordings: Sequence[Recording], items: Sequence[Item],
) -> None:  # fmt: skip
    """Write record.json into a folder of results."""
    workspace, folder = submission.workspace, planned.package_path
    record = Record(
        SCHEMA, job.name, submission.launchable,
        tuple(map(str, workspace.setups)), tuple(map(str, workspace.packages)), config,
        hashes_of_files(folder) if folder and folder.is_dir() else {}, versions(),
        tuple(map(hash_of_poses, recordings)), {item.name: item.points for item in items},
    )  # fmt: skip
    write_whole(out / "record.json", to_json(record))


def load_record(path: Path) -> Record:
    """A record from its file.

    Raises:
        HuskyError: there is none, or it is of another schema.
    """
    try:
        record: Record = load(Record, path)
    except ConfigError as error:
        raise HuskyError(f"not a record: {error}") from error
    if record.schema != SCHEMA:
        raise HuskyError(f"{path}: not a record: its schema is not {SCHEMA}")
    return record


def hash_of_poses(recording: Recording) -> str:
    """SHA-256 of stamps and true poses up to the moment at which the drive was decided.

    Recording goes on for some fractions of a second of wall time after that, which is never the same.
    """
    rows = int(np.searchsorted(recording.times, recording.decided_at - 1e-6)) + 1
    table = np.column_stack([recording.times[:rows], recording.poses[:rows]])
    return hashlib.sha256(np.round(table, 4).astype("<f8").tobytes()).hexdigest()


def hashes_of_files(folder: Path) -> Dict[str, str]:
    """SHA-256 of each regular file below a folder."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(read_regular(path, 10**9)).hexdigest()
        for path in walk(folder, SKIPPED)
    }


def versions() -> Dict[str, str]:
    """Versions of Python and of the libraries that a drive depends on."""
    libraries = {library: metadata.version(library) for library in LIBRARIES}
    return {"python": platform.python_version(), "machine": platform.machine(), **libraries}


def differences(before: Record, after: Record) -> List[str]:
    """Differences of two records, in sentences; versions are named only beside something else."""
    changes: List[str] = []
    for place in sorted(set(before.inputs) | set(after.inputs)):
        if before.inputs.get(place) != after.inputs.get(place):
            change = "is new" if place not in before.inputs else "has changed"
            changes.append(f"file {place} {change if place in after.inputs else 'is gone'}")
    for number, (first, second) in enumerate(zip_longest(before.drives, after.drives), 1):
        if first != second:
            changes.append(f"drive {number} differs")
    for item in before.points:
        if before.points[item] != after.points.get(item):
            changes.append(f"{item}: {before.points[item]} points before, {after.points.get(item)} now")
    if changes:
        changes += [
            f"{name} was {version}, is {after.versions.get(name)}"
            for name, version in before.versions.items()
            if after.versions.get(name) != version
        ]
    return changes
