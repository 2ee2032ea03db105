"""Findings of a marking: a kind, on which hints and causes depend, and a sentence for people."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Iterable, List, Optional

# a result shows at most this many notes, because a cell of a spreadsheet holds only 32767 characters
MAX_NOTES = 30


class Kind(Enum):
    """Kind of a finding."""

    # findings on the submission, before any node is started
    HAND_IN = "hand-in"  # a finding on the archive or the packages of the submission
    ROBOT = "robot"  # the robot that was chosen for the simulation, and the reason
    BUILD = "build"
    # a C++ function must return a value, but has no return statement, so the node may crash in it
    MISSING_RETURN = "missing return"
    LAUNCH_FILE = "launch file"  # the launch file cannot be loaded
    NO_NODE = "no node"  # the launch file can be loaded, but starts no node of the submission
    # the launch file names a node of the grader's own package, so this node is not started
    OWN_NODE = "own node"
    MISSING_INCLUDE = "missing include"  # the launch file includes a file that does not exist
    MISSING_PACKAGE = "missing package"
    LAUNCH_PREFIX = "launch prefix"
    # an included launch file of the simulator has an error; it is left out, because `grade` starts the
    # simulator itself
    SKIPPED = "skipped"
    NO_RVIZ_FILE = "no RViz file"
    # findings on the nodes of the submission
    PYTHON_2 = "Python 2"  # an error of Python 3 in code that is written for Python 2
    NOT_STARTED = "not started"
    EXCEPTION = "exception"  # an exception in a callback or thread; the node still runs afterwards
    NODE_FAILED = "node failed"
    NODE_CRASHED = "node crashed"  # a signal ended a node, for example after a segmentation fault
    NODE_ENDED = "node ended"  # a node ended with exit code 0
    # a node that is not from the student's packages could not be started, or ended
    OTHERS_NODE = "others' node"
    LIMIT = "limit"  # a limit of memory, processes or files was exceeded
    # findings on the chain from the scans to the commands: the scans must come in, and the commands must go
    # out
    SILENT_TOPIC = "silent topic"  # the submission subscribes to a topic on which no node publishes
    NO_SCANS = "no scans"  # the submission does not subscribe to the scans
    NO_RANGE = "no range"  # no beam of any scan measured a range, so there is no smallest range
    UNREAD_COMMANDS = "unread commands"  # the submission sends commands on a topic that no node reads
    NO_PUBLISHER = "no publisher"  # the submission has no publisher of commands
    NO_COMMANDS = "no commands"  # the submission has a publisher of commands, but sends none
    ZERO_COMMANDS = "zero commands"
    IN_SPITE_OF_COMMANDS = "in spite of commands"  # the robot does not move, although commands came
    COMMANDS_CEASE = "commands cease"  # the commands end long before the end of the run
    UNANSWERED_SCANS = "unanswered scans"
    FLOOD = "flood"  # the submission sends far too many commands
    # faults of markers
    MIRRORED = "mirrored"  # y has the wrong sign, so the marker is on the wrong side of the robot
    SWAPPED = "swapped"  # x and y are swapped
    Y_IS_ZERO = "y is zero"
    WHOLE_METRES = "whole metres"  # no coordinate has decimals, probably because of an int variable
    OTHER_BEAM = "other beam"  # the distance is right, but the angle is wrong
    IN_BASE_LINK = "in base_link"  # the position is right for the lidar, but the frame is base_link
    NOT_A_NUMBER = "not a number"
    UNREADABLE = "unreadable"  # marker messages could not be read, because they are not of their topic's type
    AT_ORIGIN = "at the origin"  # the marker is always at the origin of its frame, or at the lidar
    NO_RETURN = "no return"  # the marker is at the lidar when no beam measures a range
    WRONG_HEIGHT = "wrong height"
    NO_FRAME = "no frame"  # TF does not have the frame that the marker's header names
    INVISIBLE = "invisible"
    DELETED = "deleted"  # each marker is deleted as soon as it has come, so RViz never draws one
    OLD_ONES = "old ones"  # most markers are right, but RViz also shows older markers, which are wrong
    # reasons for the end of a run
    TOUCHES = "touches"  # the robot touches the pillar
    AT_PILLAR = "at pillar"  # the robot stands at the pillar
    NEVER_MOVED = "never moved"
    STOOD_STILL = "stood still"  # the robot moved first, and then stood still for long
    NODES_ENDED = "nodes ended"
    LEAVES = "leaves"  # the robot has passed the pillar and drives away from it
    DEADLINE = "deadline"  # the limit of simulated time ended the run
    SLOW = "slow"  # the limit of wall time ended the run
    # the run ended because everything that `grade` had planned for it was done, for example all service calls
    PLAN_DONE = "plan done"
    NO_SERVICE = "no service"  # the submission offers no service to start and stop the robot
    FEWER_DRIVES = "fewer drives"  # `grade` made fewer runs than requested
    STALLED = "stalled"  # the simulator has ended, or its time stands still
    CUT_OFF = "cut off"  # marking ended the run before the recorder found a reason


class Subject(Enum):
    """Subject of an item; for example, it decides which lines of code the review page shows."""

    CODE = "code"
    DRIVE = "drive"
    SERVICE = "service"
    MARKER = "marker"
    DISPLAYS = "displays"  # displays in RViz's configuration file; this item does not depend on a run
    MARKER_DISPLAY = "marker display"


# kinds of findings whose cause may be a missing package
MISSES_PACKAGES = frozenset(
    {
        Kind.BUILD,
        Kind.MISSING_PACKAGE,
        Kind.LAUNCH_FILE,
        Kind.NO_NODE,
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
    """Return the sentences of notes, each once, in order.

    If there are more than MAX_NOTES, the others are left out, and the last sentence gives their number.
    """
    sentences = list(dict.fromkeys(note.text for note in notes))
    left_out = len(sentences) - MAX_NOTES
    if left_out <= 0:
        return sentences
    return [*sentences[:MAX_NOTES], f"and {left_out} more notes"]
