"""Items of several drives: their mean, and none of their points for a submission that interfered."""

from __future__ import annotations

from dataclasses import replace
from typing import Dict, List, Sequence

import numpy as np

from husky_grading.notes import Subject
from husky_grading.recording import Recording
from husky_grading.records import Item, Rules

INITIALISE = "give each member a value in the constructor"


def over_trials(items: Sequence[Item], other_worlds: float) -> Item:
    """Points of all drives together, with the evidence of the worst; a person's where one drive is.

    Args:
        items: of each drive; the first is in the course's world.
        other_worlds: what the further drives weigh together, 0 to 1.
    """
    scores = [-1.0 if item.points is None else item.points for item in items]
    number = scores.index(min(scores))
    worst = items[number]
    if len(items) == 1 or worst.points is None:
        return worst
    first, *further = scores
    mean = float(np.mean(further))
    points = round((1.0 - other_worlds) * first + other_worlds * mean, 1)
    evidence = f"{worst.evidence}; likewise in {len(further)} other worlds"
    if max(scores) > min(scores):
        evidence = (
            f"{worst.evidence} (drive {number + 1}; of {worst.max_points:g} points {first:g} in the course's"
        )
        evidence += f" world, {round(mean, 1):g} in {len(further)} others)"
    return replace(worst, points=points, evidence=evidence, drive=number + 1)


def forfeited(items: Sequence[Item], recordings: Sequence[Recording]) -> List[Item]:
    """Without points where a submission interfered with the simulator or the recording."""
    violations = list(dict.fromkeys(each for recording in recordings for each in recording.violations))
    if not violations:
        return list(items)
    evidence = f"no points: {'; '.join(violations)}"
    hint = "read scans and TF, and send commands, markers and services: nothing else is a controller's"
    return [
        item if item.points is None else replace(item, points=0.0, evidence=evidence, hint=hint)
        for item in items
    ]


def left_to_chance(items: Sequence[Item], cause: str) -> List[Item]:
    """Items of a submission whose behaviour is chance: a person judges what was driven."""
    judged, reason, first = [], f"{cause}, so that it drives by chance", [INITIALISE]
    for item in items:
        if item.points is not None and item.subject is not Subject.DISPLAYS:
            evidence = f"for a person: {reason}; in our drive: {item.evidence} ({item.points:g} points)"
            hint = "; then ".join(filter(None, [*first, item.hint]))
            item = replace(item, points=None, evidence=evidence, hint=hint)
            reason, first = "by chance, as above", []
        judged.append(item)
    return judged


def left_to_choice(items: Sequence[Item], launch_files: Sequence[str]) -> List[Item]:
    """Items of which a person judges those that lost points by the first of several equal launch files."""
    started, *others = launch_files
    reason = f"its launch files {started} and {', '.join(others)} fit alike, and {started} was started"
    judged = []
    for item in items:
        if item.points is not None and not item.full:
            evidence = f"for a person: {reason}: {item.evidence} ({item.points:g} points)"
            item, reason = replace(item, points=None, evidence=evidence), "by this choice"
        judged.append(item)
    return judged


def told_once(items: Sequence[Item]) -> List[Item]:
    """Items, of which a later one with an earlier one's hint refers to that one."""
    first: Dict[str, str] = {}
    return [
        replace(item, hint=f"the same as for '{first[item.hint]}'")
        if item.hint and first.setdefault(item.hint, item.name) != item.name
        else item
        for item in items
    ]


def weighted(items: Sequence[Item], rules: Rules) -> List[Item]:
    """Items with the teacher's weights, without points where a person judges."""
    return [
        replace(each, hint="") if each.full and each.points is not None else each
        for each in (_weighted(item, rules) for item in items)
    ]


def _weighted(item: Item, rules: Rules) -> Item:
    weight = rules.weights.get(item.name, item.max_points)
    if item.name in rules.by_person:
        return replace(item, points=None, max_points=weight, evidence=f"for a person: {item.evidence}")
    if item.points is None or weight == item.max_points:
        return replace(item, max_points=weight)
    return replace(item, points=round(item.points * weight / item.max_points, 1), max_points=weight)
