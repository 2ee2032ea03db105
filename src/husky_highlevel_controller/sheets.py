"""Judges recorded drives by the rubrics of exercises 2 and 5, as far as a machine can.

In: `Recording`s, and what RViz showed. Out: `Item`s; without points what a person has to look at.
Must not know: ROS, files.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import List, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.grading import Item, RvizView, judge_exercise_3
from husky_highlevel_controller.recording import Call, Recording

SAME = 0.02  # [m], a number printed this near to a range measured is that range
LEAST_LINES = 5  # with such a number
SPAN = 0.5  # of the change of the smallest range must be told
SETTLED, CALM = 1.5, 4.0  # [s], simulated, after a call: from when to when it is looked at
SLOW, FAST = 0.05, 0.1  # [m/s]: stands, drives

_NUMBER = re.compile(r"(?<![\w.])\d+\.\d+")
_PREFIX = re.compile(r"^\W*(?:\x1b\[\d*m)?\[[A-Z ]+\] \[[^\]]*\](?: \[[^\]]*\])?:?")  # of a line of a ROS log


# ---------------------------------------------------------------------------- exercise 2


def judge_output(recording: Recording) -> Item:
    """The smallest range is printed: 40, or 20 if it does not follow the drive."""
    item = Item("prints the smallest range", 0.0, 40.0, "")
    truth = recording.nearest[np.isfinite(recording.nearest[:, 1]), 1]
    if not recording.subscribed or not len(truth):
        why = recording.notes[0] if recording.notes else "nobody listens to the scans"
        return replace(item, evidence=f"nothing to print: {why}")
    low, high = float(truth.min()), float(truth.max())
    told = [value for line in recording.output.splitlines() for value in _ranges_in(line, low, high)]
    if len(told) < LEAST_LINES:
        words = f"{len(told)} lines with a range between {low:.2f} and {high:.2f} m, wanted {LEAST_LINES}"
        return replace(item, evidence=words)
    words = f"{len(told)} lines, from {told[0]:.2f} to {told[-1]:.2f} m; measured {high:.2f} to {low:.2f} m"
    follows = max(told) - min(told) >= SPAN * (high - low) and told[0] > told[-1]
    return replace(item, points=40.0 if follows else 20.0, evidence=words)


def _ranges_in(line: str, low: float, high: float) -> List[float]:
    numbers = [float(word) for word in _NUMBER.findall(_PREFIX.sub("", line))]
    return [number for number in numbers if low - SAME <= number <= high + SAME][:1]


def judge_parameters(recording: Recording) -> Item:
    """Topic name (8) and queue size (7) are parameters."""
    item = Item("parameters: topic name and queue size", 0.0, 15.0, "")
    points = 8.0 * bool(recording.topic_parameters) + 7.0 * bool(recording.queue_parameters)
    topic = ", ".join(recording.topic_parameters) or "no parameter is the scans' topic"
    queue = ", ".join(recording.queue_parameters) or "no whole number is called queue"
    return replace(item, points=points, evidence=f"{topic}; {queue}")


def judge_view(view: RvizView, scan_topic: str) -> Item:
    """RViz shows the scan (10) in odom (5)."""
    item = Item("RViz shows the laser scan in odom", 0.0, 15.0, "")
    if not view.judged:
        return replace(item, points=None, evidence=f"not judged: {view.problem}")
    if not view.source or view.problem:
        return replace(item, evidence=view.problem or "no RViz configuration")
    seen = view.scan and scan_topic in view.topics
    words = f"{view.source}: laser scan {'' if seen else 'not '}to be seen, fixed frame '{view.fixed_frame}'"
    return replace(item, points=(10.0 + 5.0 * (view.fixed_frame == "odom")) * seen, evidence=words)


# ---------------------------------------------------------------------------- exercise 5


def judge_calls(recording: Recording) -> List[Item]:
    """The service stops (50) and starts (50) the robot, again and again; half for once only."""
    stop, start = (
        Item("service stops the robot", 0.0, 50.0, ""),
        Item("service starts it again", 0.0, 50.0, ""),
    )
    if not recording.calls:
        why = (
            f"nobody called {recording.services[0]}" if recording.services else "no std_srvs/SetBool service"
        )
        if recording.notes:
            why += f": {recording.notes[0]}"
        return [replace(stop, evidence=why), replace(start, evidence=why)]
    return [
        _judge_effect(replace(item, evidence=recording.services[0]), effects, word)
        for item, effects, word in (
            (stop, _effects(recording, drives=False), "stands"),
            (start, _effects(recording, drives=True), "drives"),
        )
    ]


def _effects(recording: Recording, drives: bool) -> List[Tuple[Call, float, bool]]:
    """Calls that are to start or to stop the robot: the speed afterwards, and whether that is right."""
    speeds = [_speed_after(recording, call) for call in recording.calls]
    # which of the two values starts is the submission's choice
    mean = {
        data: np.mean([s for s, c in zip(speeds, recording.calls) if c.data is data] or [0.0])
        for data in (False, True)
    }
    starts = bool(mean[True] >= mean[False])
    return [
        (call, speed, speed >= FAST if drives else speed <= SLOW)
        for call, speed in zip(recording.calls, speeds)
        if (call.data is starts) == drives
    ]


def _speed_after(recording: Recording, call: Call) -> float:
    when = (recording.times >= call.at + SETTLED) & (recording.times <= call.at + CALM)
    return float(np.abs(recording.speeds[when, 0]).max()) if when.any() else 0.0


def _judge_effect(item: Item, effects: Sequence[Tuple[Call, float, bool]], word: str) -> Item:
    good = sum(right for _, _, right in effects)
    words = f"{item.evidence}: {word} after {good} of {len(effects)} calls"
    at = effects[0][0].at if effects else None
    wrong = next(((call, speed) for call, speed, right in effects if not right), None)
    if wrong:
        call, speed = wrong
        at = call.at
        words += f"; after {str(call.data).lower()} at {call.at:.2f} s it drives at {speed:.2f} m/s"
        words += f" ({call.answer})" * (not call.success and bool(call.answer))
    points = item.most if good and good == len(effects) else item.most / 2.0 if good else 0.0
    return replace(item, points=points, evidence=words, at=at)


# ---------------------------------------------------------------------------- all exercises


def judge(exercise: int, recordings: Sequence[Recording], view: RvizView, scan_topic: str) -> List[Item]:
    """Every line of an exercise's table."""
    if exercise == 2:
        by_hand = "for a person: is it built like the template?"
        return [
            judge_output(recordings[0]),
            Item("style of the template", None, 30.0, by_hand),
            judge_parameters(recordings[0]),
            judge_view(view, scan_topic),
        ]
    if exercise == 5:
        by_hand = "for a person: a node of its own"
        stop, start = judge_calls(recordings[0])
        if stop.points and not start.points and not _ever_drives(recordings[0]):
            stop = replace(stop, points=0.0, evidence="it never drives, so it cannot be stopped")
        return [
            stop,
            start,
            Item("bonus: stops before a crash", None, 25.0, by_hand),
            Item("bonus: stops after a crash", None, 25.0, by_hand),
        ]
    return judge_exercise_3(recordings, view, scan_topic)


def _ever_drives(recording: Recording) -> bool:
    return bool((np.abs(recording.speeds[:, 0]) > FAST).any())
