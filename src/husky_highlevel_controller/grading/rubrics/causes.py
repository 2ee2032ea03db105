"""Causes for which a robot stands or stops, by a drive's recording, and hints by their kind."""

from __future__ import annotations

from dataclasses import replace
from typing import List, Optional

from husky_highlevel_controller.grading.notes import Kind, Note
from husky_highlevel_controller.grading.recording import Recording
from husky_highlevel_controller.grading.records import Item

SILENT = 5.0  # [s], simulated: so long without a command, it has ceased to send any
NO_SCANS = Note(Kind.NO_SCANS, "it does not subscribe to the scans")
LOGS = "read what your node prints, and see whether your launch file starts it"
ENDS = "the last line of its output says why"
HINTS = {
    Kind.OWN_NODE: "start a node of your own package",
    Kind.SILENT_TOPIC: "compare your topic's name with `rostopic list`, and look for a missing remap",
    Kind.NO_SCANS: "subscribe to the scans, in the constructor",
    Kind.NO_PUBLISHER: "make a publisher of geometry_msgs/Twist on /cmd_vel, in the constructor",
    Kind.NO_COMMANDS: "publish the velocity in the scans' callback, before any service is called",
    Kind.UNREAD_COMMANDS: "publish on /cmd_vel, or remap your topic to it",
    Kind.ZERO_COMMANDS: "a gain of 0, a parameter that is not loaded, or a service that must be called first",
    Kind.EXCEPTION: "the line named is where it happens",
    Kind.NODE_FAILED: ENDS,
    Kind.NODE_ENDED: ENDS,
    Kind.COMMANDS_CEASE: "the branch that your callback takes at that moment, and what it waits for",
    Kind.BUILD: "mend this error first: nothing can be started without it; others may follow from it",
}
# notes that are no cause
HARMLESS = {Kind.ROBOT, Kind.UNANSWERED_SCANS, Kind.FLOOD, Kind.LAUNCH_PREFIX, Kind.UNREADABLE}
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
    harmless = set(HARMLESS)
    if recording.ended and recording.ended.kind in RAN_ON:
        harmless.add(Kind.NODE_ENDED)
    return [note for note in recording.notes if note.kind not in harmless]


def first_cause(recording: Recording) -> Note:
    """Cause for which the robot stands: the first broken link of the chain node, scan, command."""
    silent, unread = ", ".join(recording.silent_topics), ", ".join(recording.unread_topics)
    reasons = causes(recording)
    if not recording.subscribed and silent and not reasons:
        return Note(Kind.SILENT_TOPIC, f"it listens to {silent}, where nothing is sent")
    if reasons:
        return reasons[0]
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
