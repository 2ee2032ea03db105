"""Findings of a marking: a kind, on which hints and causes depend, and a sentence for people."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Iterable, List, Optional

MAX_NOTES = 30  # notes of a result, because a cell of a spreadsheet holds 32767 characters


class Kind(Enum):
    """Kind of a finding."""

    # findings on the submission, before anything is started
    HAND_IN = "hand-in"  # finding on its archive and packages
    ROBOT = "robot"  # robot that is simulated
    BUILD = "build"
    MISSING_RETURN = "missing return"  # a function without its return, in which the node may crash
    LAUNCH_FILE = "launch file"  # the file cannot be loaded, or starts nothing
    OWN_NODE = "own node"  # node of this package, which is not part of any submission
    MISSING_INCLUDE = "missing include"  # the launch file includes a file that does not exist
    MISSING_PACKAGE = "missing package"
    LAUNCH_PREFIX = "launch prefix"
    SKIPPED = "skipped"  # launch file of the simulator, which marking starts itself
    NO_RVIZ_FILE = "no RViz file"
    # findings on its nodes
    NOT_STARTED = "not started"
    EXCEPTION = "exception"  # error in a callback or thread, after which the node continues
    NODE_FAILED = "node failed"
    NODE_CRASHED = "node crashed"  # a node ended by a signal, usually without a message
    NODE_ENDED = "node ended"  # a node ended without an error
    OTHERS_NODE = "others' node"  # a program of another package was not started, or ended
    LIMIT = "limit"  # limit of memory, processes or files
    # findings on the chain from scan to command
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
    UNREADABLE = "unreadable"  # messages that are not of their topic's type
    AT_ORIGIN = "at the origin"  # always at the origin of its frame, or on the lidar
    NO_RETURN = "no return"  # the marker is there only while no beam has a return
    WRONG_HEIGHT = "wrong height"
    INVISIBLE = "invisible"
    DELETED = "deleted"
    OLD_ONES = "old ones"  # most markers are right, but earlier ones stay
    # ends of a run
    TOUCHES = "touches"
    AT_PILLAR = "at pillar"
    NEVER_MOVED = "never moved"
    STOOD_STILL = "stood still"
    NODES_ENDED = "nodes ended"
    LEAVES = "leaves"
    DEADLINE = "deadline"
    SLOW = "slow"  # the limit of wall time ended the run
    PLAN_DONE = "plan done"  # all calls were made, or the grader has driven the robot
    NO_SERVICE = "no service"
    FEWER_DRIVES = "fewer drives"  # fewer runs than requested
    STALLED = "stalled"
    CUT_OFF = "cut off"


class Subject(Enum):
    """Subject of an item, which does not depend on its name."""

    CODE = "code"
    DRIVE = "drive"
    SERVICE = "service"
    MARKER = "marker"
    DISPLAYS = "displays"  # displays of RViz, by its configuration alone
    MARKER_DISPLAY = "marker display"


# kinds of findings that a missing package may cause
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
