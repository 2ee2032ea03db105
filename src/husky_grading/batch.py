"""Marking of a class: which submissions must be marked, which results are kept, and the tables of the class.

The same command resumes an interrupted marking. Kept recordings are judged again if only rubric, points by
hand or penalties have changed.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os
import secrets
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from tqdm import tqdm

from husky_evaluation.tasks.fingerprint import code_version, fingerprint
from husky_evaluation.tasks.workers import Workers
from husky_grading.hand_in.class_folder import HandIn, find_hand_ins, is_package, left_out
from husky_grading.isolation import private_network
from husky_grading.isolation.files import (
    UnreadableFileError,
    read_text,
    remove_tree,
    walk,
    write_whole,
)
from husky_grading.isolation.process import StoppedError
from husky_grading.judge import judge_again, unmarked
from husky_grading.records import (
    Job,
    MarkingConfig,
    MarkingResult,
    Override,
    ResultState,
    Rules,
)
from husky_grading.reports.files import (
    FINGERPRINT,
    HAND_INS,
    JOB,
    RESULT,
    load_result,
    write_class,
    write_result,
)
from husky_grading.run_jobs import fingerprint_of_timeout, mark_jobs
from husky_grading.settings import FILE, PointsError, read_overrides
from husky_grading.submission import WORKSPACE
from husky_highlevel_controller.config import load, to_json
from husky_highlevel_controller.datatypes import HuskyError

DPKG = "/var/lib/dpkg/info"  # folder in which Debian keeps a file NAME.list for each installed package
SEED_FILE = "seed"  # name of the file that keeps the class's random seed, in the folder of results
# the seed of a class is below this limit; the simulator gets seed plus run number as a ROS parameter, which
# must fit into a 32-bit integer with a sign
SEED_LIMIT = 2**30


@dataclass(frozen=True)
class Batch:
    """A class: its submissions, and the folder of results."""

    folder: Path  # folder of submissions
    # folder of results: index.html, results.csv, junit.xml, and hand_ins/, which has a folder for each
    # submission
    out: Path
    jobs: int = 1  # number of submissions that are marked in parallel
    # if empty, all submissions without a valid result are marked; otherwise only the submissions with these
    # names, even if they have a result
    only: Tuple[str, ...] = ()
    setups: Tuple[str, ...] = ()  # setup.bash files that are sourced before submissions are built
    cluster: str = ""  # address of a Dask scheduler whose workers grade; if empty, this machine grades
    # [s] longest wall time for grading one submission; 0 means DEADLINE plus the time limits of its runs
    time_limit: float = 0.0


def mark_all(config: MarkingConfig, batch: Batch) -> List[MarkingResult]:
    """Mark every submission, and return the results; if marking fails, the result has only a `problem`.

    A submission is not marked again if its files and the settings are as at the last time. The results are
    written into the batch's folder, and a table is printed.

    Raises:
        HuskyError: there is no submission, marking.yaml is wrong, or marking was interrupted.
    """
    hand_ins = _find_submissions(batch)
    names = [each.name for each in hand_ins]
    overrides = _teachers_overrides(batch.folder, names)  # settings from marking.yaml, by student
    batch.out.mkdir(parents=True, exist_ok=True)
    # catkin ignores a folder with this file; otherwise, a catkin workspace around the folder would build the
    # submissions' packages
    (batch.out / "CATKIN_IGNORE").touch()
    # results that are already known, and jobs of the submissions that must be marked now
    results, waiting = _look_up_results(hand_ins, overrides, config, batch)
    number_in_parallel = batch.jobs
    # without a private network, two submissions could disturb each other's ROS nodes, so only one runs at a
    # time
    if number_in_parallel > 1 and not private_network.can_be_made():
        number_in_parallel = 1
        print("grading one submission at a time because network namespaces are unavailable", file=sys.stderr)
    try:
        with Workers(number_in_parallel, batch.cluster) as workers:
            new_results = mark_jobs(waiting, workers, elsewhere=bool(batch.cluster))
            for number, result in enumerate(new_results, 1):
                results[result.name] = result
                _report_progress(result, number, len(waiting))
    except (StoppedError, KeyboardInterrupt):
        raise HuskyError("stopped; run the same command again to continue") from None
    # a submission without a result has no row in the tables; with `--only`, the submissions that are not
    # named may have no result yet
    ordered = [results[name] for name in names if name in results]
    result_folders = {each.name: each.folder for each in hand_ins}  # names of the folders, by student
    write_class(ordered, result_folders, batch.out)
    _print_class(ordered, batch.out)
    return ordered


def _find_submissions(batch: Batch) -> List[HandIn]:
    """Return the submissions of a class, and print the names of the entries that are not submissions.

    Raises:
        HuskyError: there is no submission, or `batch.only` names an unknown one.
    """
    # the folder of results may lie in the folder of the class; it is not a submission, so it is left out
    hand_ins = [each for each in find_hand_ins(batch.folder) if each.path.resolve() != batch.out]
    names = [each.name for each in hand_ins]
    others = [name for name in left_out(batch.folder) if name != FILE]
    if others:
        rule = "each submission is a folder or an archive, and no link"
        print(f"not graded, because {rule}: {', '.join(others)}", file=sys.stderr)
    if not names:
        raise HuskyError(f"no submission in {batch.folder}; it needs folders, zip or tar archives")
    for name in batch.only:
        if name not in names:
            raise HuskyError(
                f"--only {name} is not a submission in {batch.folder}; there are: {', '.join(names)}"
            )
    return hand_ins


def _print_class(results: Sequence[MarkingResult], out: Path) -> None:
    """Print the points of each submission, the unfinished submissions, and the paths of the class's files."""
    for result in results:
        print(f"{result.name:<40}{_points_text(result)}")
    unfinished = [each.name for each in results if each.state is not ResultState.MARKED]
    if unfinished:
        print(f"\nnot completely graded, so not in moodle.csv: {', '.join(unfinished)}")
    print(f"\ntable: {out / 'results.csv'}\npage:  {out / 'index.html'}")


def _look_up_results(
    hand_ins: Sequence[HandIn], overrides: Mapping[str, Override], config: MarkingConfig, batch: Batch
) -> Tuple[Dict[str, MarkingResult], List[Job]]:
    """Return the results that need no run, by the student's name, and the jobs of all other submissions.

    If `batch.only` names submissions, only the named submissions have jobs. The workspace.json of each named
    submission is removed. The other submissions keep their results, but may have none.

    If a student has delivered two submissions, the student's folder of results is removed.

    Raises:
        PointsError: points in marking.yaml do not fit the rubric.
    """
    results: Dict[str, MarkingResult] = {}
    waiting: List[Job] = []
    # hash of the names of the installed packages; a submission that misses a package is marked again if this
    # hash has changed, because the package may be installed now
    installed = installed_packages(batch.setups)
    for hand_in in hand_ins:
        # a student without an entry in marking.yaml gets the default settings
        job = job_of(hand_in, overrides.get(hand_in.name, Override()), config, batch)
        job = replace(job, installed=installed)
        if hand_in.problem:
            # the student has two entries, and an earlier result belongs to only one of them, so it is removed
            remove_tree(Path(job.out))
            results[job.name] = unmarked(job, hand_in.problem)
            continue
        if job.name in batch.only:
            # the teacher wants a new result; without workspace.json, the submission is also built again
            Path(job.out, WORKSPACE).unlink(missing_ok=True)
            waiting.append(job)
            continue
        kept_result = _kept_result(job)
        if kept_result is not None:
            results[job.name] = kept_result
        elif not batch.only:
            waiting.append(job)
    return results, waiting


def _report_progress(result: MarkingResult, number: int, count: int) -> None:
    """Print a line on a new result, with its number of `count`; a terminal shows a progress bar instead.

    A submission that could not be marked has a line on a terminal, too.
    """
    if result.problem or not sys.stderr.isatty():
        why = f": {result.problem}" if result.problem else ""
        tqdm.write(f"{number} of {count}: {result.name}: {_points_text(result)}{why}", file=sys.stderr)
        sys.stderr.flush()


def _points_text(result: MarkingResult) -> str:
    """Return the points of a result as text, or that it could not be marked."""
    return "could not be marked" if result.problem else f"{result.points:g}/{result.max_points:g}"


def _teachers_overrides(folder: Path, names: Sequence[str]) -> Dict[str, Override]:
    """Return the settings for students from the marking.yaml in the folder of a class, by student.

    If the folder is itself a package, it is a student's submission. A marking.yaml in it is then ignored,
    because otherwise students could give themselves points.
    """
    if not is_package(folder):
        return read_overrides(folder, names)
    if (folder / FILE).exists():
        problem = f"{folder} is itself a package, so its {FILE} is the student's, and does not count"
        print(
            f"{problem}; put the package into a folder of your own, with {FILE} next to it", file=sys.stderr
        )
    return {}


def class_seed(out: Path) -> int:
    """Return the seed of a class, which is drawn once and kept in its folder of results.

    So the class has the same starts if it is marked again, and no student knows them.

    Raises:
        HuskyError: the file of the seed has no valid seed.
    """
    path = out / SEED_FILE
    if not path.exists():
        out.mkdir(parents=True, exist_ok=True)
        write_whole(path, f"{secrets.randbelow(SEED_LIMIT)}\n")
    text = read_text(path).strip()
    if not text.isdecimal() or int(text) >= SEED_LIMIT:
        raise HuskyError(f"{path}: {text[:80]!r} is not a valid seed. Remove the file to draw another one")
    return int(text)


def job_of(hand_in: HandIn, override: Override, config: MarkingConfig, batch: Batch) -> Job:
    """Return the job of a student, with hashes by which a later `grade` knows what it must do again.

    If the hash `made_of` changes, the submission is prepared again; it covers our code, the submitted files
    and everything that the build depends on. If `fingerprint` changes, the submission is marked again; it
    covers the settings of the runs, too. The rules of the rubric and points by hand are in neither hash,
    because the recordings can be judged again.
    """
    path = hand_in.path
    job = Job(
        hand_in.name, str(batch.out / HAND_INS / hand_in.folder), config, hand_in=str(path),
        override=override, setups=batch.setups,
        # the sandbox hides these folders, because they have the submissions and results of other students
        hidden=(str(batch.folder), str(batch.out)),
        time_limit=batch.time_limit,
    )  # fmt: skip
    # the student's settings that do not change the build get their defaults, so they are not in the hash
    settings_of_build = replace(override, robot=None, points={}, late=None, hold=False)
    # all submissions of a class must be marked by the same version of our code, so the version is in the hash
    built = [code_version(), config.exercise, to_json(settings_of_build), batch.setups]
    digest = hashlib.sha256(repr(built).encode())
    # errors are ignored here, because the marking program reports unreadable files and too many files later
    with contextlib.suppress(UnreadableFileError, OSError):
        delivered_files = walk(path) if path.is_dir() else [path]
        for file in delivered_files:
            # size and time of the last change stand for the content, because reading all files takes long
            status = file.stat()
            line = f"{file.relative_to(path)} {status.st_size} {status.st_mtime_ns}\n"
            digest.update(line.encode(errors="replace"))
    made_of = digest.hexdigest()
    # the settings of the runs are added to the same hash; the default rules replace the teacher's rules, so
    # other rules do not change the hash
    digest.update(to_json(replace(config, rules=Rules())).encode() + repr(override.robot).encode())
    return replace(job, made_of=made_of, fingerprint=digest.hexdigest())


def installed_packages(setups: Sequence[str]) -> str:
    """Return a hash of the names of the packages of Debian, ROS and Python on this machine.

    A submission that misses a package is marked again if this hash has changed. `setups` are the setup.bash
    files of catkin workspaces, whose packages count, too.
    """
    # folders of catkin workspaces, such as /opt/ros/noetic
    workspaces = os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep)
    workspaces += [os.path.dirname(setup) for setup in setups]
    # patterns of the paths that exist for each installed package
    patterns = [f"{DPKG}/*.list"]
    patterns += [f"{glob.escape(workspace)}/share/*" for workspace in workspaces]
    patterns += [f"{glob.escape(folder)}/*.dist-info" for folder in sys.path]
    paths: List[str] = []
    for pattern in patterns:
        paths += glob.glob(pattern)
    return fingerprint(sorted(paths))


def _kept_result(job: Job) -> Optional[MarkingResult]:
    """Return the earlier result of a job, judged again by the present rules; None if it must be marked again.

    Other files, settings or versions, or an unreadable result, make marking necessary.

    Raises:
        PointsError: points in marking.yaml do not fit the rubric.
    """
    out = Path(job.out)
    try:
        # each of these fingerprints means that the earlier result still holds
        valid_fingerprints = (
            job.fingerprint,
            # packages were missing, and this machine still has the same packages
            job.fingerprint + job.installed,
            # the submission was not graded in time, and the time limit is still the same
            fingerprint_of_timeout(job),
        )
        if (out / FINGERPRINT).read_text() not in valid_fingerprints:
            return None
        result = load_result(out / RESULT)
        judged = judge_again(job) if _must_judge_again(job) else result
    except PointsError:  # an error of the teacher, which marking again would not repair
        raise
    except Exception:
        # after any error the submission is marked again; if the error persists, the new result reports it
        return None
    try:
        # `judged` differs from `result` if the rubric or the points given by hand have changed
        if judged != result:
            write_result(judged, out)
        # the job is written again, because its paths change if the folder of the class is moved
        write_whole(out / JOB, to_json(job))
    except OSError:  # the result cannot be written, so the submission is marked again
        return None
    return judged


def _must_judge_again(job: Job) -> bool:
    """Return whether rules, points by hand or penalties have changed since the kept result of a job.

    Without workspace.json, the kept runs cannot be judged again. The kept result then stays.
    """
    out = Path(job.out)
    if not (out / WORKSPACE).exists():
        return False
    try:
        before = load(Job, out / JOB)
    except HuskyError:  # the earlier job cannot be read, so its rules are unknown
        return True
    # the config has the rules, and the override has the points by hand and the penalty; the name counts, too,
    # because the result shows it
    return (before.name, before.config, before.override) != (job.name, job.config, job.override)
