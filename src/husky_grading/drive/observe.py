"""Second stage of marking: a submission drives; each drive leaves a recording."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Sequence

from tqdm import tqdm

from husky_grading.drive.bring_up import BringUp
from husky_grading.drive.memcheck import find_unwritten_variable, is_worth_checking
from husky_grading.drive.robot_choice import choose_robot
from husky_grading.drive.run import drive_submission, not_begun
from husky_grading.drive.trials import Trial
from husky_grading.isolation.files import remove_tree, write_whole
from husky_grading.notes import Kind, Note
from husky_grading.recording import RECORDING, recording_to_json
from husky_grading.records import MarkingConfig
from husky_grading.submission import Submission

DRIVE = "drive"  # folder of each drive while it lasts: a submission sees its path, and not which start it has


def observe(
    submission: Submission, trials: Sequence[Trial], config: MarkingConfig, bring_up: BringUp, out: Path
) -> None:
    """Let a submission drive, and write drive_N/recording.json; further ones only where the first one moved.

    It is started once for each drive, once more where its memory is checked, which tells its robot as well,
    and once more where the robot that its files name is not the one whose scans it subscribes to and the
    check, in which it may die, has not told that.

    Raises:
        MarkingError: our own part of it does not work.
    """
    for earlier in [*out.glob("drive_*"), out / DRIVE, out / "memcheck"]:
        remove_tree(earlier)
    robot = choose_robot(submission, config)
    if submission.problem:
        notes = [*submission.problem]
        if robot.why:
            notes.insert(0, Note(Kind.ROBOT, robot.why))
        folder = out / f"drive_{trials[0].number}"
        folder.mkdir(parents=True)
        nothing = replace(not_begun(trials[0], robot.config), notes=tuple(notes))
        write_whole(folder / RECORDING, recording_to_json(nothing))
        return
    chance = ""
    if is_worth_checking(submission):
        chance, robot = find_unwritten_variable(submission, trials[0], robot, out / "memcheck")
    for trial in trials:
        folder = out / DRIVE
        with _bar(trial, len(trials), robot.config) as bar:
            drive = partial(
                drive_submission, submission, trial, bring_up=bring_up, folder=folder, chance=chance,
                on_time=partial(_advance, bar),
            )  # fmt: skip
            try:
                driven = drive(robot=robot)
                if driven.recording is None:
                    driven = drive(robot=driven.robot)
            finally:
                if folder.exists():
                    folder.rename(out / f"drive_{trial.number}")
        if not driven.moved and trial is trials[0]:
            break
        robot = driven.robot.settled()


def _bar(trial: Trial, trials: int, config: MarkingConfig) -> Any:
    """Progress of a drive on a terminal, in simulated seconds up to its deadline; it may end earlier."""
    title = f"drive {trial.number} of {trials}"
    shape = "{desc}: {percentage:3.0f} %|{bar}| {n:.0f} of at most {total:.0f} s [{elapsed}<{remaining}]"
    return tqdm(total=config.deadline, desc=title, bar_format=shape, disable=None, leave=False)


def _advance(bar: Any, now: float) -> None:
    """Show a simulated time [s]."""
    bar.update(round(min(now, bar.total) - bar.n, 1))
