"""Judges markers: whether what RViz draws for a topic and namespace is at the pillar, at each moment."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import groupby
from math import hypot
from typing import Dict, List, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.course import PILLAR_RADIUS
from husky_highlevel_controller.grading.drive.recording import (
    ADD,
    DELETE,
    DELETE_ALL,
    MarkerSample,
    Recording,
)
from husky_highlevel_controller.grading.records import Rules

HEIGHT_MARGIN = 0.3  # [m], above and below the pillar
LARGEST = 1.0  # [m], the middle of a shape that touches the pillar is no farther away
MOST = 0.5  # of what is drawn in a namespace must be right at a moment
MAX_SERIES = 6  # topics and namespaces that are judged apart; where more came, all that is drawn is judged
FULL, HALF, WRONG = 1.0, 0.5, 0.0
Key = Tuple[str, str, int]  # topic, namespace, id


@dataclass(frozen=True)
class Shares:
    """How much of a drive one namespace's markers were right, and a sentence about it."""

    full: float  # of the moments at which something came
    half: float  # at least half right
    evidence: str
    at: float  # [s], when it was first right, or first wrong

    @property
    def order(self) -> Tuple[float, float]:
        """The best namespace counts."""
        return (self.full, self.half)


@dataclass
class _Drawn:
    """What RViz draws of a namespace: the latest of each id until it is deleted or its lifetime ends."""

    verdicts: Dict[Key, Tuple[float, float]] = field(default_factory=dict)  # (verdict, end of life [s])
    full: int = 0
    near: int = 0

    def put(self, key: Key, verdict: float, until: float) -> None:
        self.remove(key)
        self.verdicts[key] = (verdict, until)
        self.full += verdict == FULL
        self.near += verdict >= HALF

    def remove(self, key: Key) -> None:
        verdict, _ = self.verdicts.pop(key, (WRONG, 0.0))
        self.full -= verdict == FULL
        self.near -= verdict >= HALF

    def clear(self, topic: str) -> None:
        for key in [key for key in self.verdicts if key[0] == topic]:
            self.remove(key)

    def expire(self, now: float, mortal: Sequence[Key]) -> None:
        for key in mortal:
            if key in self.verdicts and self.verdicts[key][1] <= now:
                self.remove(key)


def judge_namespaces(recording: Recording, until: float, rules: Rules) -> List[Shares]:
    """One verdict for each topic and namespace that sent markers before a moment [s].

    One of many guesses is right by chance: beyond MAX_SERIES there is one verdict, on all that is drawn.
    """
    markers = [marker for marker in recording.markers if marker.at < until]
    series: Dict[Tuple[str, str], List[MarkerSample]] = defaultdict(list)
    for marker in markers:
        if marker.action == ADD:
            series[marker.topic, marker.namespace] = []
    if len(series) > MAX_SERIES:
        return [_judge(recording, markers, rules)]
    for marker in markers:
        for (topic, namespace), members in series.items():
            # `delete all` empties the whole display of a topic
            if marker.topic == topic and (marker.namespace == namespace or marker.action == DELETE_ALL):
                members.append(marker)
    return [_judge(recording, members, rules) for members in series.values()]


def _judge(recording: Recording, markers: Sequence[MarkerSample], rules: Rules) -> Shares:
    added = [marker for marker in markers if marker.action == ADD]
    first = added[0]
    name = f"{first.topic} in {first.frame}{', stamp 0' if first.stamp == 0.0 else ''}"
    lost = [marker for marker in added if marker.problem]
    if len(lost) == len(added):
        return Shares(0.0, 0.0, f"{name}: not to be seen: {lost[0].problem}", lost[0].at)
    verdicts = {id(marker): verdict(recording, marker, rules) for marker in added}
    moments = _moments(markers, verdicts)
    full = sum(grade == FULL for _, grade in moments) / len(moments)
    half = sum(grade >= HALF for _, grade in moments) / len(moments)
    distances = [_distance(recording, marker) for marker in added if not marker.problem]
    words = f"{name}: right {100.0 * full:.0f} % of the time"
    words += f", {np.median(distances):.2f} m from the pillar's axis (median)"
    crowd = len({(marker.topic, marker.namespace, marker.id) for marker in added})
    groups = len({(marker.topic, marker.namespace) for marker in added})
    wrong = next((marker for marker in added if verdicts[id(marker)] < FULL), None)
    if wrong is None:
        return Shares(full, half, words, added[0].at)
    if half > full:
        words += f"; near it {100.0 * half:.0f} %"
    words += f"; at {wrong.at:.2f} s {_fault(recording, wrong)}"
    if crowd > 1:
        where = f"namespace '{first.namespace}'" if groups == 1 else f"{groups} topics and namespaces"
        words += f"; {crowd} markers in {where}, half of those drawn must be right"
    return Shares(full, half, words, wrong.at)


def _moments(markers: Sequence[MarkerSample], verdicts: Dict[int, float]) -> List[Tuple[float, float]]:
    """(when [s], verdict on all that is drawn), for each moment at which something came."""
    drawn, moments = _Drawn(), []
    mortal: List[Key] = []  # markers with a lifetime
    for at, group in groupby(markers, key=lambda marker: marker.at):
        drawn.expire(at, mortal)
        mortal = [key for key in mortal if key in drawn.verdicts]
        came = False
        for marker in group:
            key = (marker.topic, marker.namespace, marker.id)
            if marker.action == ADD:
                came = True
                drawn.put(key, verdicts[id(marker)], marker.until)
                if marker.until < np.inf:
                    mortal.append(key)
            elif marker.action == DELETE:
                drawn.remove(key)
            else:
                drawn.clear(marker.topic)
        if came and drawn.verdicts:
            wanted = MOST * len(drawn.verdicts)
            moments.append((at, FULL if drawn.full >= wanted else HALF if drawn.near >= wanted else WRONG))
    return moments


def verdict(recording: Recording, marker: MarkerSample, rules: Rules) -> float:
    """Whether one marker is at the pillar (1), near it or touching it (0.5), or neither (0)."""
    size = recording.pillar_size
    if marker.problem or not _level(marker, size.height):
        return WRONG
    slack = rules.marker_per_metre * _robot_distance(recording, marker.at)
    slack += size.radius - PILLAR_RADIUS  # a thicker pillar's near side is as right
    distance = _distance(recording, marker)
    if distance <= rules.marker_full + slack:
        return FULL
    touches = marker.reach <= size.radius and distance <= LARGEST + size.radius - PILLAR_RADIUS
    return HALF if touches or distance <= rules.marker_half + slack else WRONG


def _level(marker: MarkerSample, height: float) -> bool:
    return marker.low <= height + HEIGHT_MARGIN and marker.high >= -HEIGHT_MARGIN


def _distance(recording: Recording, marker: MarkerSample) -> float:
    x, y = recording.pillar
    return hypot(marker.position[0] - x, marker.position[1] - y)


def _robot_distance(recording: Recording, at: float) -> float:
    row = min(int(np.searchsorted(recording.times, at)), len(recording.times) - 1)
    x, y = recording.pillar
    return hypot(x - float(recording.poses[row, 0]), y - float(recording.poses[row, 1]))


def _fault(recording: Recording, marker: MarkerSample) -> str:
    """Which coordinate of a marker is wrong."""
    if marker.problem:
        return f"not to be seen: {marker.problem}"
    x, y = recording.pillar
    px, py, pz = marker.position
    words = f"at ({px:.2f}, {py:.2f}, {pz:.2f}), the pillar at ({x:.2f}, {y:.2f})"
    height = recording.pillar_size.height
    if not _level(marker, height):
        return (
            f"{words}: z is wrong, it is drawn from {marker.low:.2f} to {marker.high:.2f} m,"
            f" the pillar from 0 to {height:g} m"
        )
    dx, dy = px - x, py - y
    which = "x" if abs(dx) > 2.0 * abs(dy) else "y" if abs(dy) > 2.0 * abs(dx) else "x and y"
    return (
        f"{words}: {which} off by {abs(dx):.2f} m and {abs(dy):.2f} m"
        if which == "x and y"
        else (f"{words}: {which} off by {max(abs(dx), abs(dy)):.2f} m")
    )
