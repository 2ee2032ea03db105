"""Findings of a marking: kinds, by which hints and causes go, and sentences, which are for people."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Iterable, List, Optional

MAX_NOTES = 30  # of a result: a cell of a spreadsheet holds 32767 letters


class Kind(Enum):
    """Kind of a finding."""

    # of the hand-in, before anything is started
    HAND_IN = "hand-in"  # its archive and packages
    ROBOT = "robot"  # that is simulated
    BUILD = "build"
    MISSING_RETURN = "missing return"  # of a function, where the node may crash
    LAUNCH_FILE = "launch file"  # cannot be loaded, or starts nothing
    OWN_NODE = "own node"  # of this package, which is nobody's hand-in
    MISSING_INCLUDE = "missing include"  # so that it cannot be loaded
    MISSING_PACKAGE = "missing package"
    LAUNCH_PREFIX = "launch prefix"
    SKIPPED = "skipped"  # a launch file of the simulator, which marking brings
    NO_RVIZ_FILE = "no RViz file"
    # of its nodes
    NOT_STARTED = "not started"
    EXCEPTION = "exception"  # in a callback or thread, after which the node goes on
    NODE_FAILED = "node failed"
    NODE_CRASHED = "node crashed"  # by a signal, mostly without a word
    NODE_ENDED = "node ended"  # without an error
    OTHERS_NODE = "others' node"  # a program that is not the hand-in's was not started, or ended
    LIMIT = "limit"  # of memory, processes or files
    # of the chain from scan to command
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
    # of markers
    MIRRORED = "mirrored"
    SWAPPED = "swapped"
    Y_IS_ZERO = "y is zero"
    WHOLE_METRES = "whole metres"
    OTHER_BEAM = "other beam"
    IN_BASE_LINK = "in base_link"
    NOT_A_NUMBER = "not a number"
    UNREADABLE = "unreadable"  # messages that are not of their topic's type
    AT_ORIGIN = "at the origin"  # of its frame, or on the lidar, always
    NO_RETURN = "no return"  # likewise, at times: where no beam has a return
    WRONG_HEIGHT = "wrong height"
    INVISIBLE = "invisible"
    DELETED = "deleted"
    OLD_ONES = "old ones"  # most are right, but earlier ones stay
    # ends of a drive
    TOUCHES = "touches"
    AT_PILLAR = "at pillar"
    NEVER_MOVED = "never moved"
    STOOD_STILL = "stood still"
    NODES_ENDED = "nodes ended"
    LEAVES = "leaves"
    DEADLINE = "deadline"
    SLOW = "slow"  # on the wall clock
    PLAN_DONE = "plan done"  # every call is made, or the robot driven
    NO_SERVICE = "no service"
    FEWER_DRIVES = "fewer drives"  # than asked for
    STALLED = "stalled"
    CUT_OFF = "cut off"


class Subject(Enum):
    """Subject of an item: what it looks at, whatever its name says."""

    CODE = "code"
    DRIVE = "drive"
    SERVICE = "service"
    MARKER = "marker"
    DISPLAYS = "displays"  # of RViz, by its configuration alone
    MARKER_DISPLAY = "marker display"


# of findings that a package which is not installed may cause
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
    at: Optional[float] = None  # [s], simulated


def texts(notes: Iterable[Note]) -> List[str]:
    """The sentences of notes, each once, in order, and how many more there are."""
    sentences = list(dict.fromkeys(note.text for note in notes))
    more = len(sentences) - MAX_NOTES
    return sentences if more <= 0 else [*sentences[:MAX_NOTES], f"and {more} more notes"]
