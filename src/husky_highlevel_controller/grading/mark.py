"""Marking of one submission: `python -m husky_highlevel_controller.grading.mark JOB.json` writes result.json.

Build and drives leave recordings and `evidence.json` in the job's folder; a result is judged from these
files alone, so that a changed rubric, points by hand or a penalty need no drive.
"""

from __future__ import annotations

import resource
import sys
import traceback
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, List, Optional, Tuple

from tqdm import tqdm

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading.drive.call_plan import BAG
from husky_highlevel_controller.grading.drive.memcheck import uninitialised
from husky_highlevel_controller.grading.drive.plan import Plan, Submission, plan, with_filter
from husky_highlevel_controller.grading.drive.robot_version import (
    SMB,
    OtherRobotError,
    guess_bag,
    guess_robot,
    listens_to,
)
from husky_highlevel_controller.grading.drive.run import drive
from husky_highlevel_controller.grading.drive.rviz_setup import files_of_others, find_setup
from husky_highlevel_controller.grading.drive.trials import Trial, draw_trials
from husky_highlevel_controller.grading.exercises import EXERCISES
from husky_highlevel_controller.grading.hand_in.multiplot import curves_in
from husky_highlevel_controller.grading.hand_in.packages import NotMarkableError
from husky_highlevel_controller.grading.hand_in.prepare import prepare
from husky_highlevel_controller.grading.isolation import private_network
from husky_highlevel_controller.grading.isolation.files import remove_tree, write_whole
from husky_highlevel_controller.grading.isolation.process import StoppedError, stop_on_signals
from husky_highlevel_controller.grading.isolation.sandbox import Workspace, kind_of_sandbox
from husky_highlevel_controller.grading.judge import (
    EVIDENCE,
    FINGERPRINT,
    Evidence,
    judge_recordings,
    settings_of,
)
from husky_highlevel_controller.grading.notes import Kind, Note
from husky_highlevel_controller.grading.recording import RECORDING, Playback, Recording, empty_recording
from husky_highlevel_controller.grading.recording import to_json as recording_to_json
from husky_highlevel_controller.grading.records import (
    AUTO,
    Job,
    MarkingConfig,
    Result,
    load,
    to_json,
)
from husky_highlevel_controller.grading.reports import plots
from husky_highlevel_controller.grading.reports.files import write_replay, write_result
from husky_highlevel_controller.grading.settings import with_override

PACKAGE = "husky_highlevel_controller"  # its own nodes may import it
# of this program and of each that it forks: bytes; descriptors, since every connection costs a thread
LIMITS = {resource.RLIMIT_DATA: 2_000_000_000, resource.RLIMIT_NOFILE: 1024}
OLD = (
    "drive_*", "plan", "rviz", "robot", "memcheck", "copies", "stand_ins", "build.log", EVIDENCE, FINGERPRINT,
    "result.json", "*.png",
)  # fmt: skip


def mark(job: Job) -> Result:
    """Mark a submission; its result, whatever it holds, and its files are in the job's folder.

    A result that this machine is to blame for, such as a full disk, has no fingerprint: it is not kept.

    Raises:
        StoppedError: marking is to end.
    """
    out = Path(job.out)
    problem, is_final = "", False
    try:
        out.mkdir(parents=True, exist_ok=True)
        for pattern in OLD:
            for path in out.glob(pattern):
                remove_tree(path)
        result = _gather(job, out)
        is_final = True  # a typo in marking.yaml needs no other drive
        result = with_override(result, job.override)
    except StoppedError:
        raise
    except NotMarkableError as error:
        problem, is_final = str(error), True
    except HuskyError as error:
        problem = str(error)
    except OSError as error:
        problem = f"{error.strerror or error}" + (f": {error.filename}" if error.filename else "")
    except Exception as error:
        problem = f"marking has failed: {type(error).__name__}: {' '.join(str(error).split())[:300]}"
        traceback.print_exc()
    if problem:
        result = Result(job.name, "", settings_of(job.config), (), (), problem)
    write_result(result, out)
    if is_final:
        write_whole(out / FINGERPRINT, job.fingerprint)  # the last one: with it, it is done
    return result


def _gather(job: Job, out: Path) -> Result:
    """Build and drive; recordings, evidence, pictures, and what they are worth."""
    submission, notes = _submission(job, out)
    is_bag = EXERCISES[job.config.exercise].driver == BAG
    submission = with_filter(submission) if is_bag else submission
    planned = plan(submission, out / "plan")
    starts = bool(planned.nodes) and not submission.problem
    config = replace(job.config, robot=job.override.robot or job.config.robot)
    is_guess, why = config.robot == AUTO, ""
    if is_guess:
        robot, why = (guess_bag if is_bag else guess_robot)(planned)
        config, is_guess = replace(config, robot=robot), robot != SMB and not is_bag
    try:
        recordings = _drives(submission, planned, replace(job, config=config), is_guess)
    except OtherRobotError as other:
        config = replace(config, robot=other.robot, scans=other.scans)
        recordings = _drives(submission, planned, replace(job, config=config), False)
    if is_guess and recordings[0].subscribed:
        why = listens_to(config)
    notes += [why] * bool(why)
    (trial, *_) = draw_trials(1, config.seed)
    checks = starts and not is_bag  # no code is handed in
    chance = uninitialised(submission, planned, trial, config, out / "memcheck") if checks else ""
    launchable = submission.launchable
    launch_file = launchable.name if launchable.kind == "launch" else ""
    rviz = find_setup(planned, submission.root, launch_file)
    if not rviz.source:
        notes += files_of_others(planned, Path(submission.launchable.name).name)
    network = "loopback only" if private_network.is_private() else "not kept apart"
    evidence = Evidence(
        submission.launchable.summary, config.robot, kind_of_sandbox(), network, rviz,
        (*(Note(Kind.HAND_IN, each) for each in notes), *planned.notes), config.scans, chance,
    )  # fmt: skip
    write_whole(out / EVIDENCE, to_json(evidence))
    result = judge_recordings(job)
    draw = plots.draw_playback if is_bag else plots.draw_drives
    (out / "drive.png").write_bytes(draw(recordings, job.name))
    if len(recordings[0].times) and not is_bag:
        middle = float(recordings[0].times[-1]) / 2.0
        (out / "moment.png").write_bytes(plots.draw_moment(recordings[0], middle))
    return result


def _submission(job: Job, out: Path) -> Tuple[Submission, List[str]]:
    workspace = Workspace(
        setups=tuple(map(Path, job.setups)), packages=tuple(map(Path, job.packages)),
        hidden=tuple(map(Path, job.hidden)),
    )  # fmt: skip
    if job.launchable is not None:
        is_ours = job.launchable.package == PACKAGE and not job.setups
        return Submission(job.launchable, replace(workspace, own_modules=is_ours)), []
    return prepare(Path(job.hand_in), job.override, job.config.exercise, workspace, out)


def _drives(submission: Submission, planned: Plan, job: Job, is_guess: bool) -> List[Recording]:
    """Recordings of the drives; further drives only where the first one moved.

    Raises:
        OtherRobotError: the job's robot is a guess, and the submission listens to another one's scans.
    """
    config, exercise = job.config, EXERCISES[job.config.exercise]
    for earlier in Path(job.out).glob("drive_*"):
        remove_tree(earlier)
    recordings: List[Recording] = []
    trials = draw_trials(config.trials if exercise.random_starts else 1, config.seed)
    for trial in trials:
        trial = replace(trial, driver=exercise.driver, ends_at_pillar=exercise.random_starts)
        folder = Path(job.out, f"drive_{trial.number}")
        if submission.problem or not planned.nodes:
            cause = (Note(Kind.BUILD, submission.problem),) if submission.problem else planned.notes
            recording = empty_recording(trial.pillar, config.deadline, cause)
            recording = replace(recording, robot=config.robot_name)
            folder.mkdir()
            write_whole(folder / RECORDING, recording_to_json(recording))
        else:
            with _bar(trial, len(trials), config) as bar:
                recording = drive(
                    submission, trial, config, folder, partial(_advance, bar), is_guess and not recordings
                )
        if exercise.driver == BAG:
            curves = curves_in(planned.package_path) if planned.package_path else ()
            playback = recording.playback or Playback()
            recording = replace(recording, playback=replace(playback, players=planned.players, curves=curves))
            write_whole(folder / RECORDING, recording_to_json(recording))
        write_replay(recording, f"{job.name}, drive {trial.number}", folder)
        recordings.append(recording)
        if not recording.moving.any():
            break
    return recordings


def _bar(trial: Trial, trials: int, config: MarkingConfig) -> Any:
    """Progress of a drive on a terminal, in simulated seconds up to its deadline; it may end earlier."""
    words = f"drive {trial.number} of {trials}"
    shape = "{desc}: {percentage:3.0f} %|{bar}| {n:.0f} of at most {total:.0f} s [{elapsed}<{remaining}]"
    return tqdm(total=config.deadline, desc=words, bar_format=shape, disable=None, leave=False)


def _advance(bar: Any, now: float) -> None:
    """Show a simulated time [s]."""
    bar.update(round(min(now, bar.total) - bar.n, 1))


def main(arguments: Optional[List[str]] = None) -> None:
    """Mark the job of the command line, in a network of its own, within limits of memory and descriptors."""
    private_network.enter()
    for limit, value in LIMITS.items():
        _, hard = resource.getrlimit(limit)
        resource.setrlimit(limit, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
    stop_on_signals()
    try:
        mark(load(Job, Path((arguments or sys.argv[1:])[0])))
    except StoppedError:
        raise SystemExit(2) from None  # as grade's


if __name__ == "__main__":
    main()
