"""Judging of a marked submission: its result by the recordings and the evidence that marking left."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Tuple

from husky_highlevel_controller.grading.displays import STANDING, FrameTree, RvizConfig, view_of
from husky_highlevel_controller.grading.exercises import EXERCISES
from husky_highlevel_controller.grading.notes import Note, texts
from husky_highlevel_controller.grading.recording import RECORDING, drive_number
from husky_highlevel_controller.grading.recording import load as load_recording
from husky_highlevel_controller.grading.records import (
    DEFAULT_RULES,
    Job,
    MarkingConfig,
    Result,
    load,
)
from husky_highlevel_controller.grading.rubrics.items import left_to_chance

EVIDENCE, FINGERPRINT = "evidence.json", "fingerprint"  # files: for judging; of files and settings


@dataclass(frozen=True)
class Evidence:
    """Findings of a marking beside the recordings of its drives."""

    what: str  # the launch file or node
    robot: str  # a key of ROBOT_VERSIONS
    sandbox: str
    network: str
    rviz: RvizConfig
    notes: Tuple[Note, ...]
    scans: str = ""  # topic of the scans, if it is another than the robot's
    uninitialised: str = ""  # a variable of it that is read before it is written, in a sentence


def judge_recordings(job: Job) -> Result:
    """The result by the recordings and the evidence in the job's folder, without points by hand or a penalty.

    Raises:
        HuskyError: there are none.
    """
    out = Path(job.out)
    evidence: Evidence = load(Evidence, out / EVIDENCE)
    paths = sorted(out.glob(f"drive_*/{RECORDING}"), key=lambda path: drive_number(path.parent))
    recordings = [load_recording(path, "") for path in paths]
    config = replace(job.config, robot=evidence.robot, scans=evidence.scans)
    tree = FrameTree(recordings[0].frames, recordings[0].descriptions) if recordings[0].frames else STANDING
    view = view_of(evidence.rviz, tree)
    items = EXERCISES[config.exercise].judge(recordings, view, config.scan_topic, config.rules)
    if evidence.uninitialised:
        items = left_to_chance(items, evidence.uninitialised)
    notes = [*evidence.notes, *(note for recording in recordings for note in recording.notes)]
    found = {"sandbox": evidence.sandbox, "network": evidence.network, "simulated": evidence.robot}
    settings = {**settings_of(job.config), **found}
    return Result(job.name, evidence.what, settings, tuple(items), tuple(texts(notes)))


def settings_of(config: MarkingConfig) -> Any:
    """The settings that a result shows."""
    settings = {key: value for key, value in vars(config).items() if key != "rules"}
    return {**settings, "rubric": None if config.rules == DEFAULT_RULES else str(config.rules)}
