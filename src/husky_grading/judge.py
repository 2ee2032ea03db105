"""Third stage of marking: the result, from the recordings of the runs and the prepared submission."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Match, Sequence

from husky_grading.displays import STANDING, FrameTree, view_of
from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.isolation.places import hide_places
from husky_grading.notes import Kind, Note, texts
from husky_grading.recording import Recording, recordings_in
from husky_grading.records import DEFAULT_RULES, Job, MarkingConfig, MarkingResult
from husky_grading.rubrics.items import left_to_chance, left_to_choice, left_to_other_machine, told_once
from husky_grading.settings import with_override
from husky_grading.submission import WORKSPACE, Submission
from husky_highlevel_controller.config import load

# pattern of the folders in an absolute path, without the file name; group 1 is the first folder
_FOLDERS = re.compile(r"(?<![\w.$)])/([\w.+@~-]+)/(?:[^\s/:'\"<>]+/)*")


def judge_again(job: Job) -> MarkingResult:
    """Return the result by the submission in workspace.json and the recordings in the job's folder.

    Raises:
        HuskyError: a file is missing or cannot be read, or the points by hand do not fit the rubric.
    """
    out = Path(job.out)
    return judge(load(Submission, out / WORKSPACE), recordings_in(out), job)


def judge(submission: Submission, recordings: Sequence[Recording], job: Job) -> MarkingResult:
    """Return the result of a submission by the rubric, with points by hand and a late penalty.

    Another run could give other points if several launch files fit equally well, if the submission needs
    Python 2, or if it reads a variable before it writes it. A person then grades the items that could change.

    Args:
        submission: prepared submission.
        recordings: recordings of its runs, at least one.
        job: settings of the teacher.

    Raises:
        PointsError: the points by hand do not fit the rubric.
    """
    # all runs start the same nodes with the same robot, so frames and topics are taken from the first run
    first = recordings[0]
    exercise = EXERCISES[job.config.exercise]
    view = view_of(submission.rviz, _frame_tree(first), first.marker_types)
    # if several items have the same hint, only the first of them shows it
    items = told_once(exercise.judge(recordings, view, first.scan_topic, job.config.rules))
    if submission.equals:  # several launch files fit the exercise equally well
        items = left_to_choice(items, submission.equals)
    if any(note.kind is Kind.PYTHON_2 for recording in recordings for note in recording.notes):
        items = left_to_other_machine(items)
    if first.uninitialised:  # the submission reads a variable before it writes it
        items = left_to_chance(items, first.uninitialised)
    notes = [*submission.notes, *(note for recording in recordings for note in recording.notes)]
    asked = exercise.number_of_runs(job.config.trials)  # number of runs that the teacher has asked for
    if len(recordings) < asked:
        text = f"{len(recordings)} of {asked} runs were made, because the robot did not move in the first one"
        notes.append(Note(Kind.FEWER_DRIVES, text))
    settings = {
        **settings_of(job.config),
        "sandbox": submission.sandbox,
        "network": submission.network,
        # name of the simulated robot, a key of ROBOT_VERSIONS; the setting "robot" may be "auto"
        "simulated": first.simulated,
    }
    result = MarkingResult(
        job.name, submission.launchable.summary, settings, tuple(items), tuple(texts(notes))
    )
    return with_override(_without_machine_paths(result, job), job.override)


def _frame_tree(recording: Recording) -> FrameTree:
    """Return the frames and robot descriptions of a run, also if it ended before simulated time began."""
    if recording.frames and len(recording.times):
        return FrameTree(recording.frames, recording.descriptions)
    # Odometry begins with the simulated time. A run that ended before this time has only the fixed frames of
    # the robot and of the submission, so the frames of a robot that stands still are added.
    descriptions = (*STANDING.descriptions, *recording.descriptions)
    return FrameTree({**STANDING.parents, **recording.frames}, descriptions)


def unmarked(job: Job, problem: str) -> MarkingResult:
    """Return the result of a submission that could not be marked."""
    result = _without_machine_paths(
        MarkingResult(job.name, "", settings_of(job.config), (), (), problem), job
    )

    def without_folders(match: Match[str]) -> str:
        """Return an empty text for the folders of a path on this machine, so only its file name is left.

        The name of a topic, such as /front/scan, looks like a path, too. It stays as it is, because this
        machine has no folder /front.
        """
        first_folder = match[1]
        return "" if os.path.isdir(f"/{first_folder}") else match.group()

    return replace(result, problem=_FOLDERS.sub(without_folders, result.problem))


def failure_text(error: Exception) -> str:
    """Return a sentence on an error of the grader itself."""
    return f"the grader failed: {type(error).__name__}: {' '.join(str(error).split())[:300]}"


def _without_machine_paths(result: MarkingResult, job: Job) -> MarkingResult:
    """Return the result without paths of this machine, because a student only knows the delivered paths."""
    # `hide_places` removes these folders from the beginnings of paths, so only the part that the student
    # knows stays
    folders = [Path(folder) for folder in (job.out, job.hand_in, *job.hidden, *job.packages) if folder]
    items = [
        replace(item, evidence=hide_places(item.evidence, folders), hint=hide_places(item.hint, folders))
        for item in result.items
    ]
    return replace(
        result,
        what=hide_places(result.what, folders),
        items=tuple(items),
        notes=tuple(hide_places(note, folders) for note in result.notes),
        problem=hide_places(result.problem, folders),
    )


def settings_of(config: MarkingConfig) -> Any:
    """Return the settings that a result shows: those of the config, with all rules as one text `rubric`."""
    settings = {key: value for key, value in vars(config).items() if key != "rules"}
    settings["rubric"] = None if config.rules == DEFAULT_RULES else str(config.rules)
    return settings
