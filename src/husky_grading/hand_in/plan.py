"""Plan of a launchable: the nodes that it would start, because roslaunch itself reads its launch file."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import List, Optional, Sequence

from husky_grading.hand_in.packages import NotMarkableError, read_manifest
from husky_grading.isolation.files import create
from husky_grading.isolation.own_files import VisibleCode
from husky_grading.isolation.process import Process, wait_and_kill
from husky_grading.isolation.sandbox import Workspace, clean_environment
from husky_grading.notes import Kind, Note
from husky_grading.records import Launchable
from husky_grading.submission import (
    COMPAT,
    NO_ROBOT_PACKAGES,
    Event,
    Plan,
    RobotPackages,
    notes_on,
    read_events,
    starter,
)
from husky_highlevel_controller.dependencies import dependency_sentence, unknown_dependencies

# folder of Debian's ROS packages, which is searched even if it is not in ROS_PACKAGE_PATH
DEBIAN = Path("/usr/share")
LOAD_DEADLINE = 120.0  # [s] longest wall time for reading launch files


def misspelt_dependencies(package: Path, workspace: Workspace) -> List[str]:
    """Return sentences for the student on names in package.xml that look like misspelt names of packages.

    A name that is not similar to any known package gets no sentence, because it may be the correct name of a
    package that is not installed here.
    """
    try:
        name, needs = read_manifest(package / "package.xml")
    except NotMarkableError:
        return []  # other checks report a package.xml that cannot be read
    # folders in which packages are searched: the workspace, our replacement packages, Debian's ROS packages,
    # and the folder that contains this package
    roots = {*_roots(workspace), COMPAT, DEBIAN, package.parent}
    known = set()  # names of packages
    for root in roots:
        for manifest in [*root.glob("package.xml"), *root.glob("*/package.xml")]:
            known.add(manifest.parent.name)  # the folder of a package has the name of the package
    return [
        dependency_sentence(finding)
        for finding in unknown_dependencies(name, sorted(needs), known)
        if finding.suggestion
    ]


def _roots(workspace: Workspace) -> List[Path]:
    """Return the folders in which ROS searches packages for a program that runs in this workspace."""
    roots = [Path(root) for root in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if root]
    for setup in workspace.setups:  # WORKSPACE/devel/setup.bash
        roots += [setup.parent / "share", setup.parents[1] / "src"]
    return [*roots, *workspace.packages]


def with_stand_ins(workspace: Workspace, visible_code: VisibleCode) -> Workspace:
    """Return a workspace in which launch files also find our replacements of missing robot packages.

    A replacement, such as our own package husky_gazebo, is found only if the robot's package of this name is
    not installed. `visible_code` says which files of our package the replacements use.
    """
    roots = _roots(workspace)
    stand_ins = []
    for path in COMPAT.iterdir():
        is_installed = any((root / path.name).is_dir() for root in roots)
        if not is_installed:
            stand_ins.append(path)
    return replace(workspace, packages=(*workspace.packages, *stand_ins), own=visible_code)


def plan(
    launchable: Launchable,
    workspace: Workspace,
    folder: Path,
    robot_packages: RobotPackages = NO_ROBOT_PACKAGES,
) -> Plan:
    """Return the nodes that one launch file or node would start; see `plans`."""
    (planned,) = plans([launchable], workspace, folder, robot_packages)
    return planned


def plans(
    launchables: Sequence[Launchable],
    workspace: Workspace,
    folder: Path,
    robot_packages: RobotPackages = NO_ROBOT_PACKAGES,
) -> List[Plan]:
    """Find out which nodes launch files or single nodes would start, but start nothing.

    Args:
        launchables: launch files or nodes.
        workspace: workspace in which they would be started.
        folder: folder for the events, which is made.
        robot_packages: packages of ROS whose nodes the submission or `grade` starts.

    Returns:
        A plan for each launchable, in the same order. Each plan tells whether roslaunch can load the launch
        file, and has notes on faults.
    """
    folder.mkdir(parents=True, exist_ok=True)
    events_file = folder / "plan.jsonl"
    create(events_file).close()  # an empty file replaces an earlier file, or a link of the submission
    # `problem` is used if the events in the file give no reason for a failure
    problem = _write_events(launchables, workspace, events_file, robot_packages)
    events = _events_by_launchable(read_events(events_file), len(launchables))
    return [_plan_by_events(own_events, workspace, problem) for own_events in events]


def _events_by_launchable(events: Sequence[Event], count: int) -> List[List[Event]]:
    """Return the events of each of `count` launchables; an event "launchable" begins the events of each one.

    A submission can write any events. So events before the first launchable, and events of launchables beyond
    `count`, are left out.
    """
    by_launchable: List[List[Event]] = [[] for _ in range(count)]
    number = -1  # number of the launchable to which the event belongs; -1 before the first one
    for event in events:
        if event.event == "launchable":
            number += 1
        if 0 <= number < count:
            by_launchable[number].append(event)
    return by_launchable


def _plan_by_events(events: Sequence[Event], workspace: Workspace, problem: str) -> Plan:
    """Return the plan of a launchable, with notes on its faults, by the events that were written for it.

    `problem` becomes the note if the events have no plan and give no reason for this.
    """
    # the event "plan" has the nodes; there is no such event if the launch file cannot be loaded
    read_plan = next((event.plan for event in events if event.plan), None)
    notes = notes_on(events, output="")
    if read_plan is None:
        notes = notes or [Note(Kind.LAUNCH_FILE, f"the launch file cannot be read: {problem}")]
    elif not read_plan.nodes:
        notes.append(Note(Kind.NO_NODE, "it starts no node of its own"))
    return replace(
        read_plan or Plan(),
        is_read=read_plan is not None,
        package_path=package_path(events, workspace),
        notes=tuple(notes),
    )


def _write_events(
    launchables: Sequence[Launchable], workspace: Workspace, events: Path, robot_packages: RobotPackages
) -> str:
    """Let nodes/submission.py read launchables, in the sandbox, and write what it finds to a file of events.

    The sandbox is needed because launch files can run commands.

    Returns:
        Reason why events may be missing: the end of the program's output, or that it did not end in time.
    """
    folder = events.parent
    # nobody listens at this address, because reading a launch file needs no ROS master
    nowhere = "http://127.0.0.1:1"
    env = {**clean_environment(), "ROS_MASTER_URI": nowhere, "PYTHONUNBUFFERED": "1"}
    env.update(ROS_LOG_DIR=str(folder / "log"), ROS_HOME=str(folder / "ros_home"), HOME=str(folder))
    # some launch files start RViz only if there is a display, so one is set; here no node is started
    env["DISPLAY"] = ":0"
    process = Process(
        starter(events, "describe", launchables, robot_packages, workspace.own),
        folder / "plan.log",
        env,
        folder,
        workspace,
    )
    in_time = wait_and_kill(process, LOAD_DEADLINE)
    return process.output.strip()[-300:] if in_time else f"it did not end within {LOAD_DEADLINE:g} s"


def package_path(events: Sequence[Event], workspace: Workspace) -> Optional[Path]:
    """Return the folder in which roslaunch has found the launchable's package, or None if there is none.

    The folder comes from an event "package". A submission can write any event, so a folder counts only if it
    is in a folder in which ROS searches packages: in one of the workspace, or of our own environment.
    """
    # an empty entry does not count, because its path would be ".", which contains every relative path
    roots = [Path(root) for root in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if root]
    roots += workspace.packages
    # a setup file is WORKSPACE/devel/setup.bash, and the packages are below WORKSPACE
    roots += [setup.parents[1] for setup in workspace.setups]
    for event in events:
        if event.event == "package":
            path = Path(os.path.normpath(event.path))
            if any(folder in roots for folder in (path, *path.parents)):
                return path
    return None
