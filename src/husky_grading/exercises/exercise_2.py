"""Exercise 2: prints the smallest range, has parameters, shows the scan in RViz, while the robot drives."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from husky_grading.displays import SCAN, RvizView
from husky_grading.exercises.exercise import Exercise
from husky_grading.exercises.watch import DriveState, RosAccess, Watch
from husky_grading.notes import Kind, Note, Subject
from husky_grading.recording import Recording
from husky_grading.records import DEFAULT_RULES, Item, Rules
from husky_grading.rubrics.causes import NO_SCANS, causes, with_cause
from husky_grading.rubrics.items import forfeited, weighted
from husky_grading.rubrics.rviz_view import (
    SAVED,
    find_display_fault,
    hint_on_view,
    without_config,
)
from husky_highlevel_controller.config import to_plain

ITEMS = (
    "prints the smallest range",
    "style of the template",
    "parameters: topic name and queue size",
    "RViz shows the laser scan in odom",
)
SAME = 0.02  # [m], a number printed this near to a range measured is that range
LEAST_LINES = 5  # with such a number
SPAN = 0.5  # of the change of the smallest range must be printed
SPEED, BEGIN, SECONDS = 0.5, 2.0, 10.0  # [m/s], [s], [s] of the drive; the submission does not drive
STANDS_BY = BEGIN + SECONDS + 1.0  # [s], simulated
# hints
PRINT = "print the smallest range in the scans' callback, by ROS_INFO or rospy.loginfo, with output=screen"
MINIMUM = (
    "take the smallest of the ranges that are valid (range_min <= r <= range_max), again in each callback"
)
PARAMETERS = "read both as private parameters of the node, from the launch file or its YAML file"

_QUEUE = re.compile("queue", re.IGNORECASE)
_NUMBER = re.compile(r"(?<![\w.])\d+\.\d+")
_PREFIX = re.compile(r"^\W*(?:\x1b\[\d*m)?\[[A-Z ]+\] \[[^\]]*\](?: \[[^\]]*\])?:?")  # of a line of a ROS log


@dataclass(frozen=True)
class ReadParameters:
    """Parameters of the submission that the exercise asks for, by their full names."""

    topics: Tuple[str, ...] = ()  # whose value is the topic of the scans
    queues: Tuple[str, ...] = ()  # whole numbers that are called ...queue...


class StraightDrive(Watch):
    """Drives the robot ahead while the submission prints."""

    def __init__(self, known: Recording, ros: RosAccess) -> None:
        super().__init__(known, ros)
        ros.advertise_commands()

    def takes_part(self, state: DriveState) -> bool:
        """Whether it listens to the scans; it sends no command."""
        return state.subscribed

    def on_scan(self, stamp: float) -> None:
        """Command the speed that is due."""
        self._ros.command(SPEED if BEGIN <= stamp < BEGIN + SECONDS else 0.0)

    def look(self, state: DriveState) -> Optional[Note]:
        """Return why the drive is over: the robot has driven and stands. None if the drive goes on."""
        if state.now > STANDS_BY:
            return Note(Kind.PLAN_DONE, "the drive of the marking")
        return super().look(state)

    def kept(self) -> Dict[str, Any]:
        """Parameters, at the end of the drive."""
        values, topic = sorted(self._ros.parameters().items()), self._known.scan_topic
        topics = [
            name for name, value in values if isinstance(value, str) and f"/{value.lstrip('/')}" == topic
        ]
        queues = [name for name, value in values if isinstance(value, int) and _QUEUE.search(name)]
        plain: Dict[str, Any] = to_plain(ReadParameters(tuple(topics), tuple(queues)))
        return plain


def judge_output(recording: Recording) -> Item:
    """The smallest range is printed: 40, or 20 if it does not follow the drive."""
    item = Item(ITEMS[0], 0.0, 40.0, "")
    truth = recording.nearest[np.isfinite(recording.nearest[:, 1]), 1]
    if not recording.subscribed or not len(truth):
        return with_cause(item, "nothing to print", (causes(recording) or [NO_SCANS])[0])
    low, high = float(truth.min()), float(truth.max())
    printed = [value for line in recording.output.splitlines() for value in _ranges_in(line, low, high)]
    if len(printed) < LEAST_LINES:
        evidence = (
            f"{len(printed)} lines with a range between {low:.2f} and {high:.2f} m, wanted {LEAST_LINES}"
        )
        numbers = any(_NUMBER.search(_PREFIX.sub("", line)) for line in recording.output.splitlines())
        return replace(item, evidence=evidence, hint=MINIMUM if numbers else PRINT)
    evidence = f"{len(printed)} lines, from {printed[0]:.2f} to {printed[-1]:.2f} m; "
    evidence += f"measured {high:.2f} to {low:.2f} m"
    follows = max(printed) - min(printed) >= SPAN * (high - low) and printed[0] > printed[-1]
    return replace(item, points=40.0 if follows else 20.0, evidence=evidence, hint=MINIMUM)


def _ranges_in(line: str, low: float, high: float) -> List[float]:
    numbers = [float(word) for word in _NUMBER.findall(_PREFIX.sub("", line))]
    return [number for number in numbers if low - SAME <= number <= high + SAME][:1]


def judge_parameters(recording: Recording) -> Item:
    """Topic name (8) and queue size (7) are parameters."""
    read = recording.watched_as(ReadParameters)
    points = (8.0 if read.topics else 0.0) + (7.0 if read.queues else 0.0)
    topic = ", ".join(read.topics) or "no parameter is the scans' topic"
    queue = ", ".join(read.queues) or "no whole number is called queue"
    return Item(ITEMS[2], points, 15.0, f"{topic}; {queue}", hint=PARAMETERS)


def judge_view(view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES) -> Item:
    """RViz shows the scan (10) in odom (5)."""
    item = Item(ITEMS[3], 0.0, 15.0, "", subject=Subject.DISPLAYS)
    if not view.source:
        return without_config(item, view, rules)
    if view.problem:
        return replace(item, evidence=view.problem, hint=hint_on_view(view))
    if not (view.scan and scan_topic in view.topics):
        evidence, hint = find_display_fault(view, SCAN, scan_topic)
        return replace(item, evidence=f"{view.source}: {evidence}", hint=f"{hint}, {SAVED}")
    evidence = f"{view.source}: laser scan to be seen, fixed frame '{view.fixed_frame}'"
    points = 10.0 + 5.0 * (view.fixed_frame == "odom")
    return replace(item, points=points, evidence=evidence, hint=f"set the fixed frame to odom, {SAVED}")


def judge_exercise_2(
    recordings: Sequence[Recording], view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Items of exercise 2: 40, 30 by hand, 15 and 15."""
    items = [
        judge_output(recordings[0]),
        Item(ITEMS[1], None, 30.0, "for a person: is it built like the template?"),
        judge_parameters(recordings[0]),
        judge_view(view, scan_topic, rules),
    ]
    return weighted(forfeited(items, recordings), rules)


EXERCISE = Exercise(ITEMS, judge_exercise_2, pace=1.0, deadline=60.0, watch=StraightDrive)
