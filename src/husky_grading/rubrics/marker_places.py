"""Scores of markers: for each topic and namespace, how long RViz draws its markers at the pillar."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from math import ceil, pi
from typing import Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from husky_grading.notes import Kind
from husky_grading.recording import (
    ADD,
    DELETE_ALL,
    MarkerSample,
    Recording,
)
from husky_grading.records import Rules
from husky_grading.rubrics.marker_faults import (
    FAULTS,
    FEW,
    distance_to_pillar,
    fault_text,
    find_fault,
    height_score,
    is_off_axis,
    off_axis,
    pillar_from_robot,
    slack_of,
)
from husky_highlevel_controller.course import PILLAR_RADIUS
from husky_highlevel_controller.robot import load_robot

LARGEST = 1.0  # [m] largest distance at which the middle of a shape that touches the pillar scores
TOUCHING = 0.5  # least score of a shape that touches the pillar
MOST = 0.5  # fraction of the markers drawn in a namespace that must be right at a moment
MAX_SERIES = 6  # topics and namespaces that are judged separately; if there are more, all are judged as one
ALWAYS, NEVER = 0.8, 0.2  # fractions of the time that give all points and none; linear in between
LONGEST = 0.2  # [s] longest time that one moment counts: two scans of the slowest lidar


class Moment(NamedTuple):
    """Moment at which a marker came."""

    at: float  # [s] simulated time
    seconds: float  # [s] time until the next moment, at most LONGEST
    score: float  # score that most drawn markers reach, 0 to 1


@dataclass(frozen=True)
class Placement:
    """Score of one namespace's markers over a run, and a sentence about it."""

    score: float  # 0 to 1
    evidence: str
    at: float  # [s] simulated time of the first wrong marker, otherwise of the first one
    fault: Optional[Kind] = None  # fault of the wrong markers


def judge_namespaces(recording: Recording, until: float, rules: Rules) -> List[Placement]:
    """Return the placement of each topic and namespace that sent markers before a moment [s].

    If there are more than MAX_SERIES, they get one score together, because one of many guesses is right by
    chance.
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


def _judge(recording: Recording, markers: Sequence[MarkerSample], rules: Rules) -> Placement:
    """Return the score of markers that are judged together, with a sentence for the student.

    The sentence says how long the markers were right and how far they were from the pillar. If some were
    wrong, it adds the fault that most of them have, and the first wrong one.

    Args:
        recording: recording of the run.
        markers: additions and deletions in the order of time, with at least one addition.
        rules: rules of the rubric.
    """
    added = [marker for marker in markers if marker.action == ADD]
    first = added[0]
    name = f"{first.topic} in {first.frame}{', stamp 0' if first.stamp == 0.0 else ''}"
    invisible = [marker for marker in added if marker.problem]
    if len(invisible) == len(added):
        evidence = f"{name}: not visible: {invisible[0].problem}"
        kind = Kind.INVISIBLE if invisible[0].finite else Kind.NOT_A_NUMBER
        return Placement(0.0, evidence, invisible[0].at, kind)
    scores = {id(marker): score_of(recording, marker, rules) for marker in added}
    moments = _moments(markers, scores)
    if not moments:
        return Placement(0.0, f"{name}: deleted as soon as it has come", first.at, Kind.DELETED)
    groups = _by_axis(recording, moments, rules)
    score = _score(groups)
    full = _share(moments, 1.0)
    distances = [distance_to_pillar(recording, marker) for marker in added if not marker.problem]
    evidence = f"{name}: right {100.0 * full:.0f} % of the time"
    evidence += f", {np.median(distances):.2f} m from the pillar's axis (median)"
    wrong = next((marker for marker in added if scores[id(marker)] < 1.0), None)
    if wrong is None:
        return Placement(score, evidence, added[0].at)
    if len(groups) > 1:
        parts = [f"{100.0 * _share(group):.0f} % {axis}" for axis, group in groups.items()]
        evidence += f"; near enough for points: {', '.join(parts)}"
    all_wrong = [marker for marker in added if scores[id(marker)] < 1.0]
    fault = find_fault(recording, all_wrong, len(all_wrong) / len(added), rules)
    if fault is Kind.MIRRORED:
        score = min(score, 0.5) if len(off_axis(recording, all_wrong, rules)) >= FEW else score
        upside_down = load_robot(recording.robot).lidar_mount.upside_down
        why = ", because this lidar is mounted upside down" if upside_down else ""
        evidence = f"mirrored: y has the wrong sign{why}; {evidence}"
    elif fault in FAULTS:
        evidence = f"{FAULTS[fault]}; {evidence}"
    evidence += f"; at {wrong.at:.2f} s {fault_text(recording, wrong)}"
    crowd = len({(marker.topic, marker.namespace, marker.id) for marker in added})
    series = len({(marker.topic, marker.namespace) for marker in added})
    if crowd > 1:
        if len(all_wrong) <= (1.0 - MOST) * len(added):
            fault = fault or Kind.OLD_ONES
        holder = f"namespace '{first.namespace}'" if series == 1 else f"{series} topics and namespaces"
        evidence += f"; {crowd} markers in {holder}, and half of the drawn ones must be right"
    return Placement(score, evidence, wrong.at, fault)


def _moments(markers: Sequence[MarkerSample], scores: Dict[int, float]) -> List[Moment]:
    """Return each moment at which a marker came and a marker is drawn.

    A moment counts for its time, because a busy machine loses some markers and delays others.
    """
    begins, ends, ordered = _drawn(markers, scores)
    times, found = [], []
    for at in np.unique(begins):
        drawn = ordered[(begins <= at) & (at < ends)]
        if len(drawn):
            times.append(float(at))
            found.append(float(drawn[-ceil(MOST * len(drawn))]))
    gaps = np.minimum(np.diff(times), LONGEST).tolist()
    return list(map(Moment, times, [*gaps, gaps[-1] if gaps else LONGEST], found))


def _drawn(markers: Sequence[MarkerSample], scores: Dict[int, float]) -> np.ndarray:
    """Return begin [s], end [s] and score of each marker that RViz draws, (3, N), ordered by the score.

    A marker is drawn until its lifetime ends, or until it is deleted or replaced by a marker of the same
    topic, namespace and id.
    """
    rows: List[List[float]] = []
    topics: Dict[str, Dict[Tuple[str, int], List[float]]] = defaultdict(dict)
    for marker in markers:
        latest, key = topics[marker.topic], (marker.namespace, marker.id)
        for over in list(latest) if marker.action == DELETE_ALL else {key} & set(latest):
            row = latest.pop(over)
            row[1] = min(row[1], marker.at)
        if marker.action == ADD:
            latest[key] = [marker.at, marker.until, scores[id(marker)]]
            rows.append(latest[key])
    return np.array(sorted(rows, key=lambda row: row[2])).T


def _by_axis(recording: Recording, moments: Sequence[Moment], rules: Rules) -> Dict[str, List[Moment]]:
    """Return the moments in two groups: with the pillar ahead, on the robot's axis, and with it to the side.

    A group of fewer than FEW moments is left out. If both groups are so small, all moments are one group.
    """
    aside: List[Moment] = []
    ahead: List[Moment] = []
    for moment in moments:
        is_behind = abs(pillar_from_robot(recording, moment.at)[1]) > 0.5 * pi
        (aside if is_behind or is_off_axis(recording, moment.at, rules) else ahead).append(moment)
    groups = {"with the pillar to the side": aside, "with it ahead": ahead}
    large = {where: group for where, group in groups.items() if len(group) >= FEW}
    return large or {"": list(moments)}


def _share(moments: Sequence[Moment], at_least: float = 0.0) -> float:
    """Return the fraction of the time with a score of `at_least`; by default, above 0."""
    right = [each.seconds for each in moments if each.score > 0.0 and each.score >= at_least]
    return sum(right) / _seconds(moments)


def _seconds(moments: Sequence[Moment]) -> float:
    return sum(each.seconds for each in moments)


def _score(groups: Mapping[str, Sequence[Moment]]) -> float:
    """Return the mean score of the right markers, times a factor for the time in which they are right.

    The factor is 0 up to the fraction NEVER of the time, and 1 from ALWAYS on.

    The time with the pillar ahead counts as half of the time at most, because there a wrong sign of y makes
    no difference.
    """
    right = [moment for group in groups.values() for moment in group if moment.score > 0.0]
    if not right:
        return 0.0
    mean = sum(each.seconds * each.score for each in right) / _seconds(right)
    share, *others = [_share(group) for group in groups.values()]
    if others:  # the two groups are: pillar to the side, pillar ahead
        aside, ahead = map(_seconds, groups.values())
        share += min(ahead / (aside + ahead), 0.5) * (others[0] - share)
    return mean * min(max((share - NEVER) / (ALWAYS - NEVER), 0.0), 1.0)


def score_of(recording: Recording, marker: MarkerSample, rules: Rules) -> float:
    """Return the score of one marker: 1 at the pillar, 0.5 at `marker_half`, linear between and beyond."""
    if marker.problem:
        return 0.0
    size = recording.pillar_size
    slack = slack_of(recording, pillar_from_robot(recording, marker.at)[0], rules)
    distance, fade = distance_to_pillar(recording, marker), max(rules.marker_half - rules.marker_full, 1e-6)
    score = 1.0 - 0.5 * (distance - slack - rules.marker_full) / fade
    if marker.reach <= size.radius and distance <= LARGEST + size.radius - PILLAR_RADIUS:
        score = max(score, TOUCHING)
    return min(max(score, 0.0), 1.0) * height_score(marker, size.height)
