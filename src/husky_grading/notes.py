"""Findings of a marking: a kind, on which hints and causes depend, and a sentence for people."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Iterable, List, Optional

# largest number of notes of a result, because a cell of a spreadsheet holds only 32767 characters
MAX_NOTES = 30


class Kind(Enum):
    """Kind of a finding."""

    # findings on the submission, before any node is started
    HAND_IN = "hand-in"  # finding on the archive and the packages of the submission
    ROBOT = "robot"  # finding on the choice of the simulated robot
    BUILD = "build"
    MISSING_RETURN = "missing return"  # a C++ function has no return statement, so the node may crash in it
    LAUNCH_FILE = "launch file"  # the launch file cannot be loaded, or starts no node
    OWN_NODE = "own node"  # the launch file starts a node of this package, which is left out
    MISSING_INCLUDE = "missing include"  # the launch file includes a file that does not exist
    MISSING_PACKAGE = "missing package"
    LAUNCH_PREFIX = "launch prefix"
    # an included launch file of the simulator is left out, because marking starts the simulator itself
    SKIPPED = "skipped"
    NO_RVIZ_FILE = "no RViz file"
    # findings on the nodes of the submission
    NOT_STARTED = "not started"
    EXCEPTION = "exception"  # an exception in a callback or thread, after which the node continues
    NODE_FAILED = "node failed"
    NODE_CRASHED = "node crashed"  # a node ended by a signal, usually without a message
    NODE_ENDED = "node ended"  # a node ended without an error
    OTHERS_NODE = "others' node"  # a node of another package was not started, or has ended
    LIMIT = "limit"  # a limit of memory, processes or files was exceeded
    # findings on the path from the scans to the commands
    SILENT_TOPIC = "silent topic"
    NO_SCANS = "no scans"
    UNREAD_COMMANDS = "unread commands"
    NO_PUBLISHER = "no publisher"
    NO_COMMANDS = "no commands"
    ZERO_COMMANDS = "zero commands"
    IN_SPITE_OF_COMMANDS = "in spite of commands"
    COMMANDS_CEASE = "commands cease"
    UNANSWERED_SCANS = "unanswered scans"
    FLOOD = "flood"
    # faults of markers
    MIRRORED = "mirrored"
    SWAPPED = "swapped"
    Y_IS_ZERO = "y is zero"
    WHOLE_METRES = "whole metres"
    OTHER_BEAM = "other beam"
    IN_BASE_LINK = "in base_link"
    NOT_A_NUMBER = "not a number"
    UNREADABLE = "unreadable"  # marker messages do not have the type of their topic
    AT_ORIGIN = "at the origin"  # the marker is always at the origin of its frame, or at the lidar
    NO_RETURN = "no return"  # the marker is near the pillar only while no beam of the lidar measures a range
    WRONG_HEIGHT = "wrong height"
    INVISIBLE = "invisible"
    DELETED = "deleted"
    OLD_ONES = "old ones"  # most markers are right, but RViz still shows earlier wrong markers
    # reasons for the end of a run
    TOUCHES = "touches"
    AT_PILLAR = "at pillar"
    NEVER_MOVED = "never moved"
    STOOD_STILL = "stood still"
    NODES_ENDED = "nodes ended"
    LEAVES = "leaves"
    DEADLINE = "deadline"
    SLOW = "slow"  # the limit of wall time ended the run
    # the run ended after its last planned action: a service call, or a motion by the grader
    PLAN_DONE = "plan done"
    NO_SERVICE = "no service"
    FEWER_DRIVES = "fewer drives"  # `grade` made fewer runs than requested
    STALLED = "stalled"
    CUT_OFF = "cut off"


class Subject(Enum):
    """Subject of an item, which does not depend on its name."""

    CODE = "code"
    DRIVE = "drive"
    SERVICE = "service"
    MARKER = "marker"
    DISPLAYS = "displays"  # displays of RViz, judged by the configuration file alone
    MARKER_DISPLAY = "marker display"


# kinds of findings whose cause may be a missing package
MISSES_PACKAGES = frozenset(
    {
        Kind.BUILD,
        Kind.MISSING_PACKAGE,
        Kind.LAUNCH_FILE,
        Kind.MISSING_INCLUDE,
        Kind.NOT_STARTED,
        Kind.NODE_FAILED,
        Kind.NODE_CRASHED,
        Kind.OTHERS_NODE,
    }
)


@dataclass(frozen=True)
class Note:
    """Finding of one kind."""

    kind: Kind
    text: str
    at: Optional[float] = None  # [s] simulated time


def texts(notes: Iterable[Note]) -> List[str]:
    """Return the sentences of notes, each once, in order, and the number of further ones."""
    sentences = list(dict.fromkeys(note.text for note in notes))
    more = len(sentences) - MAX_NOTES
    return sentences if more <= 0 else [*sentences[:MAX_NOTES], f"and {more} more notes"]
