"""Submission that is ready to be started, as `workspace.json`, and the program that starts it.

That program reads the launch file as roslaunch would, in the sandbox, and writes events to a file, one per
line. A submission can also write anything into that file.
"""

from __future__ import annotations

import contextlib
import json
import re
import signal
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Collection, Dict, List, Mapping, Optional, Sequence, Tuple

from husky_grading.displays import RvizConfig
from husky_grading.isolation.files import UnreadableFileError, read_text
from husky_grading.isolation.own_files import STARTER, Own, programs
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind, Note
from husky_grading.records import Launchable
from husky_highlevel_controller.config import ConfigError, from_plain, number
from husky_highlevel_controller.paths import share_folder

WORKSPACE = "workspace.json"
SUBMISSION_FOLDER = "submission"  # folder in the folder of a run; the submission can write no other folder
OWN_RVIZ = ("husky_rviz", "gazebo_gui")  # RViz nodes of this package's launch files
SIMULATOR_NODES = ("/husky_simulator",)  # a second node of this name would end our node
COMPAT = share_folder() / "compat"  # folder of packages with launch files that start our simulator
MAX_EVENTS = 10_000  # events of one run that are read, because a submission can write any number


@dataclass(frozen=True)
class Parts:
    """Packages of the robot: nodes of some are started by the submission, nodes of others by marking."""

    by_submission: Tuple[str, ...] = ()  # packages whose nodes count as the submission's, instead of its own
    by_marking: Tuple[str, ...] = ()  # packages whose nodes are left out


STUDENTS_OWN = Parts()  # the submission starts nodes that its student wrote


@dataclass(frozen=True)
class NamedRobot:
    """Robot that a submission's files name."""

    version: str = ""  # a key of ROBOT_VERSIONS
    why: str = ""  # a sentence
    is_certain: bool = False  # otherwise the topic to which the submission subscribes decides


@dataclass(frozen=True)
class Submission:
    """Launchable, the workspace in which it runs, and facts from its files."""

    launchable: Launchable
    workspace: Workspace = field(default_factory=Workspace)
    root: Optional[Path] = None  # folder of its built workspace; None if it was not built here
    nodes: Tuple[str, ...] = ()  # package/type of the nodes that it would start
    problem: Tuple[Note, ...] = ()  # reasons why nothing of it can be started
    notes: Tuple[Note, ...] = ()
    rviz: RvizConfig = field(default_factory=RvizConfig)
    robot: NamedRobot = field(default_factory=NamedRobot)
    sandbox: str = ""  # kind of sandbox
    network: str = ""
    own: Tuple[str, ...] = ()  # packages that were delivered; empty if unknown
    equals: Tuple[str, ...] = ()  # launch file, and others that fit as well and start something else
    parts: Parts = field(default_factory=Parts)
    facts: Mapping[str, Any] = field(default_factory=dict)  # facts for its exercise, by name
    made_of: str = ""  # fingerprint of the files and settings that it was prepared from


@dataclass(frozen=True)
class RvizNode:
    """An rviz node of a launch file."""

    name: str
    args: str
    remap: Tuple[Tuple[str, str], ...]


@dataclass(frozen=True)
class Plan:
    """Nodes that a launchable would start."""

    nodes: Tuple[str, ...] = ()  # package/type
    left_out: Tuple[str, ...] = ()  # package/type of nodes of simulators and drivers
    rviz: Tuple[RvizNode, ...] = ()
    uses: Tuple[str, ...] = ()  # packages that the launchable names
    pillar: bool = False  # the launch file names the course's world
    left_out_arguments: Tuple[Tuple[str, str], ...] = ()  # package/type and arguments of nodes left out
    digest: str = ""  # hash of the nodes with their arguments and parameters
    # fields that the program does not write
    is_read: bool = False  # the launch file can be loaded
    package_path: Optional[Path] = None  # folder of the package of the launchable
    notes: Tuple[Note, ...] = ()  # findings on the launchable


@dataclass(frozen=True)
class Event:
    """Line that the program wrote."""

    event: str
    node: str = ""
    exit_code: Optional[int] = number(-255, 255, "exit code of a node", None)
    error: str = ""
    prefix: str = ""
    package: str = ""
    tag: str = ""
    path: str = ""
    plan: Optional[Plan] = None


def starter(
    events: Path,
    action: str,
    launchables: Sequence[Launchable],
    parts: Parts = STUDENTS_OWN,
    own: Own = Own.NOTHING,
) -> List[str]:
    """Return the command that reads launch files (`describe`), or starts a single one (`run`, `memcheck`).

    Unless `own` is ALL, nodes of this package are left out, because they are not part of any submission.
    """
    # the program has a path, because a package of the submission may have this package's name
    code = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='__main__')"
    files = [f"launch/{file.name}" for file in COMPAT.glob("*/launch/*.launch")]
    manifest = (share_folder() / "package.xml").resolve()
    own_places = [] if own is Own.ALL else [str(manifest), *map(str, programs())]
    ours = {
        "nodes": SIMULATOR_NODES, "rviz": OWN_RVIZ, "files": files, "places": own_places, **vars(parts)
    }  # fmt: skip
    commands = [json.dumps(launchable.command) for launchable in launchables]
    return [sys.executable, "-c", code, str(STARTER), str(events), action, json.dumps(ours), *commands]


def read_events(path: Path) -> List[Event]:
    """Return the first MAX_EVENTS events in a file, without lines that are not events.

    If there are more events, the last one is replaced by `TOO_MANY`.
    """
    events: List[Event] = []
    with contextlib.suppress(UnreadableFileError):
        for line in read_text(path).splitlines():
            if len(events) == MAX_EVENTS:
                return [*events[:-1], Event(TOO_MANY)]
            with contextlib.suppress(ValueError, RecursionError, ConfigError):
                events.append(from_plain(Event, json.loads(line), ""))
    return events


TOO_MANY = "too many events"
# kinds of events before the start, the worst first
EVENTS = [
    Kind.MISSING_INCLUDE, Kind.LAUNCH_FILE, Kind.OWN_NODE, Kind.MISSING_PACKAGE, Kind.LAUNCH_PREFIX,
    Kind.SKIPPED,
]  # fmt: skip
_CALLBACK = re.compile(
    r"(?:\[ERROR\] \[[\d.]+(?:, (?P<at>[\d.]+))?\]: "
    r"bad callback: <(?:function|bound method) (?P<name>[\w.]{1,200})[^\n]{0,500}"
    r"|Exception in thread (?P<thread>[^\n]{0,200}):)\n"
    r"Traceback \(most recent call last\):\n(?P<lines>(?:[ \t][^\n]*\n)*)(?P<error>\w[^\n]*)"
)
_LINE = re.compile(r'File "(?:[^"\n]*/)?([^/"\n]+)", line (\d+)')


def exceptions_in(output: str) -> List[Note]:
    """Return the exceptions in callbacks and threads, after which rospy continues, from the output."""
    moments: Dict[str, List[Optional[float]]] = {}
    for match in _CALLBACK.finditer(output):
        places = _LINE.findall(match["lines"])
        line = f" ({places[-1][0]}:{places[-1][1]})" if places else ""
        source = f"callback {match['name']}" if match["name"] else "a thread"
        text = f"{source} raises {match['error'][:200]}{line}"
        moments.setdefault(text, []).append(float(match["at"]) if match["at"] else None)
    notes = []
    for text, (first, *later) in moments.items():
        moment = "" if first is None else f", first at {first:.2f} s"
        notes.append(Note(Kind.EXCEPTION, f"{text}{moment}, {1 + len(later)} times", first))
    return notes


def notes_on(events: Sequence[Event], output: str, own: Collection[str] = ()) -> List[Note]:
    """Return notes on faults, each once, from events and from the output.

    Nodes of packages that are not in the submission's `own` get another kind, if `own` is known.
    """
    notes = []
    for event in events:
        if event.event == "unloadable":
            notes.append(Note(Kind.LAUNCH_FILE, f"the launch file cannot be loaded: {event.error}"))
        elif event.event == "no_include":
            text = f"the launch file cannot be loaded: it includes {event.path}, which does not exist"
            notes.append(Note(Kind.MISSING_INCLUDE, text))
        elif event.event == "skipped":
            text = (
                f"the <include> of {event.path} is skipped, because the grader starts the simulator: "
                f"{event.error}"
            )
            notes.append(Note(Kind.SKIPPED, text))
        elif event.event == "missing":
            text = f"package '{event.package}' is missing; the <{event.tag}> that needs it is left out"
            notes.append(Note(Kind.MISSING_PACKAGE, text))
        elif event.event == "own":
            reason = "it is a node of the simulator's package, and not of the submission"
            notes.append(Note(Kind.OWN_NODE, f"node {event.node} is left out: {reason}"))
        elif event.event == "prefix":
            text = f"launch-prefix '{event.prefix}' of node {event.node} is dropped"
            notes.append(Note(Kind.LAUNCH_PREFIX, text))
    notes.sort(key=lambda note: EVENTS.index(note.kind))
    for node in re.findall(r"ERROR: cannot launch node of type \[([^\]\n]{1,200})\]", output):
        text = f"node {node} cannot be started: no such package or program, or it is not executable"
        is_own = not own or node.partition("/")[0] in own
        notes.append(Note(Kind.NOT_STARTED if is_own else Kind.OTHERS_NODE, text))
    notes += exceptions_in(output)
    errors = re.findall(r"^[^\w\n]*((?:\w+\.)*\w*(?:Error|Exception)\b.*)$", output, re.MULTILINE)
    lines = _LINE.findall(output)
    for event in events:
        if event.event == "died":
            code = event.exit_code
            how = f"exit code {code}"
            if code is not None and code < 0:
                how = f"signal {-code}" + (f", {signal.Signals(-code).name}" if -code < 32 else "")
            line = f" ({lines[-1][0]}:{lines[-1][1]})" if lines else ""
            why = f": {errors[-1][:200]}{line}" if errors and code else ""
            kind = Kind.NODE_ENDED if code == 0 else Kind.NODE_FAILED
            if code is not None and code < 0 and code != -signal.SIGABRT:  # an abort prints its reason
                kind = Kind.NODE_CRASHED
            if own and event.package and event.package not in own:
                kind = Kind.OTHERS_NODE
            notes.append(Note(kind, f"node {event.node} ends during the run ({how}){why}"))
        elif event.event == TOO_MANY:
            text = f"it wrote more than {MAX_EVENTS} events; the first {MAX_EVENTS - 1} of them count"
            notes.append(Note(Kind.LIMIT, text))
    return list(dict.fromkeys(notes))
