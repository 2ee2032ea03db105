"""Causes for which a robot stands or stops, from the recording of a run, and hints by their kind."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import List, Optional

from husky_grading.notes import Kind, Note
from husky_grading.recording import Recording
from husky_grading.records import Item

# [s] the submission has stopped sending commands if none came in this simulated time at the end of the run
SILENT = 5.0
NO_SCANS = Note(Kind.NO_SCANS, "it does not subscribe to the scans")
MOVES_NOTHING = 1e-3  # [m/s, rad/s] a command up to this size does not move the robot
# hints, and parts of hints
LOGS = "read the output of your node, and check that your launch file starts it"
ENDS = "the last line of its output gives the reason"
KEEP_AS_MEMBER = "keep it in a member, because in C++ a local one ends with its function"
HINTS = {
    Kind.OWN_NODE: "start a node of your own package",
    Kind.SILENT_TOPIC: "compare your topic's name with `rostopic list`, and look for a missing remap",
    Kind.NO_SCANS: f"subscribe to the scans in the constructor, and {KEEP_AS_MEMBER}",
    Kind.NO_RANGE: "the world must have the pillar in reach of the lidar",
    Kind.NO_PUBLISHER: f"advertise geometry_msgs/Twist on /cmd_vel in the constructor, and {KEEP_AS_MEMBER}",
    Kind.NO_COMMANDS: (
        "publish the velocity in each callback of the scans; look for a condition, a wait, an exception that "
        "is caught, or a service that must be called first"
    ),
    Kind.UNREAD_COMMANDS: "publish on /cmd_vel, or remap your topic to it",
    Kind.ZERO_COMMANDS: (
        "look for a gain of 0, or one that an int cuts to 0; a parameter that is not loaded; a branch that "
        "always stops; or a service that must be called first"
    ),
    Kind.NOT_A_NUMBER: (
        "print the speed and the rate of turn before you publish them; look for a range that is inf or NaN, "
        "and for a division by 0"
    ),
    Kind.EXCEPTION: "it happens in the line that is named here",
    Kind.PYTHON_2: "ROS Noetic runs Python 3: write print(...), range and `except Error as error`",
    Kind.NOT_STARTED: "compare pkg and type in the launch file with the programs that your package has",
    Kind.NODE_FAILED: ENDS,
    Kind.NODE_CRASHED: (
        "it ends without a message: look for an index out of range, an empty vector, a null pointer, or a "
        'function without its return; launch-prefix="gdb -ex run --args" shows the line'
    ),
    Kind.LIMIT: "look for a vector, a log or a list that grows with each scan",
    Kind.NODE_ENDED: ENDS,
    Kind.COMMANDS_CEASE: "check which branch your callback takes at that moment, and for what it waits",
    Kind.BUILD: "fix this error first, because nothing can be started before; others may follow from it",
    Kind.LAUNCH_FILE: "fix this in the launch file; roslaunch prints the same error and starts nothing",
    Kind.NO_NODE: (
        "add <node pkg=... type=... name=.../> for your node to the launch file; in exercise 4, for "
        "ekf_localization_node of robot_localization"
    ),
    Kind.MISSING_INCLUDE: "hand in the file that is named, or take its <include> out of the launch file",
    Kind.MISSING_PACKAGE: "hand in the package that is named, or do without it",
}
# Kinds of notes on packages and nodes of others. `causes` leaves them out; `first_cause` takes one of them if
# no node of the submission runs.
OF_OTHERS = {Kind.MISSING_PACKAGE, Kind.OTHERS_NODE}
# kinds of notes that never explain lost points
HARMLESS = {
    Kind.ROBOT, Kind.UNANSWERED_SCANS, Kind.FLOOD, Kind.LAUNCH_PREFIX, Kind.SKIPPED, Kind.UNREADABLE,
}  # fmt: skip
# If a run ended for one of these reasons, the controller of the submission still ran. So a node that has
# ended was another node, and is not the cause of lost points.
RAN_ON = {
    Kind.TOUCHES, Kind.AT_PILLAR, Kind.NEVER_MOVED, Kind.STOOD_STILL, Kind.SLOW, Kind.NO_PUBLISHER,
    Kind.CUT_OFF, Kind.LEAVES,
}  # fmt: skip


def with_cause(item: Item, loss: str, cause: Note) -> Item:
    """Return an item with the loss and its cause as evidence, and the hint for this cause."""
    return replace(item, evidence=f"{loss}: {cause.text}", hint=hint_on(cause))


def hint_on(cause: Note) -> str:
    """Return the hint for a cause, by its kind."""
    return HINTS.get(cause.kind, LOGS)


def causes(recording: Recording) -> List[Note]:
    """Return the notes that can explain lost points."""
    explains_nothing = HARMLESS | OF_OTHERS
    if _ran_to_the_end(recording):
        explains_nothing.add(Kind.NODE_ENDED)
    return [note for note in recording.notes if note.kind not in explains_nothing]


def _ran_to_the_end(recording: Recording) -> bool:
    """Return whether the controller of the submission still ran at the end of the run.

    If a node of the submission has ended, this node was then not the controller. So the end of this node does
    not explain lost points.
    """
    if not recording.ended:
        return False
    if recording.ended.kind is Kind.DEADLINE:
        # a controller that sent commands until the deadline still ran
        return bool(len(recording.commands)) and recording.times[-1] - recording.commands[-1] < SILENT
    return recording.ended.kind in RAN_ON


def moves_nothing(largest: Optional[float]) -> bool:
    """Return whether even the largest command [m/s, rad/s] moves nothing; False if it is unknown."""
    return largest is not None and largest <= MOVES_NOTHING


def is_up(recording: Recording) -> bool:
    """Return whether a node of the submission ran, because the submission subscribed or published."""
    topics = (*recording.silent_topics, *recording.unread_topics, *recording.marker_topics)
    return recording.subscribed or bool(recording.command_count or topics)


def cause_of_no_marker(recording: Recording) -> Optional[Note]:
    """Return why no marker came, such as an exception or missing scans; None if unknown."""
    reasons = causes(recording)
    if reasons:
        return reasons[0]
    if recording.subscribed:
        # The submission gets the scans, so `first_cause` would return a reason that concerns its velocity
        # commands. Such a reason does not explain a missing marker.
        return None
    return first_cause(recording)  # a reason why it does not subscribe to the scans


def silent_text(topics: str) -> str:
    """Return a sentence on topics without a publisher to which a submission subscribes."""
    return f"it subscribes to {topics}, where nothing is published"


def first_cause(recording: Recording) -> Note:
    """Return why the robot stands: the first step that fails, from the start of a node to its commands."""
    reasons = causes(recording)  # notes that can be the cause, such as an exception
    if reasons:
        return reasons[0]
    silent, unread = ", ".join(recording.silent_topics), ", ".join(recording.unread_topics)
    # The tests go step by step from the scans to the motion of the robot. The first step that fails is the
    # cause.
    if not recording.subscribed and silent:
        return Note(Kind.SILENT_TOPIC, silent_text(silent))
    # a missing package or a failed node of another package matters only if no node of the student runs
    notes_on_others = [note for note in recording.notes if note.kind in OF_OTHERS]
    if notes_on_others and not is_up(recording):
        return notes_on_others[0]
    if not recording.subscribed:
        return NO_SCANS
    # the submission gets the scans, but no command of it comes to the robot
    if not recording.command_count and unread:
        return Note(Kind.UNREAD_COMMANDS, f"it sends its commands to {unread}, which has no subscriber")
    if not recording.command_count and recording.advertised:
        return Note(Kind.NO_COMMANDS, "nothing came on cmd_vel")
    if not recording.command_count:
        return Note(Kind.NO_PUBLISHER, "it advertises no cmd_vel")
    return _fault_of_commands(recording)


def _fault_of_commands(recording: Recording) -> Note:
    """Return why the commands that came do not move the robot; the cause must be in their values."""
    if recording.zero_count == recording.command_count:
        return Note(Kind.ZERO_COMMANDS, f"all {recording.command_count} commands were zero")
    if moves_nothing(recording.fastest) and moves_nothing(recording.sharpest):
        most = f"{recording.fastest:.1g} m/s and {recording.sharpest:.1g} rad/s"
        text = f"all {recording.command_count} commands are nearly zero, at most {most}"
        return Note(Kind.ZERO_COMMANDS, text)
    if inf in (recording.fastest, recording.sharpest):  # a NaN is recorded as inf, too
        return Note(
            Kind.NOT_A_NUMBER, "it sends commands that the robot refuses: NaN, infinite, or not a Twist"
        )
    return Note(Kind.IN_SPITE_OF_COMMANDS, f"in spite of {recording.command_count} commands")


def cause_of_stop(recording: Recording) -> Optional[Note]:
    """Return why a robot stops on its way, such as an exception in its node; None if unknown."""
    reasons = causes(recording)
    if reasons:
        return reasons[0]
    # the cause is known only if commands came, but stopped long before the end of the run
    if not len(recording.commands) or recording.times[-1] - recording.commands[-1] < SILENT:
        return None
    last = float(recording.commands[-1])
    text = (
        f"{recording.command_count} commands, the last at {last:.2f} s, then none: its callback waits (for a "
        "service, in a loop or a sleep), takes a branch without a command, or gets no scan"
    )
    return Note(Kind.COMMANDS_CEASE, text, last)


def as_ending(cause: Optional[Note]) -> str:
    """Return a cause as the end of a sentence; empty if it is unknown."""
    return f"; {cause.text}" if cause else ""
