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
from husky_grading.isolation.own_files import STARTER, VisibleCode, program_folders
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind, Note
from husky_grading.records import Launchable
from husky_highlevel_controller.config import ConfigError, from_plain, number
from husky_highlevel_controller.paths import share_folder

WORKSPACE = "workspace.json"
# folder beside the workspace, with copies of public packages, such as husky_gazebo, to which a student has
# added files
COPIES = "copies"
# folder inside the folder of a run; it is the only folder that the submission can write during the run
SUBMISSION_FOLDER = "submission"
OWN_RVIZ = ("husky_rviz", "gazebo_gui")  # names of the RViz nodes in this package's launch files
# A node of a launch file with one of these names is not started. ROS allows each name only once, so the new
# node would end the node of the simulator.
SIMULATOR_NODES = ("/husky_simulator",)
# folder of packages that replace Gazebo's packages; their launch files start our simulator
COMPAT = share_folder() / "compat"
# at most this number of events of a run is read, because a submission can write any number of events
MAX_EVENTS = 10_000


@dataclass(frozen=True)
class RobotPackages:
    """Packages of ROS, not of the student, whose nodes an exercise uses, such as the filter of exercise 4.

    In most exercises students write a node, so there are no such packages.
    """

    # packages whose nodes the student's launch file starts, and which are graded in place of the student's
    # own nodes: robot_localization in exercise 4, where students write no node. Empty in other exercises.
    by_submission: Tuple[str, ...] = ()
    # packages whose nodes `grade` starts itself: rosbag in exercise 4. If the student's launch file starts
    # such a node, this node is left out.
    by_marking: Tuple[str, ...] = ()


NO_ROBOT_PACKAGES = RobotPackages()  # default: nodes of the student's own packages are graded


@dataclass(frozen=True)
class NamedRobot:
    """Robot that a submission's files name."""

    version: str = ""  # name of the robot, a key of ROBOT_VERSIONS
    why: str = ""  # reason why this is the robot, in a sentence
    # false if `grade` may still choose another robot, by the topic of scans to which the submission
    # subscribes
    is_certain: bool = False


@dataclass(frozen=True)
class Submission:
    """Launchable, the workspace in which it runs, and facts from its files."""

    launchable: Launchable
    workspace: Workspace = field(default_factory=Workspace)
    # folder of the submission's built workspace; None if `grade` has not built it
    root: Optional[Path] = None
    nodes: Tuple[str, ...] = ()  # package/type of the nodes that the submission starts
    # reasons why no node of the submission can be started; empty if nodes can be started
    problem: Tuple[Note, ...] = ()
    notes: Tuple[Note, ...] = ()
    rviz: RvizConfig = field(default_factory=RvizConfig)
    robot: NamedRobot = field(default_factory=NamedRobot)
    sandbox: str = ""  # kind of sandbox in which `grade` prepared the submission, see `kind_of_sandbox`
    network: str = ""  # "loopback only", or "not kept apart" if the submission is in the machine's network
    own: Tuple[str, ...] = ()  # names of the packages that the student has delivered; empty if unknown
    # the chosen launch file, then the launch files that fit the exercise equally well but start other nodes;
    # empty if no other launch file fits
    equals: Tuple[str, ...] = ()
    # packages of ROS whose nodes the exercise uses; `workspace.json` has them under this name
    parts: RobotPackages = field(default_factory=RobotPackages)
    # values for the rubric from the submission's files, by name: the result of the exercise's `read_facts`
    facts: Mapping[str, Any] = field(default_factory=dict)
    made_of: str = ""  # hash of the files and settings from which the submission was prepared


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
    left_out: Tuple[str, ...] = ()  # package/type of the nodes that are not started, such as the simulator
    rviz: Tuple[RvizNode, ...] = ()
    uses: Tuple[str, ...] = ()  # names of packages that the launch file or node refers to
    pillar: bool = False  # true if the launch file names the world that the course uses
    # package/type and arguments of the nodes in `left_out`, without nodes of the grader's package
    left_out_arguments: Tuple[Tuple[str, str], ...] = ()
    digest: str = ""  # two plans with the same hash start the same programs
    # The program that loads launch files writes the fields above. `grade` itself sets the fields below.
    is_read: bool = False  # true if the launch file can be loaded
    package_path: Optional[Path] = None  # folder of the package of the launch file or node
    notes: Tuple[Note, ...] = ()  # findings on the launch file or node


@dataclass(frozen=True)
class Event:
    """Line that the program wrote; an event has only the fields that its kind needs."""

    event: str  # kind of the event, such as "plan" or "died"
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
    robot_packages: RobotPackages = NO_ROBOT_PACKAGES,
    visible_code: VisibleCode = VisibleCode.NOTHING,
) -> List[str]:
    """Return the command line of the program that reads launch files, or starts a single one.

    The program is a process of its own, so the code of a submission does not run in the grader.

    Args:
        events: file into which the program writes its events.
        action: `describe` reads launch files, `run` starts one, and `memcheck` starts one with its compiled
            nodes in valgrind.
        launchables: launch files or nodes.
        robot_packages: packages of ROS, not of the student. The nodes of `by_submission` are started and
            graded like the student's. The nodes of `by_marking` are left out, because `grade` starts them.
        visible_code: files of this package that the program sees. Nodes of this package are left out, because
            they are not part of any submission; with ALL, they are started.
    """
    # The program is started by its path, and not as a module of our package, because a package of the
    # submission may have the name of our package. With runpy, unlike `python STARTER`, the folder of the
    # program is not searched for modules.
    code = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='__main__')"
    ours = json.dumps(_facts_for_starter(robot_packages, visible_code))
    commands = [json.dumps(launchable.command) for launchable in launchables]
    return [sys.executable, "-c", code, str(STARTER), str(events), action, ours, *commands]


def _facts_for_starter(robot_packages: RobotPackages, visible_code: VisibleCode) -> Dict[str, Any]:
    """Return names and paths by which the program that starts a submission finds the nodes to leave out.

    The program gets them as an argument, because it cannot import the modules of this package.
    """
    manifest = (share_folder() / "package.xml").resolve()
    our_places = [str(manifest), *map(str, program_folders())]
    return {
        "nodes": SIMULATOR_NODES,  # a node with such a name is left out
        "rviz": OWN_RVIZ,  # an RViz node with such a name is left out if the submission has its own RViz
        # launch files that start our simulator in place of Gazebo; an <include> of such a file is left out
        "files": [f"launch/{file.name}" for file in COMPAT.glob("*/launch/*.launch")],
        # manifest and program folders of this package; a node from there is left out, unless the submission
        # is our own
        "places": [] if visible_code is VisibleCode.ALL else our_places,
        "by_submission": robot_packages.by_submission,
        "by_marking": robot_packages.by_marking,
    }


def read_events(path: Path) -> List[Event]:
    """Return the events in a file, without lines that are not events.

    If there are more than MAX_EVENTS, the list ends with the event `TOO_MANY`, and has MAX_EVENTS in all.
    """
    events: List[Event] = []
    with contextlib.suppress(UnreadableFileError):
        for line in read_text(path).splitlines():
            if len(events) == MAX_EVENTS:
                return [*events[:-1], Event(TOO_MANY)]
            # the errors are ignored, because a submission can write any line into the file
            with contextlib.suppress(ValueError, RecursionError, ConfigError):
                events.append(from_plain(Event, json.loads(line), ""))
    return events


TOO_MANY = "too many events"  # event in place of all events after the first MAX_EVENTS - 1
# kinds of notes on the loading of the launch file; a kind that comes first is reported first
ORDER_OF_LOADING_NOTES = [
    Kind.MISSING_INCLUDE, Kind.LAUNCH_FILE, Kind.OWN_NODE, Kind.MISSING_PACKAGE, Kind.LAUNCH_PREFIX,
    Kind.SKIPPED,
]  # fmt: skip
# pattern of an exception in a callback of rospy, or in a thread, with its traceback
_CALLBACK = re.compile(
    r"(?:\[ERROR\] \[[\d.]+(?:, (?P<at>[\d.]+))?\]: "
    r"bad callback: <(?:function|bound method) (?P<name>[\w.]{1,200})[^\n]{0,500}"
    r"|Exception in thread (?P<thread>[^\n]{0,200}):)\n"
    r"Traceback \(most recent call last\):\n(?P<lines>(?:[ \t][^\n]*\n)*)(?P<error>\w[^\n]*)"
)
# errors of Python 3 in code that Python 2 accepts
_PYTHON_2 = re.compile(
    r"SyntaxError: (?:Missing parentheses in call to '(?:print|exec)'|multiple exception types must be )"
    r"|NameError: name '(?:xrange|raw_input|unicode|unichr|reduce|basestring)' is not defined"
    r"|AttributeError: 'dict' object has no attribute '(?:has_key|iteritems|itervalues|iterkeys)'"
)
# pattern of a line of a traceback; the groups are the file's name and the line's number
_LINE = re.compile(r'File "(?:[^"\n]*/)?([^/"\n]+)", line (\d+)')


def exceptions_in(output: str) -> List[Note]:
    """Return a note on each exception in a callback or thread, from the output of the submission.

    rospy prints such an exception and continues, so the node does not end.
    """
    # key: sentence on an exception; value: simulated times [s] of the exception, None if unknown
    times_by_text: Dict[str, List[Optional[float]]] = {}
    for match in _CALLBACK.finditer(output):
        source = f"callback {match['name']}" if match["name"] else "a thread"
        # the last call in the traceback has raised the exception
        text = f"{source} raises {match['error'][:200]}{_last_place(match['lines'])}"
        at = float(match["at"]) if match["at"] else None
        times_by_text.setdefault(text, []).append(at)
    notes = []
    for text, times in times_by_text.items():  # each exception has one note
        first = times[0]
        moment = "" if first is None else f", first at {first:.2f} s"
        notes.append(Note(Kind.EXCEPTION, f"{text}{moment}, {len(times)} times", first))
    return notes


def notes_on(events: Sequence[Event], output: str, own: Collection[str] = ()) -> List[Note]:
    """Return notes on faults of a submission's launch file and nodes, each once.

    Args:
        events: events that the program with the submission has written.
        output: output of the submission's nodes and of roslaunch.
        own: names of the submission's packages; empty if they are unknown. Faults of nodes of other packages
            get the kind OTHERS_NODE.
    """
    notes = []
    for event in events:
        note = _note_on_loading(event)
        if note:
            notes.append(note)
    # the fault that the student should repair first is reported first
    notes.sort(key=lambda note: ORDER_OF_LOADING_NOTES.index(note.kind))
    # `tolerate_failed_nodes` in nodes/submission.py prints this line for each node that cannot be started
    for node in re.findall(r"ERROR: cannot launch node of type \[([^\]\n]{1,200})\]", output):
        text = f"node {node} cannot be started: no such package or program, or it is not executable"
        # if the packages of the student are unknown, each node counts as the student's
        is_own = not own or node.partition("/")[0] in own
        notes.append(Note(Kind.NOT_STARTED if is_own else Kind.OTHERS_NODE, text))
    last_error = _last_error(output)  # probable reason for the end of a node
    if _PYTHON_2.search(output):
        text = f"its code is written for Python 2, and this machine runs Python 3: {last_error}"
        notes.append(Note(Kind.PYTHON_2, text))
    notes += exceptions_in(output)
    for event in events:
        if event.event == "died":
            notes.append(_note_on_death(event, last_error, own))
        elif event.event == TOO_MANY:
            text = f"it wrote more than {MAX_EVENTS} events; the first {MAX_EVENTS - 1} of them count"
            notes.append(Note(Kind.LIMIT, text))
    return list(dict.fromkeys(notes))


def _note_on_loading(event: Event) -> Optional[Note]:
    """Return the note on an event while the launch file is loaded; None if it is another event."""
    if event.event == "unloadable":
        return Note(Kind.LAUNCH_FILE, f"the launch file cannot be loaded: {event.error}")
    if event.event == "no_include":
        text = f"the launch file cannot be loaded: it includes {event.path}, which does not exist"
        return Note(Kind.MISSING_INCLUDE, text)
    if event.event == "skipped":  # a launch file of the simulator with an error, which does no harm
        text = f"the <include> of {event.path} is skipped, because the grader starts the simulator"
        return Note(Kind.SKIPPED, f"{text}: {event.error}")
    if event.event == "missing":
        text = f"package '{event.package}' is missing; the <{event.tag}> that needs it is left out"
        return Note(Kind.MISSING_PACKAGE, text)
    if event.event == "own":
        reason = "it is a node of the simulator's package, and not of the submission"
        return Note(Kind.OWN_NODE, f"node {event.node} is left out: {reason}")
    if event.event == "prefix":
        return Note(Kind.LAUNCH_PREFIX, f"launch-prefix '{event.prefix}' of node {event.node} is dropped")
    return None


def _last_error(output: str) -> str:
    """Return the last error that Python has printed, with its file and line; empty if there is none."""
    # lines that begin with the class of an error, such as "rospy.exceptions.ROSException: ..."; only spaces
    # and signs may stand before the class, so a line that mentions an error after other words does not count
    errors = re.findall(r"^[^\w\n]*((?:\w+\.)*\w*(?:Error|Exception)\b.*)$", output, re.MULTILINE)
    if not errors:
        return ""
    # the last line of code that a traceback has named is most probably the one with the last error
    return f"{errors[-1][:200]}{_last_place(output)}"


def _last_place(output: str) -> str:
    """Return the last line of code that a traceback names, as " (FILE:LINE)"; empty if there is none."""
    places = _LINE.findall(output)
    return " ({}:{})".format(*places[-1]) if places else ""


def _note_on_death(event: Event, last_error: str, own: Collection[str]) -> Note:
    """Return the note on a node that ends during the run.

    Args:
        event: event "died".
        last_error: last error in the output; empty if there is none.
        own: packages of the submission; empty if unknown.
    """
    code = event.exit_code
    kind = Kind.NODE_FAILED  # applies if the exit code is positive or unknown
    ending = f"exit code {code}"
    if code == 0:
        kind = Kind.NODE_ENDED
    elif code is not None and code < 0:  # a signal has ended the process
        # signals from 32 on have no names
        name = f", {signal.Signals(-code).name}" if -code < 32 else ""
        ending = f"signal {-code}{name}"
        # a node that ends by SIGABRT has printed the reason itself, so it does not count as NODE_CRASHED
        if code != -signal.SIGABRT:
            kind = Kind.NODE_CRASHED
    # the fault is not in the submission; `judge` names such a fault only if no node of the submission runs
    if own and event.package and event.package not in own:
        kind = Kind.OTHERS_NODE
    # a node that ends with exit code 0 has no error; the last error in the output is from something else
    why = f": {last_error}" if last_error and code else ""
    return Note(kind, f"node {event.node} ends during the run ({ending}){why}")
