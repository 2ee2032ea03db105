"""Causes for which a robot stands or stops, by a drive's recording, and hints by their kind."""

from __future__ import annotations

from dataclasses import replace
from typing import List, Optional

from husky_grading.notes import Kind, Note
from husky_grading.recording import Recording
from husky_grading.records import Item

SILENT = 5.0  # [s], simulated: so long without a command, it has ceased to send any
NO_SCANS = Note(Kind.NO_SCANS, "it does not subscribe to the scans")
MOVES_NOTHING = 1e-3  # [m/s, rad/s], a command that is smaller moves nothing
LOGS = "read what your node prints, and see whether your launch file starts it"
ENDS = "the last line of its output says why"
MEMBER = "keep it in a member: in C++ a local one ends with its function"
HINTS = {
    Kind.OWN_NODE: "start a node of your own package",
    Kind.SILENT_TOPIC: "compare your topic's name with `rostopic list`, and look for a missing remap",
    Kind.NO_SCANS: f"subscribe to the scans in the constructor, and {MEMBER}",
    Kind.NO_PUBLISHER: f"advertise geometry_msgs/Twist on /cmd_vel in the constructor, and {MEMBER}",
    Kind.NO_COMMANDS: (
        "publish the velocity in each callback of the scans: see what keeps yours from it (a condition, "
        "something it waits for, an exception that is caught, a service that must be called first)"
    ),
    Kind.UNREAD_COMMANDS: "publish on /cmd_vel, or remap your topic to it",
    Kind.ZERO_COMMANDS: (
        "a gain of 0, or cut to 0 by a whole number; a parameter that is not loaded; a branch that always "
        "stops; or a service that must be called first"
    ),
    Kind.EXCEPTION: "the line named is where it happens",
    Kind.NOT_STARTED: "compare pkg and type in the launch file with the programs that your package has",
    Kind.NODE_FAILED: ENDS,
    Kind.NODE_CRASHED: (
        "it ends without a word: look for an index out of range, an empty vector, a pointer to nothing, or a "
        'function without its return; launch-prefix="gdb -ex run --args" shows the line'
    ),
    Kind.LIMIT: "see what takes so much: a vector, a log or a list that grows with each scan",
    Kind.NODE_ENDED: ENDS,
    Kind.COMMANDS_CEASE: "the branch that your callback takes at that moment, and what it waits for",
    Kind.BUILD: "mend this error first: nothing can be started without it; others may follow from it",
    Kind.LAUNCH_FILE: "mend this in the launch file: roslaunch says the same, and starts nothing without it",
    Kind.MISSING_INCLUDE: "hand in the file that is named, or take its <include> out of the launch file",
    Kind.MISSING_PACKAGE: "hand in the package that is named, or do without it",
}
# of these nothing comes of its own: they are causes only where nothing of the submission is up
OF_OTHERS = {Kind.MISSING_PACKAGE, Kind.OTHERS_NODE}
# notes that are no cause
HARMLESS = {
    Kind.ROBOT, Kind.UNANSWERED_SCANS, Kind.FLOOD, Kind.LAUNCH_PREFIX, Kind.SKIPPED, Kind.UNREADABLE,
}  # fmt: skip
# ends of a drive until which another node ran than one that had ended without an error
RAN_ON = {
    Kind.TOUCHES, Kind.AT_PILLAR, Kind.NEVER_MOVED, Kind.STOOD_STILL, Kind.SLOW, Kind.NO_PUBLISHER,
    Kind.CUT_OFF, Kind.LEAVES,
}  # fmt: skip


def with_cause(item: Item, loss: str, cause: Note) -> Item:
    """The item with what was lost and its cause as evidence, and the hint for that cause."""
    return replace(item, evidence=f"{loss}: {cause.text}", hint=hint_on(cause))


def hint_on(cause: Note) -> str:
    """Hint for a cause, by its kind."""
    return HINTS.get(cause.kind, LOGS)


def causes(recording: Recording) -> List[Note]:
    """Notes on what went wrong; that it sleeps, sends too much or starts without a terminal is no cause."""
    harmless = HARMLESS | OF_OTHERS
    if recording.ended and recording.ended.kind in RAN_ON:
        harmless.add(Kind.NODE_ENDED)
    return [note for note in recording.notes if note.kind not in harmless]


def is_nothing(largest: Optional[float]) -> bool:
    """Whether the largest of all commands [m/s, rad/s] moves nothing; not if it is unknown."""
    return largest is not None and largest <= MOVES_NOTHING


def is_up(recording: Recording) -> bool:
    """Whether a node of the submission was seen: it listens, or sends."""
    topics = (*recording.silent_topics, *recording.unread_topics, *recording.marker_topics)
    return recording.subscribed or bool(recording.command_count or topics)


def cause_of_silence(recording: Recording) -> Optional[Note]:
    """Cause for which a callback of the scans sends no marker: it raises, or never runs; None if unknown."""
    reasons = causes(recording)
    if reasons:
        return reasons[0]
    return None if recording.subscribed else first_cause(recording)


def first_cause(recording: Recording) -> Note:
    """Cause for which the robot stands: the first broken link of the chain node, scan, command."""
    silent, unread = ", ".join(recording.silent_topics), ", ".join(recording.unread_topics)
    reasons = causes(recording)
    if not recording.subscribed and silent and not reasons:
        return Note(Kind.SILENT_TOPIC, f"it listens to {silent}, where nothing is sent")
    if reasons:
        return reasons[0]
    if not is_up(recording) and (others := [note for note in recording.notes if note.kind in OF_OTHERS]):
        return others[0]
    if not recording.subscribed:
        return NO_SCANS
    if not recording.command_count and unread:
        return Note(Kind.UNREAD_COMMANDS, f"it sends its commands to {unread}, which has no subscriber")
    if not recording.command_count and recording.advertised:
        return Note(Kind.NO_COMMANDS, "nothing came on cmd_vel")
    if not recording.command_count:
        return Note(Kind.NO_PUBLISHER, "it advertises no cmd_vel")
    if recording.zero_count == recording.command_count:
        return Note(Kind.ZERO_COMMANDS, f"all {recording.command_count} commands were zero")
    if is_nothing(recording.fastest) and is_nothing(recording.sharpest):
        most = f"{recording.fastest:.1g} m/s and {recording.sharpest:.1g} rad/s"
        text = f"all {recording.command_count} commands are nearly zero, at most {most}"
        return Note(Kind.ZERO_COMMANDS, text)
    return Note(Kind.IN_SPITE_OF_COMMANDS, f"in spite of {recording.command_count} commands")


def cause_of_stop(recording: Recording) -> Optional[Note]:
    """Cause for which a robot stops on its way: its node ends, raises, or is silent; None: not known."""
    reasons = causes(recording)
    if reasons:
        return reasons[0]
    if not len(recording.commands) or recording.times[-1] - recording.commands[-1] < SILENT:
        return None
    last = float(recording.commands[-1])
    text = (
        f"{recording.command_count} commands, the last at {last:.2f} s, then none: its callback waits (for a "
        "service, in a loop or a sleep), takes a branch without one, or gets no scan"
    )
    return Note(Kind.COMMANDS_CEASE, text, last)


def behind(cause: Optional[Note]) -> str:
    """A cause as the end of a sentence; empty: it is not known."""
    return f"; {cause.text}" if cause else ""
