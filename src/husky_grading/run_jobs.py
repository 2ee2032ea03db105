"""Runs of the marking program, which marks one submission, on this machine or on workers of a cluster."""

from __future__ import annotations

import contextlib
import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Dict, Iterator, Sequence, Tuple

from husky_evaluation.tasks.workers import Workers
from husky_grading.hand_in.archives import PackedPath
from husky_grading.isolation import private_network
from husky_grading.isolation.files import UnreadableFileError, read_regular, remove_tree, walk, write_whole
from husky_grading.isolation.process import Process, StoppedError, wait
from husky_grading.judge import failure_text, unmarked
from husky_grading.records import Job, MarkingResult
from husky_grading.reports.files import FINGERPRINT, JOB, RESULT, load_result, write_result
from husky_grading.submission import COPIES, SUBMISSION_FOLDER, WORKSPACE
from husky_highlevel_controller.config import to_json
from husky_highlevel_controller.datatypes import HuskyError

# [s] wall time; grading of one submission is stopped after this time plus the time limits of its runs
DEADLINE = 3600.0
PROGRAM = "husky_grading.mark"
# [s] after Ctrl-C, the marking program has this wall time to end all programs that it has started; then it is
# killed
CLEANUP_DEADLINE = 10.0
# [bytes] a worker of a cluster does not send back files of the result that are larger than this
MAX_RETURNED = 50_000_000
# folders that a worker of a cluster does not send back: the copied submission, its build, and files that the
# submission wrote
NOT_RETURNED = frozenset({"unpacked", "ws", COPIES, "stand_ins", SUBMISSION_FOLDER})
Files = Dict[str, bytes]  # content of each file, by the path of the file in the folder of results


def mark_jobs(jobs: Sequence[Job], workers: Workers, elsewhere: bool) -> Iterator[MarkingResult]:
    """Mark submissions by workers, with a progress bar, and yield each result as soon as it comes.

    Args:
        jobs: jobs of the submissions.
        workers: processes that do the jobs.
        elsewhere: true if the workers are on other machines.
    """
    title = f"submissions ({len(jobs)} to grade)"  # text of the progress bar
    if elsewhere:
        yield from _mark_elsewhere(jobs, workers, title)
        return
    # each worker calls `run_program` for one job; after an exception, `_failed` makes the result
    for _, result in workers.as_completed(
        run_program, list(jobs), title, starts_programs=True, on_error=_failed
    ):
        yield result


def _mark_elsewhere(jobs: Sequence[Job], workers: Workers, title: str) -> Iterator[MarkingResult]:
    """Mark submissions on other machines, and yield each result after its files were written here.

    A submission's files are sent to a worker, and the files of the result are sent back. `title` is the text
    of the progress bar.
    """

    def files_of_failed(packed: Tuple[Job, PackedPath], error: Exception) -> Files:
        """Return a result's files for a job that a worker could not do: only result.json, with the error."""
        job, _ = packed
        return {RESULT: to_json(_failed(job, error)).encode()}

    # a `PackedPath` reads a submission's files only when it is sent to a worker, so the files of all
    # submissions are never in memory at the same time
    packed = [(job, PackedPath(Path(job.hand_in))) for job in jobs]
    # each worker calls `run_there` for one job
    for index, files in workers.as_completed(
        run_there, packed, title, starts_programs=True, on_error=files_of_failed
    ):
        try:
            yield write_outputs(files, jobs[index])
        except Exception as error:  # an error such as a full disk of this machine
            yield _failed(jobs[index], error)


def _failed(job: Job, error: Exception) -> MarkingResult:
    """Return the result of a submission if marking itself failed; the next call marks it again.

    Raises:
        StoppedError: marking was interrupted.
    """
    if isinstance(error, StoppedError):
        raise error
    return unmarked(job, failure_text(error))


def run_program(job: Job, shows_errors: bool = False) -> MarkingResult:
    """Run the marking program for a job, and return the result, also if the program dies.

    The program is killed after the job's `time_limit`, or by default after DEADLINE and the time of its runs.
    With `shows_errors` its standard error goes to the terminal, for its progress bar, instead of mark.log.

    Raises:
        StoppedError: marking was interrupted.
    """
    out = Path(job.out)
    out.mkdir(parents=True, exist_ok=True)
    # an earlier result is removed, because it could be taken for the result of this run
    (out / RESULT).unlink(missing_ok=True)
    (out / FINGERPRINT).unlink(missing_ok=True)
    write_whole(out / JOB, to_json(job))
    # command that starts the marking program in a network of its own; environment variables for the program
    command, variables = private_network.inside([sys.executable, "-m", PROGRAM, str(out / JOB)])
    # the working directory is /, because `python -m` imports modules from it, and a student's folder may have
    # a yaml.py
    process = Process(
        command, out / "mark.log", {**os.environ, **variables}, folder=Path("/"), shows_errors=shows_errors
    )
    time_limit = _time_limit(job)
    try:
        in_time = wait(lambda: not process.running, time_limit)
    except StoppedError:
        process.interrupt()  # the marking program then ends the programs that it has started
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.popen.wait(CLEANUP_DEADLINE)
        raise
    finally:
        process.kill()
    with contextlib.suppress(HuskyError):  # raised if the program has left no result
        # after success, `mark` in the marking program has written the result, and its fingerprint if the
        # result may be kept
        return load_result(out / RESULT)
    if not in_time:
        return _result_of_timeout(job, time_limit)
    # Last 500 characters of the log. With `shows_errors` the log is empty, because the errors are on the
    # terminal, above this sentence.
    output = " ".join(process.output.split())[-500:] or "its errors are above"
    problem = f"the grader failed on {platform.node()} (exit code {process.popen.returncode}): {output}"
    # no fingerprint is written, so the next call marks the submission again
    result = unmarked(job, problem)
    write_result(result, out)
    return result


def _result_of_timeout(job: Job, time_limit: float) -> MarkingResult:
    """Write and return the result of a submission that was not graded within its time limit [s].

    The fingerprint lets the next call with this time limit keep the result, so that the class does not wait
    for this submission again. With workspace.json, the next call would judge the stored runs again if the
    rules have changed. These runs are incomplete, so workspace.json is removed.
    """
    out = Path(job.out)
    (out / WORKSPACE).unlink(missing_ok=True)
    result = unmarked(job, f"it was not graded within {time_limit:g} s; --time-limit sets this limit")
    write_result(result, out)
    write_whole(out / FINGERPRINT, fingerprint_of_timeout(job))
    return result


def _time_limit(job: Job) -> float:
    """Return the longest wall time for grading a submission [s]."""
    return job.time_limit or DEADLINE + job.config.trials * job.config.wall_limit


def fingerprint_of_timeout(job: Job) -> str:
    """Return the fingerprint of a submission that was not graded in time; it contains the time limit."""
    return f"{job.fingerprint} within {_time_limit(job):g} s"


def run_there(packed: Tuple[Job, PackedPath]) -> Files:
    """Run the marking program on this machine, a worker, and return the files of the result by their paths.

    `packed` is the job, with paths of the machine that sent it, and the submission's files.
    """
    job, content = packed
    with tempfile.TemporaryDirectory(prefix="husky_grade_") as place:
        folder = Path(place)
        (folder / "hand_ins").mkdir()
        path = content.unpack(folder / "hand_ins")
        out = folder / "out" / Path(job.out).name
        # Paths on this machine replace the paths in the job. The submission must not see its result, so the
        # sandbox hides `folder`. The sandbox shows only two folders inside it: the submission's workspace and
        # the folder of its run.
        run_program(replace(job, hand_in=str(path), out=str(out), hidden=(str(folder),)))
        files: Files = {}
        for file in walk(out, skipped=NOT_RETURNED):
            with contextlib.suppress(UnreadableFileError):  # a file that is too large is left out
                files[file.relative_to(out).as_posix()] = read_regular(file, MAX_RETURNED)
        return files


def write_outputs(files: Files, job: Job) -> MarkingResult:
    """Write the files that a worker sent back into the job's folder of results, and return the result.

    The fingerprint is written last, because it means that all other files are complete.

    Raises:
        HuskyError: there is no result among the files.
    """
    out = Path(job.out)
    remove_tree(out)
    # False is sorted before True, so the fingerprint is the last path
    paths = sorted(files, key=lambda path_in_out: path_in_out == FINGERPRINT)
    for path_in_out in paths:
        path = out / path_in_out
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(files[path_in_out])
    # the worker's job has paths of the worker's machine, so the job of this machine replaces it
    write_whole(out / JOB, to_json(job))
    return load_result(out / RESULT)
