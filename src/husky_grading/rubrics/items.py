"""Items over all runs: their mean, items that are graded by hand, and no points after an interference."""

from __future__ import annotations

from dataclasses import replace
from typing import Dict, List, Sequence

import numpy as np

from husky_grading.notes import Subject
from husky_grading.recording import Recording
from husky_grading.records import Item, ResultState, Rules

INITIALISE = "give each member a value in the constructor"


def by_hand(why: str = "") -> str:
    """Return the evidence of an item that the teacher grades, with a reason."""
    text = ResultState.GRADED_BY_HAND.value
    return f"{text}: {why}" if why else text


def over_trials(items: Sequence[Item], other_worlds: float) -> Item:
    """Return one item for all runs, with the evidence of the worst run.

    If the item of any run is graded by hand, the result is graded by hand, too.

    Args:
        items: items of the runs; the first run is in the course's world.
        other_worlds: weight of all further runs together, 0 to 1.
    """
    # an item that is graded by hand has no points yet, so it counts as the worst item
    scores = [-1.0 if item.points is None else item.points for item in items]
    number = scores.index(min(scores))  # index of the worst run
    worst = items[number]
    if len(items) == 1 or worst.points is None:
        return worst
    first, *further = scores  # points of the run in the course's world, and of the runs in other worlds
    mean = float(np.mean(further))
    # weighted mean of the course's world and all other worlds together
    points = round((1.0 - other_worlds) * first + other_worlds * mean, 1)
    worlds = "another world" if len(further) == 1 else f"{len(further)} other worlds"
    if max(scores) > min(scores):
        evidence = (
            f"{worst.evidence} (run {number + 1}; of {worst.max_points:g} points it has {first:g} in the"
            f" course's world and {round(mean, 1):g} in {worlds})"
        )
    else:
        evidence = f"{worst.evidence}; the same points in {worlds}"
    return replace(worst, points=points, evidence=evidence, drive=number + 1)


def forfeited(items: Sequence[Item], recordings: Sequence[Recording]) -> List[Item]:
    """Return items without points if a submission interfered with the simulator or the recording."""
    violations: List[str] = []  # sentences on the interferences of all runs, each once
    for recording in recordings:
        for violation in recording.violations:
            if violation not in violations:
                violations.append(violation)
    if not violations:
        return list(items)
    evidence = f"no points: {'; '.join(violations)}"
    hint = "a controller may read scans and TF, and send commands, markers and services, and nothing else"
    judged = []
    for item in items:
        if item.points is not None:  # an item that is graded by hand is left to the teacher
            item = replace(item, points=0.0, evidence=evidence, hint=hint)
        judged.append(item)
    return judged


def left_to_chance(items: Sequence[Item], cause: str) -> List[Item]:
    """Return the items of a submission that behaves by chance; they are graded by hand.

    Items on the displays of RViz stay as they are, because they do not depend on a run.

    Args:
        items: items with the points of our run; another run may give other points.
        cause: sentence on the variable that the submission reads before it writes it.
    """
    judged: List[Item] = []
    has_explained = False  # true if an item before this one has explained the cause
    for item in items:
        if item.points is not None and item.subject is not Subject.DISPLAYS:
            hint = item.hint
            if has_explained:
                reason = "by chance, as above"
            else:
                reason = f"{cause}, so it drives by chance"
                hint = f"{INITIALISE}; then {hint}" if hint else INITIALISE
                has_explained = True
            evidence = by_hand(f"{reason}; in our run: {item.evidence} ({item.points:g} points)")
            item = replace(item, points=None, evidence=evidence, hint=hint)
        judged.append(item)
    return judged


def left_to_choice(items: Sequence[Item], launch_files: Sequence[str]) -> List[Item]:
    """Return the items of a submission with several launch files that fit the exercise equally well.

    The first of `launch_files` was started. Items that lost points are graded by hand, because the student
    may have meant another file.
    """
    started, *others = launch_files
    reason = f"its launch files {started} and {', '.join(others)} fit equally well, and {started} was started"
    # only the first item that lost points names the launch files
    return _losses_by_hand(items, reason, later_reason="the same choice of launch file")


def left_to_other_machine(items: Sequence[Item]) -> List[Item]:
    """Return the items of a submission that needs Python 2; items that lost points are graded by hand.

    The submission may run on the student's machine.
    """
    reason = "Python 2 is not installed here"
    # the later items repeat the reason, because it is short
    return _losses_by_hand(items, reason, later_reason=reason)


def _losses_by_hand(items: Sequence[Item], reason: str, later_reason: str) -> List[Item]:
    """Return the items, and let a person grade those that lost points, with a reason as evidence.

    Args:
        items: items with their points in the runs that `grade` made.
        reason: why the submission could get other points from the student's launch file or machine; evidence
            of the first item that lost points.
        later_reason: reason for the later items; it may be shorter, because the first item explains more.
    """
    judged = []
    for item in items:
        if item.points is not None and not item.full:
            evidence = by_hand(f"{reason}: {item.evidence} ({item.points:g} points)")
            item = replace(item, points=None, evidence=evidence)
            reason = later_reason
        judged.append(item)
    return judged


def told_once(items: Sequence[Item]) -> List[Item]:
    """Return the items with each hint only once; a later item with the same hint refers to the first one."""
    first_names: Dict[str, str] = {}  # key: hint; value: name of the first item with this hint
    told = []
    for item in items:
        # `setdefault` stores the item's name only if the hint is new
        first_name = first_names.setdefault(item.hint, item.name)
        if item.hint and first_name != item.name:
            item = replace(item, hint=f"the same as for '{first_name}'")
        told.append(item)
    return told


def weighted(items: Sequence[Item], rules: Rules) -> List[Item]:
    """Return items with the teacher's weights, and leave the items in `rules.by_person` to the teacher.

    A weight is the largest number of points of an item. An item with all points loses its hint.
    """
    judged = []
    for item in items:
        weight = rules.weights.get(item.name, item.max_points)
        if item.name in rules.by_person:
            item = replace(item, points=None, evidence=by_hand(item.evidence))
        elif item.points is not None and weight != item.max_points:
            item = replace(item, points=round(item.points * weight / item.max_points, 1))
        item = replace(item, max_points=weight)
        # an item that is graded by hand is `full`, too, but keeps its hint for the teacher
        if item.full and item.points is not None:
            item = replace(item, hint="")
        judged.append(item)
    return judged
