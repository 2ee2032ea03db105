"""From a hand-in to a submission: unpacked, its packages and launch file chosen, built."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import List, Sequence, Tuple

from husky_highlevel_controller.grading.drive.plan import Submission
from husky_highlevel_controller.grading.hand_in.build import Folders, build, copy_packages, is_built
from husky_highlevel_controller.grading.hand_in.launch_choice import (
    LaunchFile,
    choose_launch_files,
    named_launch_file,
    reasons,
)
from husky_highlevel_controller.grading.hand_in.packages import (
    BUILT,
    Contents,
    HandIn,
    NotMarkableError,
    Package,
    choose_packages,
    copies_of_known,
    fits_exercise,
    open_hand_in,
    with_dependencies,
)
from husky_highlevel_controller.grading.isolation.files import copy, remove_tree, walk
from husky_highlevel_controller.grading.isolation.sandbox import Workspace
from husky_highlevel_controller.grading.records import Launchable, Override

MAX_TRIED = 3  # copies of a package, and launch files, the next one where no node of one is built
Choice = Tuple[List[Package], List[str]]  # packages, and notes


def prepare(
    path: Path, override: Override, exercise: int, underlay: Workspace, out: Path
) -> Tuple[Submission, List[str]]:
    """Unpack, choose and build a hand-in; the submission, and notes.

    Args:
        path: folder or archive of the hand-in.
        override: what a teacher set for it.
        exercise: the exercise's number.
        underlay: the workspace that it is built on.
        out: folder for `unpacked/` and `ws/`.

    Raises:
        NotMarkableError: there is nothing in it that could be started.
    """
    unpacked = out / "unpacked"
    remove_tree(unpacked)
    unpacked.mkdir()
    contents = open_hand_in(HandIn(out.name, path), unpacked)
    override = replace(override, exercise=override.exercise or exercise)
    underlay = replace(underlay, hidden=(*underlay.hidden, path.parent, out.parent))
    choices: List[Choice] = []
    for attempt in range(MAX_TRIED):
        choice = choose_packages(contents.packages, override.exercise or 0, attempt)
        choices += [choice] * (choice not in choices)
    problems: List[str] = []
    unbuilt: List[Choice] = []
    for choice in choices:
        try:
            submission, notes = _prepare_choice(contents, choice, override, underlay, out)
        except NotMarkableError as error:
            problems.append(str(error))
        else:
            if not submission.problem or len(choices) == 1:
                return submission, notes
            unbuilt.append(choice)
    if not unbuilt:
        raise NotMarkableError(problems[0])
    return _prepare_choice(contents, unbuilt[0], override, underlay, out)


def _prepare_choice(
    contents: Contents, choice: Choice, override: Override, underlay: Workspace, out: Path
) -> Tuple[Submission, List[str]]:
    """Choose a launch file of chosen packages, and build them."""
    exercise = override.exercise or 0
    packages, aside = choice
    if not packages:
        raise NotMarkableError("; ".join(["no catkin package in it", *contents.notes, *aside]))
    notes = [*contents.notes, *aside]
    by_name = {package.name: package for package in packages}
    candidates: List[LaunchFile] = []
    if override.launch:
        candidates = [named_launch_file(contents, packages, override.launch)]
        notes.append(f"launch file {candidates[0].place}, by marking.yaml")
    elif not override.node:
        try:
            candidates = choose_launch_files(contents, packages, exercise)
        except NotMarkableError as error:
            raise NotMarkableError("; ".join([str(error), *notes])) from error
    launch = candidates[0] if candidates else None
    needed = set(launch.uses if launch else ()) or set(by_name)
    folders, repairs = copy_packages(packages, out / "ws")
    notes += repairs
    built = build(folders, frozenset(with_dependencies(needed, by_name)), underlay)
    for other in candidates[1:MAX_TRIED]:
        if launch is None or _is_any_built(launch.nodes, folders):
            break
        needed |= set(other.uses)
        rebuilt = build(folders, frozenset(with_dependencies(needed, by_name)), underlay)
        if _is_any_built(other.nodes, folders):
            notes.append(f"launch file {launch.place} is passed over: {', '.join(launch.nodes)} is not built")
            launch, built = other, rebuilt
    copies, _ = copy_packages(copies_of_known(contents.packages), out / "copies")
    found = (*built.workspace.packages, *copies.packages.values())
    built = replace(built, workspace=replace(built.workspace, packages=found))
    if launch and not override.launch:
        notes.append(reasons(launch, candidates, exercise))
    if launch and add_rviz_files(contents, exercise, folders.packages[launch.package]):
        notes.append("RViz's configuration lies beside the packages")
    notes += built.notes
    if launch is None:
        package, node = (override.node or "").split()
        launchable = Launchable("node", package, node, override.arguments)
    else:
        package = launch.package
        file = launch_file_in(launch, by_name[package].path, folders.packages[package], folders.root)
        title = " ".join([str(launch.place), *override.arguments])
        launchable = Launchable("launch", package, str(file), override.arguments, title)
    nodes = launch.nodes if launch else (f"{package}/{node}",)
    problem = "" if _is_any_built(nodes, folders) else built.error
    package_path = folders.packages.get(package)
    return Submission(launchable, built.workspace, folders.root, package_path, problem), notes


def _is_any_built(nodes: Sequence[str], folders: Folders) -> bool:
    return any(is_built(node, folders) for node in nodes)


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
                copy(path, package / path.name)  # the build may have laid a link there
                added = True
    return added


def launch_file_in(launch: LaunchFile, package: Path, built: Path, workspace: Path) -> Path:
    """The launch file's copy in the workspace; one beside the packages is copied now."""
    if package in launch.path.parents:
        return built / launch.path.relative_to(package)
    target = workspace / "src" / launch.path.name
    copy(launch.path, target)
    return target
