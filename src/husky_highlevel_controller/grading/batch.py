"""Marks a folder of hand-ins: each is built and marked apart, and ends with a result of its own.

In: a folder, and how to mark one. Out: results, a CSV table and an HTML page.
Must not know: how one is judged.

An interrupted marking goes on where it was: what is marked already, with the same files and options, stays.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
import traceback
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Protocol, Sequence, Tuple

from tqdm import tqdm

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading.drive.run import Submission
from husky_highlevel_controller.grading.hand_in.build import build, copy_packages
from husky_highlevel_controller.grading.hand_in.launch_choice import (
    LaunchFile,
    choose_launch_file,
    named_launch_file,
)
from husky_highlevel_controller.grading.hand_in.overrides import Override, read_overrides
from husky_highlevel_controller.grading.hand_in.packages import (
    BUILT,
    Contents,
    HandIn,
    NotMarkableError,
    choose_packages,
    find_hand_ins,
    fits_exercise,
    open_hand_in,
    with_dependencies,
)
from husky_highlevel_controller.grading.isolation.files import walk, write_whole
from husky_highlevel_controller.grading.isolation.process import STOP_REQUESTED, StoppedError
from husky_highlevel_controller.grading.isolation.sandbox import Workspace
from husky_highlevel_controller.grading.reports.files import HAND_INS, write_class, write_result
from husky_highlevel_controller.grading.reports.tables import Result, from_json
from husky_highlevel_controller.tasks.workers import Workers

FINGERPRINT = "fingerprint"  # file: of what was marked


class Grader(Protocol):
    """Marks one submission."""

    @property
    def settings(self) -> Dict[str, object]:
        """What is the same for every submission."""

    @property
    def exercise(self) -> int:
        """Its number."""

    def mark(
        self, submission: Submission, name: str, out: Path, notes: Sequence[str] = (), husky: str = ""
    ) -> Result:
        """Mark it; drives, logs and pictures go into a folder."""


@dataclass(frozen=True)
class Batch:
    """What to mark, and where the results go."""

    folder: Path  # of hand-ins
    out: Path  # hand_ins/ with a folder for each, results.csv, junit.xml and index.html
    jobs: int = 1  # hand-ins at a time
    only: Tuple[str, ...] = ()  # hand-ins to mark again; empty: all that are not marked yet
    underlay: Workspace = field(default_factory=Workspace)  # what hand-ins are built on
    cluster: str = ""  # address of a Dask scheduler whose workers mark; empty: this machine

    def results_of(self, hand_in: HandIn) -> Path:
        """Folder of a hand-in's results; beside none of the class's files, whatever it is called."""
        return self.out / HAND_INS / hand_in.name


def mark_all(grader: Grader, batch: Batch) -> List[Result]:
    """Mark every hand-in; those that could not be marked have a `problem` and no items.

    Raises:
        HuskyError: there is none, marking.yaml is wrong, or marking was interrupted.
    """
    hand_ins = [each for each in find_hand_ins(batch.folder) if each.path.resolve() != batch.out]
    names = [hand_in.name for hand_in in hand_ins]
    if not hand_ins:
        raise HuskyError(f"no hand-in in {batch.folder}: no folder, zip or tar archive")
    for name in batch.only:
        if name not in names:
            raise HuskyError(f"--only {name}: not in {batch.folder}; there are: {', '.join(names)}")
    overrides = read_overrides(batch.folder, names)
    batch.out.mkdir(parents=True, exist_ok=True)
    results: Dict[str, Result] = {}
    waiting: List[Tuple[HandIn, Override]] = []
    for hand_in in hand_ins:
        override = overrides.get(hand_in.name, Override())
        earlier = _earlier(grader, hand_in, override, batch)
        if hand_in.name in batch.only or (earlier is None and not batch.only):
            waiting.append((hand_in, override))
        elif earlier is not None:
            results[hand_in.name] = earlier
    try:
        with Workers(batch.jobs, batch.cluster) as workers:
            for result in _marked_by(workers, grader, waiting, batch):
                results[result.name] = result
                if result.problem:
                    words = f"{result.name}: could not be marked: {result.problem}"
                    tqdm.write(words, file=sys.stderr)
    except (StoppedError, KeyboardInterrupt):
        raise HuskyError("stopped; the same command goes on from here") from None
    ordered = [results[name] for name in names if name in results]
    write_class(ordered, batch.out)
    for result in ordered:
        words = "could not be marked" if result.problem else f"{result.points:g}/{result.max_points:g}"
        print(f"{result.name:<40}{words}")
    print(f"\ntable: {batch.out / 'results.csv'}\npage:  {batch.out / 'index.html'}")
    return ordered


def _marked_by(
    workers: Workers, grader: Grader, waiting: Sequence[Tuple[HandIn, Override]], batch: Batch
) -> Iterator[Result]:
    """The result of each, in the order in which they come."""
    title = f"hand-ins ({len(waiting)} to mark)"
    if not batch.cluster:
        task = partial(_mark_pair, grader, batch)
        for _, result in workers.as_completed(task, list(waiting), title, starts_programs=True):
            yield result
        return
    from husky_highlevel_controller.grading import remote  # it starts markings, and so imports this module

    marks = [fingerprint(hand_in.path, override) for hand_in, override in waiting]
    orders = [remote.order_for(grader, hand_in, override, batch) for hand_in, override in waiting]
    answers = workers.as_completed(remote.mark_there, orders, title, starts_programs=True)
    for number, (result, files) in answers:
        out = batch.results_of(waiting[number][0])
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        remote.bring_in(files, marks[number], out)
        yield result


def _mark_pair(grader: Grader, batch: Batch, pair: Tuple[HandIn, Override]) -> Result:
    return mark_one(grader, *pair, batch)


def fingerprint(path: Path, override: Override) -> str:
    """A hash that changes whenever a file of the hand-in, or what is set for it, does."""
    digest = hashlib.sha256(repr(override).encode())
    for file in walk(path) if path.is_dir() else [path]:
        status = file.stat()
        digest.update(
            f"{file.relative_to(path)} {status.st_size} {status.st_mtime_ns}\n".encode(errors="replace")
        )
    return digest.hexdigest()


def _earlier(grader: Grader, hand_in: HandIn, override: Override, batch: Batch) -> Optional[Result]:
    """The result of an earlier marking of the same files with the same settings."""
    out = batch.results_of(hand_in)
    try:
        result = from_json((out / "result.json").read_text())
        same = (out / FINGERPRINT).read_text() == fingerprint(hand_in.path, override)
    except (OSError, HuskyError, ValueError):
        return None
    settings = dict(grader.settings)
    if batch.cluster:  # how the hand-in was kept apart is the worker's affair
        settings.update({name: result.settings.get(name) for name in ("sandbox", "network")})
    return result if same and result.settings == settings else None


def mark_one(grader: Grader, hand_in: HandIn, override: Override, batch: Batch) -> Result:
    """Its result, whatever it holds.

    Raises:
        StoppedError: marking is to end.
    """
    out = batch.results_of(hand_in)
    try:
        return _marked(grader, hand_in, override, batch, out)
    except StoppedError:
        raise
    except HuskyError as error:
        problem = str(error)
    except OSError as error:
        problem = f"{error.strerror or error}" + (f": {error.filename}" if error.filename else "")
    except Exception as error:
        problem = f"marking has failed: {type(error).__name__}: {' '.join(str(error).split())[:300]}"
        _write_traceback(out)
    return Result(hand_in.name, "", dict(grader.settings), (), (), problem)


def _write_traceback(out: Path) -> None:
    try:
        (out / "traceback.txt").write_text(traceback.format_exc())
    except OSError:
        print(traceback.format_exc(), file=sys.stderr)


def _marked(grader: Grader, hand_in: HandIn, override: Override, batch: Batch, out: Path) -> Result:
    if STOP_REQUESTED.is_set():
        raise StoppedError("the marking was stopped")
    out.mkdir(parents=True, exist_ok=True)
    for name in ("result.json", FINGERPRINT, "traceback.txt"):
        (out / name).unlink(missing_ok=True)
    mark = fingerprint(hand_in.path, override)
    submission, notes = prepare(hand_in, override, grader.exercise, batch, out)
    result = grader.mark(submission, hand_in.name, out, notes, override.robot)
    result = override.apply(result)
    write_result(result, out)
    write_whole(out / FINGERPRINT, mark)  # the last one: with it, it is done
    return result


def prepare(
    hand_in: HandIn, override: Override, exercise: int, batch: Batch, out: Path
) -> Tuple[Submission, List[str]]:
    """Unpack, choose and build a hand-in; what to start, and notes.

    Raises:
        NotMarkableError: there is nothing in it that could be started.
    """
    unpacked = out / "unpacked"
    shutil.rmtree(unpacked, ignore_errors=True)
    unpacked.mkdir()
    contents = open_hand_in(hand_in, unpacked)
    exercise = override.exercise or exercise
    packages, aside = choose_packages(contents.packages, exercise)
    if not packages:
        raise NotMarkableError("; ".join(["no catkin package in it", *contents.notes, *aside]))
    notes = [*contents.notes, *aside]
    by_name = {package.name: package for package in packages}
    launch: Optional[LaunchFile] = None
    if override.node:
        needed = set(by_name)
    else:
        if override.launch:
            launch = named_launch_file(contents, packages, override.launch)
            notes.append(f"launch file {launch.place}, by marking.yaml")
        else:
            launch, why = choose_launch_file(contents, packages, exercise)
            notes.append(why)
        needed = set(launch.uses) or set(by_name)
    folders, repairs = copy_packages(packages, out / "ws")
    if launch and add_rviz_files(contents, exercise, folders.packages[launch.package]):
        notes.append("RViz's configuration lies beside the packages")
    underlay = Workspace(
        batch.underlay.env, batch.underlay.setups, batch.underlay.packages,
        (*batch.underlay.hidden, batch.folder, batch.out),
    )  # fmt: skip
    built = build(folders, frozenset(with_dependencies(needed, by_name)), underlay)
    notes += [*repairs, *built.notes]
    if launch is None:
        return Submission(("--node", *override.node, *override.arguments), built.workspace), notes
    file = _launch_file_in(
        launch, by_name[launch.package].path, folders.packages[launch.package], folders.root
    )
    what = ("--launch", launch.package, str(file), *override.arguments)
    return Submission(what, built.workspace, " ".join([str(launch.place), *override.arguments])), notes


def add_rviz_files(contents: Contents, exercise: int, package: Path) -> bool:
    """Copy .rviz files beside the packages, such as ~/.rviz/default.rviz, into one that has none."""
    if any(path.suffix == ".rviz" for path in walk(package)):
        return False
    added = False
    for folder, place in contents.places.items():
        for path in walk(folder, BUILT):
            inside = any(other.path in path.parents for other in contents.packages)
            fits = fits_exercise(place / path.relative_to(folder).as_posix(), exercise)
            if path.suffix == ".rviz" and fits and not inside:
                shutil.copyfile(path, package / path.name)
                added = True
    return added


def _launch_file_in(launch: LaunchFile, package: Path, copy: Path, workspace: Path) -> Path:
    """The launch file's copy in the workspace; one beside the packages is copied now."""
    if package in launch.path.parents:
        return copy / launch.path.relative_to(package)
    target = workspace / "src" / launch.path.name
    shutil.copyfile(launch.path, target)
    return target
