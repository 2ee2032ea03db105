"""Exercise 2: a node prints the smallest range and has parameters, RViz shows the scan; the grader drives."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from husky_grading.displays import SCAN, RvizView
from husky_grading.exercises.exercise import Exercise
from husky_grading.exercises.watch import DriveState, RosAccess, Watch
from husky_grading.notes import Kind, Note, Subject
from husky_grading.recording import Recording
from husky_grading.records import DEFAULT_RULES, Item, Rules
from husky_grading.rubrics.causes import causes, first_cause, with_cause
from husky_grading.rubrics.items import by_hand, forfeited, weighted
from husky_grading.rubrics.rviz_view import (
    SAVED,
    find_display_fault,
    hint_on_view,
    without_config,
)
from husky_highlevel_controller.config import to_plain

PRINTS_RANGE = "prints the smallest range"
FOLLOWS_TEMPLATE = "style of the template"
HAS_PARAMETERS = "parameters: topic name and queue size"
SHOWS_SCAN = "RViz shows the laser scan in odom"
ITEMS = (PRINTS_RANGE, FOLLOWS_TEMPLATE, HAS_PARAMETERS, SHOWS_SCAN)
# [m] tolerance when a printed number is compared with the smallest ranges that the lidar measured
TOLERANCE = 0.02
# the item gets points only if at least this number of printed lines show the smallest range of a scan
LEAST_LINES = 5
# A line with more numbers than this is a list of all ranges. Such a line does not count, because it always
# has the smallest range. A line with the smallest range, its position and angle, limits and speeds has fewer
# numbers.
MOST_NUMBERS = 10
# [s] a line may print the smallest range of a scan that is older than the line by up to this simulated time,
# because a slow node with a long queue of scans prints late
LATEST = 1.0
# [s] a line may print the smallest range of a scan that is newer than the line's stamp by up to this
# simulated time, because the stamp has only the resolution of /clock
STAMP_TOLERANCE = 0.05
# [m] A number that differs from the smallest range by more than TOLERANCE, but by less than NEAR, counts as a
# wrong smallest range, such as another range of the pillar. Other numbers have another meaning, such as a
# speed.
NEAR = 0.5
# all points are given only if the printed numbers change by at least this fraction of the change of the
# smallest range
SPAN_FRACTION = 0.5
# `grade` drives the robot straight ahead: speed [m/s], begin and duration in simulated time [s]
SPEED, BEGIN, SECONDS = 0.5, 2.0, 10.0
STANDS_BY = BEGIN + SECONDS + 1.0  # [s] simulated time at which the robot has stopped, so the run ends
NO_RANGE = Note(Kind.NO_RANGE, "no beam of any scan measured a range")
# hints
PRINT = (
    "print the smallest range in the callback of the scans, by ROS_INFO or rospy.loginfo, with output=screen"
)
MINIMUM = "in each callback, take the smallest of the valid ranges (range_min <= r <= range_max)"
PARAMETERS = "read both as private parameters of the node, from the launch file or its YAML file"

_QUEUE = re.compile("queue", re.IGNORECASE)
_NUMBER = re.compile(r"(?<![\w.])\d+\.\d+")
# pattern of a number, or of inf or nan, which are the ranges of beams without a return
_RANGE = re.compile(r"(?<![\w.])(?:\d+\.\d+|inf\b|nan\b)", re.IGNORECASE)
# pattern of the beginning of a line in a ROS log, such as "[ INFO] [17.5, 2.0]:". Its numbers are not ranges;
# the second number is the simulated time.
_PREFIX = re.compile(
    r"^\W*(?:\x1b\[\d*m)?\[[A-Z ]+\] \[(?:[\d.]+, (?P<stamp>\d+\.\d+)|[^\]]*)\](?: \[[^\]]*\])?:?"
)


@dataclass(frozen=True)
class ReadParameters:
    """Parameters of the submission that the exercise asks for, by their full names."""

    topics: Tuple[str, ...] = ()  # names of private parameters whose value is the topic of the scans
    # names of private parameters that have "queue" in their name and a whole number as their value
    queues: Tuple[str, ...] = ()


class StraightDrive(Watch):
    """Drives the robot ahead while the submission prints."""

    def __init__(self, initial: Recording, ros: RosAccess) -> None:
        super().__init__(initial, ros)
        ros.advertise_commands()

    def is_submission_ready(self, state: DriveState) -> bool:
        """Return whether the submission subscribes to the scans; it need not send commands."""
        return state.subscribed

    def on_scan(self, stamp: float) -> None:
        """Command the speed at the time of a scan [s]: SPEED during the drive, otherwise 0."""
        self._ros.command(SPEED if BEGIN <= stamp < BEGIN + SECONDS else 0.0)

    def look(self, state: DriveState) -> Optional[Note]:
        """Return why the run is over: the robot has driven and stands. None if it goes on."""
        if state.now > STANDS_BY:
            return Note(Kind.PLAN_DONE, f"the grader has driven it for {SECONDS:g} s")
        return super().look(state)

    def kept(self) -> Dict[str, Any]:
        """Return the names of the parameters that the exercise asks for, as plain values for the recording.

        The student chooses the names. A parameter counts as the topic name if its value is the topic of the
        scans. It counts as the queue size if it is a whole number and its name contains "queue". The <param>
        tag may stand in the <node> tag or outside of it.
        """
        scan_topic = self._initial_recording.scan_topic
        topics, queues = [], []
        for name, value in sorted(self._ros.parameters().items()):
            if isinstance(value, str) and f"/{value.lstrip('/')}" == scan_topic:
                topics.append(name)
            # no `isinstance`, because a bool is an int in Python, too
            if type(value) is int and _QUEUE.search(name):
                queues.append(name)
        plain: Dict[str, Any] = to_plain(ReadParameters(tuple(topics), tuple(queues)))
        return plain


class PrintedLine(NamedTuple):
    """Line of the output that has decimal numbers."""

    numbers: List[float]
    stamp: Optional[float]  # [s] simulated time at which the line was printed; None if it has no such stamp
    is_list: bool  # true if the line has more than MOST_NUMBERS values; inf and nan count as values


def read_lines(output: str) -> List[PrintedLine]:
    """Return the lines of an output that have decimal numbers; stamps of the ROS log do not count."""
    lines = []
    for text in output.splitlines():
        stamp, printed = None, text
        prefix = _PREFIX.match(text)
        if prefix:
            printed = text[prefix.end() :]
            if prefix["stamp"]:
                stamp = float(prefix["stamp"])
        numbers = [float(word) for word in _NUMBER.findall(printed)]
        if numbers:
            is_list = len(_RANGE.findall(printed)) > MOST_NUMBERS
            lines.append(PrintedLine(numbers, stamp, is_list))
    return lines


def smallest_ranges(nearest: NDArray[np.float64], stamp: Optional[float]) -> Tuple[float, float]:
    """Return the lowest and the highest smallest range [m] of the scans that may have caused a printed line.

    Each scan has one smallest range. Any scan of the last LATEST seconds may have caused the line. If there
    was no such scan, both values are nan.

    Args:
        nearest: (N, 2) time [s] and smallest range [m] of each scan, sorted by time.
        stamp: simulated time [s] at which the line was printed. If it is None, the time is unknown, so
            any scan of the run may have caused the line.
    """
    ranges = nearest[:, 1]
    if stamp is not None:
        first, end = np.searchsorted(nearest[:, 0], [stamp - LATEST, stamp + STAMP_TOLERANCE])
        ranges = ranges[first:end]
    if not len(ranges):
        return np.nan, np.nan
    return float(ranges.min()), float(ranges.max())


class PrintedRanges(NamedTuple):
    """Numbers in the lines of an output, compared with the smallest ranges of the scans."""

    right: List[float]  # [m] smallest range of each line that has one, in the order of the lines
    # [m] Wrong numbers near the smallest range, printed while the robot stood. All scans of a standing robot
    # have the same smallest range, so these numbers are not only late.
    wrong_at_rest: List[float]
    is_right_at_rest: bool  # true if a line printed the smallest range while the robot stood


def compare_with_scans(lines: Sequence[PrintedLine], nearest: NDArray[np.float64]) -> PrintedRanges:
    """Return which numbers of the lines are smallest ranges of scans, and which are wrong smallest ranges.

    Args:
        lines: lines of the output; lists of ranges do not count.
        nearest: (N, 2) time [s] and smallest range [m] of each scan, sorted by time.
    """
    all_right: List[float] = []
    wrong_at_rest: List[float] = []
    is_right_at_rest = False
    for line in lines:
        if line.is_list:
            continue
        low, high = smallest_ranges(nearest, line.stamp)
        right = [number for number in line.numbers if low - TOLERANCE <= number <= high + TOLERANCE]
        # a line counts once, even if another of its numbers is also in this interval by chance
        all_right += right[:1]
        # While the robot stands, all scans have nearly the same smallest range, so `low` nearly equals
        # `high`. Without a stamp, `low` and `high` are from the whole run.
        is_at_rest = line.stamp is not None and high - low <= TOLERANCE
        if is_at_rest:
            smallest = high
            is_right_at_rest = is_right_at_rest or bool(right)
            wrong_at_rest += [number for number in line.numbers if TOLERANCE < abs(number - smallest) < NEAR]
    return PrintedRanges(all_right, wrong_at_rest, is_right_at_rest)


def judge_output(recording: Recording) -> Item:
    """Grade whether the submission prints the smallest range: 40 points.

    It gets 20 points if the printed numbers do not decrease while the robot drives towards the pillar.
    """
    item = Item(PRINTS_RANGE, 0.0, 40.0, "")
    # (N, 2) [s, m] time and smallest range of each scan; a scan without a return has no smallest range
    nearest = recording.nearest[np.isfinite(recording.nearest[:, 1])]
    if not recording.subscribed:
        return with_cause(item, "nothing to print", first_cause(recording))
    if not len(nearest):
        reasons = causes(recording)  # such as an exception, which ended the run before the first scan
        return with_cause(item, "nothing to print", reasons[0] if reasons else NO_RANGE)

    lines = read_lines(recording.output)
    printed = compare_with_scans(lines, nearest)
    low, high = smallest_ranges(nearest, stamp=None)  # over the whole run
    if len(printed.right) < LEAST_LINES:
        evidence = f"{len(printed.right)} lines have a range between {low:.2f} and {high:.2f} m, "
        evidence += f"{LEAST_LINES} must"
        lists = sum(line.is_list for line in lines)  # number of lines that are lists of ranges
        if lists:
            evidence += f"; {lists} lines with more than {MOST_NUMBERS} numbers do not count"
        # if there are lines with numbers, the student does not take the minimum of the valid ranges
        return replace(item, evidence=evidence, hint=MINIMUM if lines else PRINT)
    # if the right range was printed while the robot stood, the wrong numbers are another quantity
    if len(printed.wrong_at_rest) >= LEAST_LINES and not printed.is_right_at_rest:
        evidence = f"prints {printed.wrong_at_rest[0]:.2f} m while the robot stands, "
        evidence += f"but the smallest range is {high:.2f} m"
        return replace(item, evidence=evidence, hint=MINIMUM)

    first, last = printed.right[0], printed.right[-1]
    evidence = f"{len(printed.right)} lines, from {first:.2f} to {last:.2f} m; "
    evidence += f"measured {high:.2f} to {low:.2f} m"
    # the robot drives towards the pillar, so the printed numbers must decrease, as the smallest range does
    change = max(printed.right) - min(printed.right)
    follows_range = last < first and change >= SPAN_FRACTION * (high - low)
    # `weighted` later removes the hint of an item with all points
    return replace(item, points=40.0 if follows_range else 20.0, evidence=evidence, hint=MINIMUM)


def judge_parameters(recording: Recording) -> Item:
    """Grade whether topic name (8 points) and queue size (7 points) are parameters."""
    read = recording.watched_as(ReadParameters)
    points = (8.0 if read.topics else 0.0) + (7.0 if read.queues else 0.0)
    topic = ", ".join(read.topics) or "no parameter has the topic of the scans"
    queue = ", ".join(read.queues) or "no parameter with a whole number is called queue"
    return Item(HAS_PARAMETERS, points, 15.0, f"{topic}; {queue}", hint=PARAMETERS)


def judge_view(view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES) -> Item:
    """Grade whether RViz shows the scan (10 points) in odom (5 points)."""
    item = Item(SHOWS_SCAN, 0.0, 15.0, "", subject=Subject.DISPLAYS)
    if not view.source:
        return without_config(item, view, rules)
    if view.problem:
        return replace(item, evidence=view.problem, hint=hint_on_view(view))
    if not (view.scan and scan_topic in view.topics):
        evidence, hint = find_display_fault(view, SCAN, scan_topic)
        return replace(item, evidence=f"{view.source}: {evidence}", hint=f"{hint}, {SAVED}")
    evidence = f"{view.source}: laser scan visible, fixed frame '{view.fixed_frame}'"
    points = 15.0 if view.fixed_frame == "odom" else 10.0
    # `weighted` later removes the hint of an item with all points
    return replace(item, points=points, evidence=evidence, hint=f"set the fixed frame to odom, {SAVED}")


def judge_exercise_2(
    recordings: Sequence[Recording], view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Return the items of exercise 2; 30 of the 100 points are given by hand."""
    recording = recordings[0]  # this exercise has a single run
    items = [
        judge_output(recording),
        Item(FOLLOWS_TEMPLATE, None, 30.0, by_hand("does the package follow the template")),
        judge_parameters(recording),
        judge_view(view, scan_topic, rules),
    ]
    # `forfeited` takes the points of a submission that has interfered with the simulator, and `weighted`
    # applies the weights of the teacher's rubric
    return weighted(forfeited(items, recordings), rules)


EXERCISE = Exercise(ITEMS, judge_exercise_2, pace=1.0, deadline=60.0, watch=StraightDrive)
