"""Second stage of marking: a submission drives, and each run leaves a recording."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Callable, Sequence

from tqdm import tqdm

from husky_grading.drive.bring_up import BringUp
from husky_grading.drive.memcheck import find_unwritten_variable, is_worth_checking
from husky_grading.drive.robot_choice import RobotChoice, choose_robot
from husky_grading.drive.run import Driven, drive_submission, not_begun
from husky_grading.drive.trials import Trial
from husky_grading.isolation.files import remove_tree, write_whole
from husky_grading.notes import Kind, Note
from husky_grading.recording import RECORDING, recording_to_json
from husky_grading.records import MarkingConfig
from husky_grading.submission import Submission

# name of a run's folder while the run lasts; the submission can see this name, so it does not contain the
# number of the run
DRIVE = "drive"
BAR = "{desc}: {percentage:3.0f} %|{bar}| {n:.0f} of at most {total:.0f} s [{elapsed}<{remaining}]"


def observe(
    submission: Submission, trials: Sequence[Trial], config: MarkingConfig, bring_up: BringUp, out: Path
) -> None:
    """Let a submission drive, and write drive_N/recording.json of each run.

    Before the runs, a C++ program may be started once in valgrind, to find variables that it reads before it
    writes them. Runs after the first one follow only if the robot moves in the first one.

    The choice of the robot may be a guess. Then the right robot is the one whose scans the submission
    subscribes to. This shows in the check in valgrind, or otherwise in the first run. If the guess was wrong,
    the first run is repeated with the right robot.

    Raises:
        MarkingError: the network, the simulator or the recorder does not work.
    """
    for earlier in [*out.glob("drive_*"), out / DRIVE, out / "memcheck"]:
        remove_tree(earlier)
    robot = choose_robot(submission, config)
    if submission.problem:  # no node of the submission can be started
        _write_recording_without_run(submission, trials[0], robot, out)
        return
    # sentence for the student on a variable that is read before it is written; empty if there is none
    unwritten_variable = ""
    if is_worth_checking(submission):
        unwritten_variable, robot = find_unwritten_variable(submission, trials[0], robot, out / "memcheck")
    # `drive_submission` with the arguments that are the same in all runs
    drive = partial(
        drive_submission, submission, bring_up=bring_up, folder=out / DRIVE,
        unwritten_variable=unwritten_variable,
    )  # fmt: skip
    for trial in trials:
        title = f"drive {trial.number} of {len(trials)}"
        try:
            driven = _drive_right_robot(drive, trial, robot, title)
        finally:
            # the folder gets its name even after an error, because it has the logs of the run
            if (out / DRIVE).exists():
                (out / DRIVE).rename(out / f"drive_{trial.number}")
        if not driven.moved and trial is trials[0]:
            break  # the robot would not move in further runs either
        # the first recording has the reason for the choice of the robot, so the next recordings have none
        robot = driven.robot.settled()


def _drive_right_robot(drive: Callable[..., Driven], trial: Trial, robot: RobotChoice, title: str) -> Driven:
    """Let a submission drive once, and again with the right robot if the guess of the robot was wrong.

    Args:
        drive: function `drive_submission` with the arguments that are the same in all runs.
        trial: start and pillar of the run.
        robot: robot to simulate first.
        title: text of the progress bar.
    """
    # progress bar in simulated seconds, which is full at the deadline; the run may end earlier
    bar = tqdm(total=robot.config.deadline, desc=title, bar_format=BAR, disable=None, leave=False)
    with bar:
        show_time = partial(_show_time, bar)
        driven = drive(trial, robot=robot, on_time=show_time)
        # without a recording, the wrong robot was simulated; `driven.robot` is the right one
        if driven.recording is None:
            driven = drive(trial, robot=driven.robot, on_time=show_time)
    return driven


def _write_recording_without_run(submission: Submission, trial: Trial, robot: RobotChoice, out: Path) -> None:
    """Write a recording for a submission that cannot be started, with its problem as notes.

    So the judge can explain the lost points to the student, as after a run.
    """
    notes = [*submission.problem]
    if robot.why:
        notes.insert(0, Note(Kind.ROBOT, robot.why))
    folder = out / f"drive_{trial.number}"
    folder.mkdir(parents=True)
    # the facts of the submission's files, such as its plots, count even without a run
    recording = replace(not_begun(trial, robot.config), notes=tuple(notes), watched=submission.facts)
    write_whole(folder / RECORDING, recording_to_json(recording))


def _show_time(bar: Any, now: float) -> None:
    """Show a simulated time [s] in a progress bar of tqdm, whose `update` takes the step since `bar.n`."""
    bar.update(round(min(now, bar.total) - bar.n, 1))
