"""Plan of a submission: nodes that it would start, by its launch file; events of starting it."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

from husky_highlevel_controller.config import ConfigError, from_plain
from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, create, read_text
from husky_highlevel_controller.grading.isolation.process import Process, end_all, wait
from husky_highlevel_controller.grading.isolation.ros_network import Network
from husky_highlevel_controller.grading.isolation.sandbox import Workspace
from husky_highlevel_controller.grading.notes import Kind, Note
from husky_highlevel_controller.grading.records import Launchable
from husky_highlevel_controller.paths import share_folder

LOAD_DEADLINE = 120.0  # [s] of wall time for a launch file to be read
SIMULATOR_LAUNCH = share_folder() / "launch" / "simulator.launch"
COMPAT = share_folder() / "compat"  # its launch files start a simulator
SIMULATOR_NODES = ("/husky_simulator",)  # of that launch file; another node of this name would end ours
SUBMISSION_FOLDER = "submission"  # in the folder of a drive, the only one that the submission can write
_STARTER = str(Path(__file__).parents[2] / "ros" / "grading" / "submission.py")


@dataclass(frozen=True)
class Submission:
    """A launchable, and the workspace in which it runs."""

    launchable: Launchable
    workspace: Workspace = field(default_factory=Workspace)
    root: Optional[Path] = None  # folder of its built workspace; None: it was not built here
    package_path: Optional[Path] = None  # of the launchable's package, if it was built here
    problem: str = ""  # why nothing of it can be started: it does not build
    kept: Tuple[str, ...] = ()  # packages of the robot that it starts itself; then marking plays the bag


@dataclass(frozen=True)
class RvizNode:
    """An rviz node of a launch file."""

    name: str
    args: str
    remap: Tuple[Tuple[str, str], ...]


@dataclass(frozen=True)
class Event:
    """A line that submission.py wrote; but a submission can write anything into the file."""

    event: str
    node: str = ""
    exit_code: Optional[int] = field(default=None, metadata={"min": -255, "max": 255})
    error: str = ""
    prefix: str = ""
    package: str = ""
    tag: str = ""
    path: str = ""
    nodes: Tuple[str, ...] = ()  # package/type
    left_out: Tuple[str, ...] = ()  # package/type
    rviz: Tuple[RvizNode, ...] = ()
    players: Tuple[str, ...] = ()  # arguments of rosbag play


@dataclass(frozen=True)
class Plan:
    """Nodes that a submission would start."""

    nodes: Tuple[str, ...] = ()  # package/type
    left_out: Tuple[str, ...] = ()  # package/type, of simulators and drivers
    rviz: Tuple[RvizNode, ...] = ()
    package_path: Optional[Path] = None  # folder of its package
    notes: Tuple[Note, ...] = ()  # what is wrong with it
    players: Tuple[str, ...] = ()  # arguments of its rosbag players, which are left out


def with_filter(submission: Submission) -> Submission:
    """A submission that starts the filter itself, the stand-in where robot_localization is not installed."""
    workspace = submission.workspace
    roots = [Path(root) for root in workspace.env.get("ROS_PACKAGE_PATH", "").split(os.pathsep)]
    roots += [
        root for setup in workspace.setups for root in (setup.parent / "share", setup.parents[1] / "src")
    ]
    stand_ins = [path for path in COMPAT.iterdir() if not any((root / path.name).is_dir() for root in roots)]
    # the stand-in is a node of this package
    workspace = replace(workspace, packages=(*workspace.packages, *stand_ins), own_modules=True)
    return replace(submission, workspace=workspace, kept=("robot_localization",))


def starter(events: Path, action: str, submission: Submission) -> List[str]:
    """The command that reads its launch file, and with the action `run` starts it."""
    # by its path: a package of the submission may have this package's name
    code = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='__main__')"
    files = [file.name for file in COMPAT.glob("*/launch/*.launch")]
    ours = json.dumps([SIMULATOR_NODES, files, submission.kept])
    return [sys.executable, "-c", code, _STARTER, str(events), action, ours, *submission.launchable.words]


def start(network: Network, submission: Submission, action: str = "run") -> Tuple[Process, Path]:
    """Start it in a network; the program, and the file of its events."""
    events = network.folder_of(SUBMISSION_FOLDER) / "events.jsonl"
    create(events).close()
    return network.start(SUBMISSION_FOLDER, starter(events, action, submission), submission.workspace), events


def plan(submission: Submission, folder: Path) -> Plan:
    """Read its launch file, or look its node up, without starting anything."""
    folder.mkdir(parents=True, exist_ok=True)
    events_file = folder / "plan.jsonl"
    create(events_file).close()
    nowhere = "http://127.0.0.1:1"  # no master is needed to read a launch file
    env = {**submission.workspace.env, "ROS_MASTER_URI": nowhere, "PYTHONUNBUFFERED": "1"}
    env.update(ROS_LOG_DIR=str(folder / "log"), ROS_HOME=str(folder / "ros_home"), HOME=str(folder))
    env["DISPLAY"] = ":0"  # a launch file may start RViz only where there is a screen; nothing is started now
    command = starter(events_file, "describe", submission)
    process = Process(command, folder / "plan.log", env, folder, submission.workspace)
    try:
        in_time = wait(lambda: not process.running, LOAD_DEADLINE)
    finally:
        end_all([process])
    events = read_events(events_file)
    notes = notes_on(events, "")
    planned = next((event for event in events if event.event == "plan"), None)
    if planned is None and not notes:
        words = process.output.strip()[-300:] if in_time else f"no end after {LOAD_DEADLINE:g} s"
        notes = [Note(Kind.LAUNCH_FILE, f"the launch file cannot be read: {words}")]
    if planned is not None and not planned.nodes:
        notes.append(Note(Kind.LAUNCH_FILE, "it starts no node of its own"))
    package = submission.package_path
    if submission.root is None:
        package = package_path(events, submission.workspace)
    if planned is None:
        return Plan(package_path=package, notes=tuple(notes))
    return Plan(planned.nodes, planned.left_out, planned.rviz, package, tuple(notes), planned.players)


def package_path(events: Sequence[Event], workspace: Workspace) -> Optional[Path]:
    """Folder of the package, by the events; one outside of the workspace is the submission's invention."""
    roots = [Path(root) for root in workspace.env.get("ROS_PACKAGE_PATH", "").split(os.pathsep)]
    roots += [*workspace.packages, *(setup.parents[1] for setup in workspace.setups)]
    paths = [Path(os.path.normpath(event.path)) for event in events if event.event == "package"]
    return next((path for path in paths if {path, *path.parents} & {*roots}), None)


def read_events(path: Path) -> List[Event]:
    """The events that submission.py wrote down; lines that it did not write are left out."""
    events = []
    with contextlib.suppress(UnreadableFileError):
        for line in read_text(path).splitlines():
            with contextlib.suppress(ValueError, RecursionError, ConfigError):
                events.append(from_plain(Event, json.loads(line), ""))
    return events


EVENTS = [Kind.LAUNCH_FILE, Kind.MISSING_PACKAGE, Kind.LAUNCH_PREFIX]  # before a start, the worst first
_CALLBACK = re.compile(
    r"(?:\[ERROR\] \[[\d.]+(?:, (?P<at>[\d.]+))?\]: "
    r"bad callback: <(?:function|bound method) (?P<name>[\w.]{1,200})[^\n]{0,500}"
    r"|Exception in thread (?P<thread>[^\n]{0,200}):)\n"
    r"Traceback \(most recent call last\):\n(?P<lines>(?:[ \t][^\n]*\n)*)(?P<error>\w[^\n]*)"
)
_LINE = re.compile(r'File "[^"\n]*?([^/"\n]+)", line (\d+)')


def exceptions_in(output: str) -> List[Note]:
    """Exceptions in callbacks and threads, after which rospy goes on, from what was printed."""
    count: Dict[str, int] = {}
    first: Dict[str, Optional[float]] = {}
    for match in _CALLBACK.finditer(output):
        places = _LINE.findall(match["lines"])
        line = f" ({places[-1][0]}:{places[-1][1]})" if places else ""
        source = f"callback {match['name']}" if match["name"] else "a thread"
        words = f"{source} raises {match['error'][:200]}{line}"
        count[words] = count.get(words, 0) + 1
        first.setdefault(words, float(match["at"]) if match["at"] else None)
    notes = []
    for words, at in first.items():
        moment = "" if at is None else f", first at {at:.2f} s"
        notes.append(Note(Kind.EXCEPTION, f"{words}{moment}, {count[words]} times", at))
    return notes


def notes_on(events: Sequence[Event], output: str) -> List[Note]:
    """Notes on what went wrong, each once, from events and from what was printed."""
    notes = []
    for event in events:
        if event.event == "unloadable":
            notes.append(Note(Kind.LAUNCH_FILE, f"the launch file cannot be loaded: {event.error}"))
        elif event.event == "missing":
            words = f"package '{event.package}' is missing; the <{event.tag}> that needs it is left out"
            notes.append(Note(Kind.MISSING_PACKAGE, words))
        elif event.event == "prefix":
            words = f"launch-prefix '{event.prefix}' of node {event.node} is dropped"
            notes.append(Note(Kind.LAUNCH_PREFIX, words))
    notes.sort(key=lambda note: EVENTS.index(note.kind))
    for node in re.findall(r"ERROR: cannot launch node of type \[([^\]\n]{1,200})\]", output):
        words = f"node {node} cannot be started: no such package or program, or it is not executable"
        notes.append(Note(Kind.NOT_STARTED, words))
    notes += exceptions_in(output)
    errors = re.findall(r"^[^\w\n]*((?:\w+\.)*\w*(?:Error|Exception)\b.*)$", output, re.MULTILINE)
    for event in events:
        if event.event == "died":
            code = event.exit_code
            how = f"exit code {code}"
            if code is not None and code < 0:
                how = f"signal {-code}" + (f", {signal.Signals(-code).name}" if -code < 32 else "")
            lines = _LINE.findall(output)
            line = f" ({lines[-1][0]}:{lines[-1][1]})" if lines else ""
            why = f": {errors[-1][:200]}{line}" if errors and code else ""
            kind = Kind.NODE_ENDED if code == 0 else Kind.NODE_FAILED
            notes.append(Note(kind, f"node {event.node} ends during the drive ({how}){why}"))
    return list(dict.fromkeys(notes))
