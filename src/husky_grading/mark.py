"""Marking of one submission: `python -m husky_grading.mark JOB.json`.

It has four stages. Each stage writes a file for the next one: prepare (workspace.json), observe
(drive_N/recording.json), judge (result.json) and report. A kept workspace is not built again. The judge needs
only files, so a new rubric, points by hand or a penalty need no run.
"""

from __future__ import annotations

import resource
import sys
import traceback
from dataclasses import replace
from pathlib import Path
from typing import List, NamedTuple, Optional, Sequence, Tuple

from husky_grading.drive.observe import observe
from husky_grading.drive.trials import draw_trials
from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.hand_in.packages import NotMarkableError
from husky_grading.hand_in.prepare import prepare
from husky_grading.isolation import place, private_network
from husky_grading.isolation.files import remove_tree, write_whole
from husky_grading.isolation.process import StoppedError, stop_on_signals
from husky_grading.isolation.sandbox import kind_of_sandbox
from husky_grading.judge import failure_text, judge, unmarked
from husky_grading.notes import MISSES_PACKAGES
from husky_grading.recording import Recording, recordings_in
from husky_grading.records import Job, MarkingResult, printable
from husky_grading.reports.files import (
    FINGERPRINT,
    PICTURES,
    RESULT,
    write_pictures,
    write_result,
)
from husky_grading.settings import PointsError
from husky_grading.submission import WORKSPACE, Submission
from husky_highlevel_controller.config import load
from husky_highlevel_controller.datatypes import HuskyError

# limits of this program and its forks: memory [bytes], and number of file descriptors. Descriptors are
# limited because each connection needs a descriptor and a thread.
LIMITS = {resource.RLIMIT_DATA: 2_000_000_000, resource.RLIMIT_NOFILE: 1024}


class _Outcome(NamedTuple):
    """Result of a submission, and what the next `grade` may keep of it."""

    result: MarkingResult
    # hash of everything that the runs depend on; empty if the next `grade` must mark the submission again
    fingerprint: str


def mark(job: Job) -> MarkingResult:
    """Mark a submission, write its files into the job's folder, and return its result, also after any error.

    The fingerprint in the folder decides what the next `grade` does. If it has the same fingerprint, it keeps
    the runs, and only judges them again if rules or points by hand have changed. After a fault of this
    machine, such as a full disk, or of this program, no fingerprint is written. The next `grade` then marks
    the submission again.

    Raises:
        StoppedError: marking was interrupted.
    """
    out = Path(job.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in (FINGERPRINT, RESULT, *PICTURES):
            remove_tree(out / name)
        outcome = _run_and_judge(job)
    except StoppedError:
        raise
    except NotMarkableError as error:
        # marking again would not help, because the fault is in the submission, such as a broken archive
        outcome = _failure(job, _text_of(error), fingerprint=job.fingerprint)
    except HuskyError as error:  # a fault of this machine
        outcome = _failure(job, _text_of(error), fingerprint="")
    except OSError as error:  # a fault of this machine
        problem = error.strerror or _text_of(error)
        if error.filename:
            problem += f": {error.filename}"
        outcome = _failure(job, problem, fingerprint="")
    except Exception as error:  # a fault in our own program
        traceback.print_exc()
        outcome = _failure(job, failure_text(error), fingerprint="")
    write_result(outcome.result, out, job.packages)
    if outcome.fingerprint:
        # the fingerprint is written last, because this file means that all other files are complete
        write_whole(out / FINGERPRINT, outcome.fingerprint)
    return outcome.result


def _run_and_judge(job: Job) -> _Outcome:
    """Let the submission of a job drive, judge its runs, and return the outcome."""
    submission, recordings = _prepare_and_observe(job)
    fingerprint = _fingerprint_of_runs(job, submission, recordings)
    try:
        return _Outcome(_judge_and_draw(submission, recordings, job), fingerprint)
    except PointsError as error:  # the teacher must correct the points by hand, but the runs are complete
        return _failure(job, _text_of(error), fingerprint=fingerprint)


def _failure(job: Job, problem: str, fingerprint: str) -> _Outcome:
    """Print why a submission could not be marked, and return the outcome without points.

    The terminal shows the teacher the full text. `unmarked` removes the paths of this machine, because the
    student reads the result.
    """
    print(printable(problem), file=sys.stderr)
    return _Outcome(unmarked(job, problem), fingerprint)


def _prepare_and_observe(job: Job) -> Tuple[Submission, List[Recording]]:
    """Prepare the submission of a job, unless it is kept, and let it drive; return it and its recordings."""
    exercise = EXERCISES[job.config.exercise]
    submission = kept_submission(job) or prepare(job, exercise.facts)
    # a robot in marking.yaml, for this student only, is used instead of the robot of the class
    config = replace(job.config, robot=job.override.robot or job.config.robot)
    trials = draw_trials(exercise.number_of_runs(config.trials), config.seed)
    observe(submission, trials, config, exercise.bring_up, Path(job.out))
    return submission, recordings_in(Path(job.out))


def _fingerprint_of_runs(job: Job, submission: Submission, recordings: Sequence[Recording]) -> str:
    """Return `job.fingerprint`; if packages are missing, with the hash of the packages on this machine.

    So the next `grade` marks the submission again if one of its missing packages may be installed by then.
    """
    notes = [*submission.notes, *(note for each in recordings for note in each.notes)]
    misses_packages = bool(MISSES_PACKAGES & {note.kind for note in notes})
    return job.fingerprint + (job.installed if misses_packages else "")


def _judge_and_draw(submission: Submission, recordings: Sequence[Recording], job: Job) -> MarkingResult:
    """Return the result, and write the pictures of the runs, also if `judge` rejects the teacher's points.

    Raises:
        PointsError: the points by hand do not fit the rubric.
    """
    cause = None  # first item that lost points; one picture shows the moment of this loss
    try:
        result = judge(submission, recordings, job)
        cause = result.cause
        return result
    finally:
        write_pictures(recordings, job.name, Path(job.out), cause)


def _text_of(error: Exception) -> str:
    """Return the text of an error, or its name, because an empty text would mean that there is no problem."""
    return str(error) or type(error).__name__


def kept_submission(job: Job) -> Optional[Submission]:
    """Return the submission that an earlier marking prepared here from the same files, or None.

    None is also returned if the submission must be prepared in another way now, for example in another
    sandbox.
    """
    try:
        submission = load(Submission, Path(job.out, WORKSPACE))
    except HuskyError:
        return None
    # `submission.root` differs from `root` if the folder of results was copied, or comes from another machine
    root = Path(job.out, "ws")
    is_here = submission.root == root and (root / "src").is_dir()
    # sandbox and network of the programs that prepared the submission, and those of this machine now
    isolation_before = (submission.sandbox, submission.network)
    has_same_isolation = isolation_before == (kind_of_sandbox(), private_network.reach())
    # true if the kept workspace hides every folder that this job wants to hide
    hides_all = {Path(folder) for folder in job.hidden} <= set(submission.workspace.hidden)
    # true if files, settings and our code are the same; a job without a hash is always prepared again
    is_same = bool(job.made_of) and submission.made_of == job.made_of
    # if packages were missing, the submission is prepared again, because they may be installed now
    misses_packages = MISSES_PACKAGES & {note.kind for note in submission.notes}
    is_usable = is_here and has_same_isolation and hides_all and is_same and not misses_packages
    return submission if is_usable else None


def main(arguments: Optional[List[str]] = None) -> None:
    """Mark the job of the command line, in a network of its own, within limits of memory and descriptors."""
    private_network.enter_network()
    for limit, value in LIMITS.items():
        # The soft limit becomes `value`, or the hard limit if the hard limit is lower. The hard limit stays,
        # because a program cannot raise it again.
        _, hard = resource.getrlimit(limit)
        soft = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(limit, (soft, hard))
    stop_on_signals()
    try:
        job = load(Job, Path((arguments or sys.argv[1:])[0]))
        try:
            # the folder of results is also shown at a neutral path, so no path of this machine is seen
            job = replace(job, out=str(place.show_results_at(Path(job.out))))
        except HuskyError as error:  # the path of the folder has characters that CMake does not accept
            write_result(unmarked(job, str(error)), Path(job.out))
        else:
            mark(job)
    except StoppedError:
        raise SystemExit(2) from None  # exit code of `grade` after an interruption


if __name__ == "__main__":
    main()
