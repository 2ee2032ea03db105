"""First stage of marking: delivered files, or a launchable of a sourced workspace, become a `Submission`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import List, Optional, Sequence, Set, Tuple

from husky_grading.displays import RvizConfig
from husky_grading.hand_in.build import Build, build, is_built
from husky_grading.hand_in.copies import Folders, copy_packages
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
    find_rviz_config,
    rviz_nodes_in,
)
from husky_grading.hand_in.packages import (
    BUILT,
    Contents,
    Fit,
    NotMarkableError,
    Package,
    choose_packages,
    copies_of_public,
    fit_of_path,
    open_hand_in,
    with_dependencies,
)
from husky_grading.hand_in.plan import misspelt_dependencies, plan, with_stand_ins
from husky_grading.isolation import private_network
from husky_grading.isolation.files import copy, file_suffix, remove_tree, walk, write_whole
from husky_grading.isolation.own_files import NAME, VisibleCode
from husky_grading.isolation.process import Process, wait_and_kill
from husky_grading.isolation.ros_network import START_DEADLINE, MarkingError
from husky_grading.isolation.sandbox import Workspace, clean_environment, kind_of_sandbox
from husky_grading.notes import Kind, Note
from husky_grading.records import Job, Launchable, Override
from husky_grading.submission import COPIES, WORKSPACE, Plan, Submission, starter
from husky_highlevel_controller.config import to_json

# files that this stage writes. WORKSPACE is removed first and written last, so it exists only if all other
# files are complete
FILES = (WORKSPACE, "plan", "build.log")
# folders that this stage makes for the files that a student has handed in
FOLDERS = ("ws", COPIES, "stand_ins", "unpacked")
# at most this number of copies of a package, or of launch files, is tried, until a node can be built
MAX_TRIED = 3
Choice = Tuple[List[Package], List[str]]  # packages that are graded, and notes on the others


def prepare(job: Job, facts: Facts) -> Submission:
    """Make a submission ready to be started, save it as workspace.json in the job's folder, and return it.

    Delivered files are unpacked and built. A launch file or node of a sourced workspace needs no build.

    Args:
        job: job with delivered files, or with a launchable of a sourced workspace.
        facts: functions and settings with which the exercise reads the submission.

    Raises:
        NotMarkableError: nothing in the submission can be started.
        MarkingError: no program can be started here.
    """
    out = Path(job.out)
    _remove_earlier_results(out, has_delivered_files=job.launchable is None)
    workspace = Workspace(
        setups=tuple(map(Path, job.setups)), packages=tuple(map(Path, job.packages)),
        hidden=tuple(map(Path, job.hidden)),
    )  # fmt: skip
    # Without this check, a fault of this machine would later look like a fault of the submission. The program
    # of the check may see as little of our own package as a normal submission.
    _check_sandbox_works(replace(workspace, own=VisibleCode.NOTHING), out / "plan")
    if job.launchable is None:
        submission, planned = prepare_hand_in(job, workspace, facts)
    else:
        submission, planned = _prepare_launchable(job, job.launchable, workspace, facts)
    submission = _with_findings(submission, planned, job, facts)
    write_whole(out / WORKSPACE, to_json(submission))
    return submission


def _with_findings(submission: Submission, planned: Plan, job: Job, facts: Facts) -> Submission:
    """Return a submission with what grading finds in its plan and files: nodes, robot, RViz file and notes.

    Args:
        submission: submission that is ready to be started, or has a problem.
        planned: nodes that it would start, and notes on its launch file or node.
        job: job of the submission.
        facts: functions and settings with which the exercise reads the submission.
    """
    rviz, sentences = _find_rviz(submission, planned)
    if planned.package_path:
        sentences += misspelt_dependencies(planned.package_path, submission.workspace)
    file_notes = [Note(Kind.HAND_IN, sentence) for sentence in sentences]
    problem = submission.problem
    if not problem and not planned.nodes:
        problem = planned.notes  # reasons why the submission starts no node
    return replace(
        submission,
        nodes=planned.nodes,
        problem=problem,
        notes=(*submission.notes, *file_notes, *planned.notes),
        rviz=rviz,
        robot=facts.find_robot(planned),
        sandbox=kind_of_sandbox(),
        network=private_network.reach(),  # says whether the network is kept apart from other networks
        parts=facts.robot_packages,
        facts=facts.read_facts(planned),  # facts that only this exercise needs
        made_of=job.made_of,  # hash by which a later marking knows that nothing has changed
    )


def _remove_earlier_results(out: Path, has_delivered_files: bool) -> None:
    """Delete what an earlier call has written into the job's folder `out`, and the recordings of its runs.

    Args:
        out: folder of the job.
        has_delivered_files: whether the job has delivered files. FOLDERS are made only for delivered files.
            If the job names a launch file or node instead, a folder with such a name, for example `ws`, is
            the teacher's and must stay.
    """
    names = (*FILES, *FOLDERS) if has_delivered_files else FILES
    for path in [*(out / name for name in names), *out.glob("drive_*")]:
        remove_tree(path)


def _find_rviz(submission: Submission, planned: Plan) -> Tuple[RvizConfig, List[str]]:
    """Return the RViz configuration that is graded, and sentences for the student on the other files.

    `planned` is what roslaunch would start for the submission.
    """
    # path of the launch file; empty for a node
    launch_file = submission.launchable.name if submission.launchable.kind == "launch" else ""
    # if roslaunch cannot load the launch file, the rviz nodes are taken from the text of the launch file
    if launch_file and not planned.is_read and planned.package_path:
        planned = replace(planned, rviz=rviz_nodes_in(Path(launch_file), planned.package_path))
    rviz = find_rviz_config(planned, submission.root, launch_file)
    # if no configuration of RViz is graded, the student learns which .rviz files belong to other launch files
    sentences = [] if rviz.source else files_of_others(planned, Path(launch_file).name)
    return rviz, sentences


def _prepare_launchable(
    job: Job, launchable: Launchable, workspace: Workspace, facts: Facts
) -> Tuple[Submission, Plan]:
    """Return submission and plan for a launch file or node of a sourced workspace, where nothing is built.

    Raises:
        NotMarkableError: there is no such package or launch file, so the command line of `grade` is wrong.
    """
    # If the teacher grades our own package, it may use all our files. But with a setup file, the package may
    # be a student's package of the same name.
    is_our_package = launchable.package == NAME and not job.setups
    workspace = replace(workspace, own=VisibleCode.ALL if is_our_package else VisibleCode.NOTHING)
    workspace = _with_robot_packages(facts, workspace)
    planned = plan(launchable, workspace, Path(job.out, "plan"), facts.robot_packages)
    # a launch file that roslaunch can load need not be in a package, because its path may be given
    if launchable.kind == "launch" and planned.is_read:
        return Submission(launchable, workspace), planned
    if not planned.package_path:
        raise NotMarkableError(
            f"there is no package '{launchable.package}'. Check the name, source its workspace, or give the "
            "workspace by --underlay SETUP.bash"
        )
    if launchable.kind == "launch":
        files = walk(planned.package_path.resolve())
        names = {path.name for path in files if file_suffix(path) == ".launch"}
        # a launch file that exists, but that roslaunch cannot load, is a fault of the submission
        if launchable.name not in names:
            raise NotMarkableError(
                f"there is no launch file '{launchable.name}' in the package '{launchable.package}'; it has "
                f"{', '.join(sorted(names)) or 'no launch files'}"
            )
    return Submission(launchable, workspace), planned


def _check_sandbox_works(workspace: Workspace, folder: Path) -> None:
    """Start the program that reads launch files, but without a launch file, to find faults of this machine.

    Raises:
        MarkingError: no program can be started here.
    """
    folder.mkdir(parents=True, exist_ok=True)
    command = starter(folder / "check.jsonl", "describe", [])
    env = {**clean_environment(), "ROS_LOG_DIR": str(folder), "HOME": str(folder)}
    process = Process(command, folder / "check.log", env, folder, workspace)
    has_ended = wait_and_kill(process, START_DEADLINE)
    if not has_ended or process.popen.returncode != 0:
        output = process.output.strip()[-300:] or "it printed nothing"
        setups = ""
        if workspace.setups:
            setups = f", or {', '.join(map(str, workspace.setups))} cannot be sourced"
        raise MarkingError(f"no program can be started in the sandbox{setups}: {output}")


def _with_robot_packages(facts: Facts, workspace: Workspace) -> Workspace:
    """Add our replacements of missing ROS packages to a workspace, if the exercise grades nodes of them.

    This is so in exercise 4: the student's launch file starts a node of robot_localization, which may not be
    installed on this machine.
    """
    return with_stand_ins(workspace, facts.visible_code) if facts.robot_packages.by_submission else workspace


def prepare_hand_in(job: Job, underlay: Workspace, facts: Facts) -> Tuple[Submission, Plan]:
    """Unpack the job's delivered files, choose packages and a launch file, build, and return the outcome.

    If several copies of a package were delivered, up to MAX_TRIED choices are tried. If none can be built,
    the first one that was prepared is returned with its problem. Files go into `unpacked/`, `ws/` and logs.

    Raises:
        NotMarkableError: nothing in the submission can be started.
    """
    out, path = Path(job.out), Path(job.hand_in)
    (out / "unpacked").mkdir(parents=True)
    contents = open_hand_in(path, out / "unpacked")
    # marking.yaml may give this student another exercise number, which counts more than the class's number
    exercise = job.override.exercise or job.config.exercise
    job = replace(job, override=replace(job.override, exercise=exercise))
    # the submission must see neither the other submissions nor their results
    underlay = replace(underlay, hidden=(*underlay.hidden, path.parent, out.parent), own=VisibleCode.NOTHING)
    choices = _choices(contents.packages, exercise)
    errors: List[NotMarkableError] = []  # reasons why choices have no launch file that can be started
    unbuilt_choices: List[Choice] = []  # choices with a launch file whose nodes cannot be built
    for choice in choices:
        try:
            submission, planned = _prepare_choice(contents, choice, job, underlay, facts)
        except NotMarkableError as error:
            errors.append(error)
            continue
        # a single choice is returned even with a problem, because there is nothing else to try
        if not submission.problem or len(choices) == 1:
            return submission, planned
        unbuilt_choices.append(choice)
    if not unbuilt_choices:
        raise errors[0]  # the first choice was the best one
    # No choice of packages can be built, so the first choice and its problem are the outcome. All choices use
    # the same workspace, so the first choice is prepared once more; otherwise the workspace would contain the
    # packages of the last choice.
    return _prepare_choice(contents, unbuilt_choices[0], job, underlay, facts)


def _choices(packages: Sequence[Package], exercise: int) -> List[Choice]:
    """Return at most MAX_TRIED different choices of packages, the best one first.

    There is more than one choice only if the submission has several copies of a package.
    """
    choices: List[Choice] = []
    for attempt in range(MAX_TRIED):
        choice = choose_packages(packages, exercise, attempt)
        # attempts beyond the number of copies give the same choice again
        if choice not in choices:
            choices.append(choice)
    return choices


def _prepare_choice(
    contents: Contents, choice: Choice, job: Job, underlay: Workspace, facts: Facts
) -> Tuple[Submission, Plan]:
    """Copy chosen packages into a workspace, choose the launch file, build, and return submission and plan.

    A submission that cannot be built has a `problem`.

    Raises:
        NotMarkableError: there is no package or no fitting launch file.
    """
    packages, choice_notes = choice
    override = job.override  # the teacher's settings for this student
    exercise = override.exercise or 0  # `prepare_hand_in` has set the number, so 0 never occurs
    notes = [*contents.notes, *choice_notes]
    if not packages:
        raise NotMarkableError("; ".join(["the submission has no catkin package", *notes]))
    folders, repair_notes = copy_packages(packages, Path(job.out, "ws"))
    # Launch files may need files that the student has added to a public package, such as husky_gazebo. So
    # launch files find a copy of this package, which is not built and whose repairs are not reported.
    public_packages = copies_of_public(contents.packages)
    public_folders, _ = copy_packages(public_packages, Path(job.out, COPIES))
    copied = [*packages, *public_packages]
    try:
        candidates = _candidates(contents, copied, folders, public_folders, underlay, job, facts)
    except NotMarkableError as error:
        raise NotMarkableError("; ".join([str(error), *notes])) from error
    if candidates and override.launch:
        notes.append(f"launch file {candidates[0].place}: named in marking.yaml")
    # `launch` is the launch file that is started: the first candidate with a node that could be built. It is
    # None if the teacher names a node, because then there are no candidates.
    launch, built = _build_candidates(candidates, packages, folders, underlay)
    notes += repair_notes
    launchable = _launchable_of(launch, override)
    # paths of the chosen launch file and of all that fit as well; empty if no other launch file fits as well
    equal_places: Tuple[str, ...] = ()
    if launch:
        if not override.launch:  # `grade` and not the teacher has chosen the launch file
            launch_notes, equal_places = _explain_choice(launch, candidates, exercise, facts)
            notes += launch_notes
        if add_rviz_files(contents, exercise, folders.packages[launch.package]):
            notes.append("RViz's configuration was found outside of the packages")
    # the submission is started with its built packages and the copies of public packages
    packages_seen = (*built.workspace.packages, *public_folders.packages.values())
    workspace = _with_robot_packages(facts, replace(built.workspace, packages=packages_seen))
    submission = Submission(
        launchable, workspace, folders.root, problem=_problem_of_build(launchable, launch, built, folders),
        notes=(*(Note(Kind.HAND_IN, text) for text in notes), *built.notes),
        own=tuple(package.name for package in packages), equals=equal_places,
    )  # fmt: skip
    if launch and launch.plan.is_read:
        planned = launch.plan
    else:
        # A node has no plan yet. A launch file that could not be read before the build may need files that
        # the build makes, so it is read again.
        planned = plan(launchable, workspace, Path(job.out, "plan"), facts.robot_packages)
    # roslaunch may have found the package at another path, but the student's files are in this copy
    return submission, replace(planned, package_path=folders.packages.get(launchable.package))


def _explain_choice(
    launch: LaunchFile, candidates: Sequence[LaunchFile], exercise: int, facts: Facts
) -> Tuple[List[str], Tuple[str, ...]]:
    """Return notes for the student on why a launch file was chosen, and the paths of equally good ones.

    The chosen launch file is not the best of the candidates if no node of the best one could be built.

    If other launch files fit as well, a note says how the teacher can grade one of them, and the paths are
    those of the chosen launch file and of the others. If no other launch file fits as well, there are no
    paths.
    """
    best, notes = candidates[0], []
    if launch is not best:
        notes.append(f"launch file {best.place} is not used: {', '.join(best.nodes)} is not built")
    notes.append(reasons(launch, candidates, exercise))
    other_places = equal_launch_files(launch, candidates, exercise, facts)
    if not other_places:
        return notes, ()
    lines = ", ".join(f"`launch: {place}`" for place in other_places)
    notes.append(f"other launch files fit as well; to grade one of them, write into marking.yaml: {lines}")
    return notes, (str(launch.place), *other_places)


def _problem_of_build(
    launchable: Launchable, launch: Optional[LaunchFile], built: Build, folders: Folders
) -> Tuple[Note, ...]:
    """Return the errors of the build if no node can be started because of them; empty if a node is built.

    If a node is built, errors in other parts of the build do not matter. If no node is built although the
    build has no errors, the node does not exist, and `prepare` adds this problem.

    Args:
        launchable: launch file or node that is started.
        launch: the launch file; None for a node.
        built: outcome of the build.
        folders: workspace of the submission.
    """
    if launch:
        is_node_built = _is_any_built(launch, folders)
    else:
        is_node_built = is_built(f"{launchable.package}/{launchable.name}", folders)
    return () if is_node_built else tuple(note for note in built.notes if note.kind is Kind.BUILD)


def _candidates(
    contents: Contents,
    packages: Sequence[Package],
    folders: Folders,
    public_folders: Folders,
    underlay: Workspace,
    job: Job,
    facts: Facts,
) -> List[LaunchFile]:
    """Return the launch files that may be started, the best one first; none if the teacher names a node.

    Args:
        contents: contents of the submission.
        packages: packages of which `folders` or `public_folders` has a copy.
        folders: copies of the packages that are graded.
        public_folders: copies of public packages to which the student has added files.
        underlay: workspace below the submission.
        job: job with the teacher's settings for this student.
        facts: functions and settings with which the exercise reads the submission.

    Raises:
        NotMarkableError: there is no fitting launch file.
    """
    override = job.override
    if override.node:  # a node that the teacher names is started without a launch file
        return []
    # before the build, launch files find the packages by their sources
    sources = (folders.root / "src", *public_folders.packages.values())
    unbuilt = replace(underlay, packages=(*underlay.packages, *sources))
    files = read_launch_files(
        contents, packages, folders, public_folders, _with_robot_packages(facts, unbuilt), override,
        facts.robot_packages,
    )  # fmt: skip
    if override.launch:  # only the launch file that the teacher names was read
        return files
    # `prepare_hand_in` has set the number of the exercise, so 0 never occurs
    return choose_launch_files(files, override.exercise or 0, facts)


def _launchable_of(launch: Optional[LaunchFile], override: Override) -> Launchable:
    """Return what is started: the launch file, or, if it is None, the node that the teacher names."""
    if launch is None:
        package, node = (override.node or "").split()  # `or ""` tells mypy that there is a node
        return Launchable("node", package, node, override.arguments)
    # the result shows the path that the student knows, and not the path of the copy on this machine
    title = " ".join([str(launch.place), *override.arguments])
    return Launchable("launch", launch.package, str(launch.path), override.arguments, title)


def _build_candidates(
    candidates: Sequence[LaunchFile], packages: Sequence[Package], folders: Folders, underlay: Workspace
) -> Tuple[Optional[LaunchFile], Build]:
    """Build the packages that the best launch file needs, and return the launch file and its build.

    If none of its nodes is built, the next best launch files are tried, but not more than MAX_TRIED in all.
    If all of them fail, the best one is returned. Without candidates, all packages are built, and the launch
    file is None.
    """
    by_name = {package.name: package for package in packages}

    def build_with_dependencies(names: Set[str]) -> Build:
        """Build these packages of the submission, and the packages of the submission that they need."""
        return build(folders, frozenset(with_dependencies(names, by_name)), underlay)

    if not candidates:
        return None, build_with_dependencies(set(by_name))
    best, *others = candidates[:MAX_TRIED]
    # names of the submission's packages to which the launch file refers; all packages if it refers to none
    needed = set(best.plan.uses) & set(by_name) or set(by_name)
    build_of_best = build_with_dependencies(needed)
    if _is_any_built(best, folders):
        return best, build_of_best
    for other in others:
        needed |= set(other.plan.uses) & set(by_name)
        larger_build = build_with_dependencies(needed)
        # `best` is checked again. Its node may need a package that no package.xml names, and this build may
        # have built that package.
        for launch in (best, other):
            if _is_any_built(launch, folders):
                return launch, larger_build
    # The student gets the errors of the build for the best launch file. A later build also has errors of
    # packages that only other launch files need.
    return best, build_of_best


def _is_any_built(launch: LaunchFile, folders: Folders) -> bool:
    """Return whether the build has made at least one of the launch file's nodes that can drive the robot.

    If no node of the launch file can drive, any node counts.
    """
    return any(is_built(node, folders) for node in launch.driving_nodes or launch.nodes)


def add_rviz_files(contents: Contents, exercise: int, package: Path) -> bool:
    """Copy .rviz files outside of all packages, such as ~/.rviz/default.rviz, into a package to be graded.

    Nothing is copied if the package has an .rviz file already. Files for another exercise are left out.

    Returns:
        Whether files were copied.
    """
    if any(path.suffix == ".rviz" for path in walk(package)):
        return False
    added = False
    # `folder` has files of the student, and `place` is its path inside the submission
    for folder, place in contents.places.items():
        # a student may hand in the folders of an own build (BUILT), which have copies of the packages' files
        for path in walk(folder, skipped=BUILT):
            is_in_package = any(other.path in path.parents for other in contents.packages)
            fit = fit_of_path(place / path.relative_to(folder).as_posix(), exercise)
            if path.suffix == ".rviz" and fit != Fit.OTHER_EXERCISE and not is_in_package:
                # The package was built before, and its build runs code of the student. This code may have
                # made a link with this name; `copy` replaces the link and does not follow it.
                copy(path, package / path.name)
                added = True
    return added
