"""First stage of marking: delivered files, or a launchable of a sourced workspace, become a `Submission`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import List, Tuple

from husky_grading.hand_in.build import Folders, build, copy_packages, is_built
from husky_grading.hand_in.facts import Facts
from husky_grading.hand_in.launch_choice import (
    LaunchFile,
    choose_launch_files,
    equal_launch_files,
    read_launch_files,
    reasons,
)
from husky_grading.hand_in.package_files import (
    files_of_others,
    find_setup,
    rviz_nodes_in,
)
from husky_grading.hand_in.packages import (
    BUILT,
    Contents,
    NotMarkableError,
    Package,
    choose_packages,
    copies_of_known,
    fits_exercise,
    open_hand_in,
    with_dependencies,
)
from husky_grading.hand_in.plan import misspelt_dependencies, plan, with_stand_ins
from husky_grading.isolation import private_network
from husky_grading.isolation.files import copy, file_suffix, remove_tree, walk, write_whole
from husky_grading.isolation.own_files import NAME, Own
from husky_grading.isolation.process import Process, wait_and_kill
from husky_grading.isolation.ros_network import START_DEADLINE, MarkingError
from husky_grading.isolation.sandbox import Workspace, clean_environment, kind_of_sandbox
from husky_grading.notes import Kind, Note
from husky_grading.records import Job, Launchable
from husky_grading.submission import WORKSPACE, Plan, Submission, starter
from husky_highlevel_controller.config import to_json

# files of this stage; the first one is written last, so it is removed first
FILES = (WORKSPACE, "plan", "build.log")
FOLDERS = ("ws", "copies", "stand_ins", "unpacked")  # folders of this stage, for delivered files
MAX_TRIED = 3  # attempts with another copy of a package, or another launch file, if no node is built
Choice = Tuple[List[Package], List[str]]  # packages, and notes


def prepare(job: Job, facts: Facts) -> Submission:
    """Unpack, choose, read and build the job's submission, write workspace.json, and return it.

    Args:
        job: job with delivered files, or with a launchable of a sourced workspace.
        facts: facts that its exercise needs.

    Raises:
        NotMarkableError: nothing in the submission can be started.
        MarkingError: no program can be started here.
    """
    out = Path(job.out)
    names = FILES if job.launchable else (*FILES, *FOLDERS)  # otherwise a folder `ws` may be the teacher's
    for earlier in [*(out / name for name in names), *out.glob("drive_*")]:
        remove_tree(earlier)
    workspace = Workspace(
        setups=tuple(map(Path, job.setups)), packages=tuple(map(Path, job.packages)),
        hidden=tuple(map(Path, job.hidden)),
    )  # fmt: skip
    _check_starts(replace(workspace, own=Own.NOTHING), out / "plan")
    if job.launchable is None:
        submission, planned = prepare_hand_in(job, workspace, facts)
    else:
        is_ours = job.launchable.package == NAME and not job.setups
        workspace = replace(workspace, own=Own.ALL if is_ours else Own.NOTHING)
        workspace = _ready_for(workspace, facts)
        submission = Submission(job.launchable, workspace)
        planned = plan(job.launchable, workspace, out / "plan", facts.parts)
        _check_is_there(job.launchable, planned)
    launch_file = submission.launchable.name if submission.launchable.kind == "launch" else ""
    if launch_file and not planned.is_read and planned.package_path:
        planned = replace(planned, rviz=rviz_nodes_in(Path(launch_file), planned.package_path))
    rviz = find_setup(planned, submission.root, launch_file)
    others = [] if rviz.source else files_of_others(planned, Path(launch_file).name)
    if planned.package_path:
        others += misspelt_dependencies(planned.package_path, submission.workspace)
    submission = replace(
        submission,
        nodes=planned.nodes,
        problem=submission.problem or (() if planned.nodes else planned.notes),
        notes=(*submission.notes, *(Note(Kind.HAND_IN, each) for each in others), *planned.notes),
        rviz=rviz,
        robot=facts.robot(planned),
        sandbox=kind_of_sandbox(),
        network=private_network.reach(),
        parts=facts.parts,
        facts=facts.read(planned),
        made_of=job.made_of,
    )
    write_whole(out / WORKSPACE, to_json(submission))
    return submission


def _check_starts(workspace: Workspace, folder: Path) -> None:
    """Start the program that reads launch files without a launch file, to find faults of this machine.

    Raises:
        MarkingError: no program can be started here.
    """
    folder.mkdir(parents=True, exist_ok=True)
    command = starter(folder / "check.jsonl", "describe", [])
    env = {**clean_environment(), "ROS_LOG_DIR": str(folder), "HOME": str(folder)}
    process = Process(command, folder / "check.log", env, folder, workspace)
    if not wait_and_kill(process, START_DEADLINE) or process.popen.returncode:
        output = process.output.strip()[-300:] or "it printed nothing"
        setups = ""
        if workspace.setups:
            setups = f", or {', '.join(map(str, workspace.setups))} cannot be sourced"
        raise MarkingError(f"no program can be started in the sandbox{setups}: {output}")


def _check_is_there(launchable: Launchable, planned: Plan) -> None:
    """Check the names of the command line, because a wrong name is not a fault of the submission.

    Raises:
        NotMarkableError: there is no such package, or no such launch file in it.
    """
    is_read = launchable.kind == "launch" and planned.is_read  # a path may lead outside of any package
    if not planned.package_path and not is_read:
        raise NotMarkableError(
            f"there is no package '{launchable.package}'. Check the name, source its workspace, or give the "
            "workspace by --underlay SETUP.bash"
        )
    if launchable.kind == "launch" and not is_read:
        files = walk(planned.package_path.resolve()) if planned.package_path else ()
        names = {path.name for path in files if file_suffix(path) == ".launch"}
        if launchable.name not in names:
            raise NotMarkableError(
                f"there is no launch file '{launchable.name}' in the package '{launchable.package}'; it has "
                f"{', '.join(sorted(names)) or 'no launch files'}"
            )


def _ready_for(workspace: Workspace, facts: Facts) -> Workspace:
    """Return a workspace with stand-ins of the robot's packages if the submission starts their nodes."""
    return with_stand_ins(workspace, facts.own) if facts.parts.by_submission else workspace


def prepare_hand_in(job: Job, underlay: Workspace, facts: Facts) -> Tuple[Submission, Plan]:
    """Unpack the job's delivered files, choose packages and a launch file, and build them.

    If several copies of a package were delivered, up to MAX_TRIED choices are tried. If none can be built,
    the first one that was prepared is returned with its problem. Files go into `unpacked/`, `ws/` and logs.

    Raises:
        NotMarkableError: nothing in the submission can be started.
    """
    out, path = Path(job.out), Path(job.hand_in)
    (out / "unpacked").mkdir(parents=True)
    contents = open_hand_in(path, out / "unpacked")
    job = replace(job, override=replace(job.override, exercise=job.override.exercise or job.config.exercise))
    underlay = replace(underlay, hidden=(*underlay.hidden, path.parent, out.parent), own=Own.NOTHING)
    choices: List[Choice] = []
    for attempt in range(MAX_TRIED):
        choice = choose_packages(contents.packages, job.override.exercise or 0, attempt)
        if choice not in choices:
            choices.append(choice)
    problems: List[NotMarkableError] = []
    unbuilt: List[Choice] = []
    for choice in choices:
        try:
            submission, planned = _prepare_choice(contents, choice, job, underlay, facts)
        except NotMarkableError as error:
            problems.append(error)
        else:
            if not submission.problem or len(choices) == 1:
                return submission, planned
            unbuilt.append(choice)
    if not unbuilt:
        raise problems[0]
    return _prepare_choice(contents, unbuilt[0], job, underlay, facts)


def _prepare_choice(
    contents: Contents, choice: Choice, job: Job, underlay: Workspace, facts: Facts
) -> Tuple[Submission, Plan]:
    """Copy chosen packages into a workspace, choose the launch file, build, and return submission and plan.

    Only packages that the launch file needs are built. If none of its nodes is built, the next best launch
    files are tried, MAX_TRIED in all. A submission that cannot be built has a `problem`.

    Raises:
        NotMarkableError: there is no package or no fitting launch file.
    """
    packages, aside = choice
    out, override, exercise = Path(job.out), job.override, job.override.exercise or 0
    if not packages:
        raise NotMarkableError("; ".join(["the submission has no catkin package", *contents.notes, *aside]))
    notes = [*contents.notes, *aside]
    by_name = {package.name: package for package in packages}
    folders, repairs = copy_packages(packages, out / "ws")
    known = copies_of_known(contents.packages)
    copies, _ = copy_packages(known, out / "copies")
    unbuilt = replace(
        underlay, packages=(*underlay.packages, folders.root / "src", *copies.packages.values())
    )
    unbuilt = _ready_for(unbuilt, facts)
    candidates: List[LaunchFile] = []
    if not override.node:
        files = read_launch_files(
            contents, [*packages, *known], folders, copies, unbuilt, override, facts.parts
        )
        try:
            candidates = files if override.launch else choose_launch_files(files, exercise, facts)
        except NotMarkableError as error:
            raise NotMarkableError("; ".join([str(error), *notes])) from error
    launch = candidates[0] if candidates else None
    if launch and override.launch:
        notes.append(f"launch file {launch.place}: named in marking.yaml")
    notes += repairs
    needed = set(launch.plan.uses if launch else ()) & set(by_name) or set(by_name)
    built = build(folders, frozenset(with_dependencies(needed, by_name)), underlay)
    for other in candidates[1:MAX_TRIED]:
        if launch is None or _is_any_built(launch, folders):
            break
        needed |= set(other.plan.uses) & set(by_name)
        rebuilt = build(folders, frozenset(with_dependencies(needed, by_name)), underlay)
        if _is_any_built(other, folders):
            notes.append(f"launch file {launch.place} is not used: {', '.join(launch.nodes)} is not built")
            launch, built = other, rebuilt
    workspace = replace(built.workspace, packages=(*built.workspace.packages, *copies.packages.values()))
    workspace = _ready_for(workspace, facts)
    equals: List[str] = []
    if launch and not override.launch:
        notes.append(reasons(launch, candidates, exercise))
        equals = equal_launch_files(launch, candidates, exercise, facts)
    if launch and equals:
        lines = ", ".join(f"`launch: {place}`" for place in equals)
        notes.append(
            f"other launch files fit as well; to grade one of them, write into marking.yaml: {lines}"
        )
        equals.insert(0, str(launch.place))
    if launch and add_rviz_files(contents, exercise, folders.packages[launch.package]):
        notes.append("RViz's configuration was found outside of the packages")
    if launch is None:
        package, node = (override.node or "").split()
        launchable = Launchable("node", package, node, override.arguments)
    else:
        title = " ".join([str(launch.place), *override.arguments])
        launchable = Launchable("launch", launch.package, str(launch.path), override.arguments, title)
    planned = launch.plan if launch else Plan()
    if not planned.is_read:  # the launch file may need files of the build
        planned = plan(launchable, workspace, out / "plan", facts.parts)
    planned = replace(planned, package_path=folders.packages.get(launchable.package))
    node_is_built = is_built(f"{launchable.package}/{launchable.name}", folders)
    is_any_built = _is_any_built(launch, folders) if launch else node_is_built
    problem = () if is_any_built else tuple(note for note in built.notes if note.kind is Kind.BUILD)
    all_notes = (*(Note(Kind.HAND_IN, each) for each in notes), *built.notes)
    submission = Submission(
        launchable, workspace, folders.root, problem=problem, notes=all_notes, own=tuple(by_name),
        equals=tuple(equals),
    )  # fmt: skip
    return submission, planned


def _is_any_built(launch: LaunchFile, folders: Folders) -> bool:
    """Return whether a node that may drive the robot is built, or any node if none may."""
    return any(is_built(node, folders) for node in launch.able_nodes or launch.nodes)


def add_rviz_files(contents: Contents, exercise: int, package: Path) -> bool:
    """Copy .rviz files outside of the packages, such as ~/.rviz/default.rviz, into a package without any.

    Return whether there were such files.
    """
    if any(path.suffix == ".rviz" for path in walk(package)):
        return False
    added = False
    for folder, place in contents.places.items():
        for path in walk(folder, BUILT):
            inside = any(other.path in path.parents for other in contents.packages)
            fits = fits_exercise(place / path.relative_to(folder).as_posix(), exercise)
            if path.suffix == ".rviz" and fits and not inside:
                copy(path, package / path.name)  # follows no link that the build may have made
                added = True
    return added
