"""Scores of markers: for each topic and namespace, how long RViz draws its markers at the pillar."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from math import ceil, pi
from typing import Dict, FrozenSet, List, Mapping, NamedTuple, Optional, Sequence, Tuple

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
    fault_of_invisible,
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

# [m] a marker that touches the pillar gets the score TOUCHING only if its position is at most this far from
# the pillar's axis
MAX_TOUCH_DISTANCE = 1.0
TOUCHING = 0.5  # lowest score of a marker whose shape touches the pillar
MOST_IF_MIRRORED = 0.5  # largest score of markers whose y has the wrong sign
# RViz may draw several markers at a moment. The score of the moment is the highest score that this fraction
# of the drawn markers reaches. The sentence for the student calls the fraction "half of the drawn ones".
MOST = 0.5
# largest number of namespaces that are judged separately; if there are more, all are judged as one
MAX_NAMESPACES = 6
# markers get all points if they are right for the fraction ALWAYS of the time or more, and none for NEVER or
# less; linear in between
ALWAYS, NEVER = 0.8, 0.2
# [s] A marker counts from the moment at which it came until the next marker comes, but at most for this time.
# The slowest lidar measures two scans in this time.
MAX_DURATION = 0.2


class Moment(NamedTuple):
    """Moment at which a marker came."""

    at: float  # [s] simulated time
    seconds: float  # [s] time from this moment to the next, at most MAX_DURATION
    score: float  # 0 to 1; highest score that the fraction MOST of the drawn markers reaches


@dataclass
class _Drawing:
    """Time in which RViz draws a marker, and the marker's score."""

    begin: float  # [s]
    end: float  # [s] end of the lifetime, or earlier if the marker is deleted or replaced
    score: float  # 0 to 1


@dataclass(frozen=True)
class Placement:
    """Score of one namespace's markers over a run, and a sentence about it."""

    score: float  # 0 to 1
    evidence: str
    at: float  # [s] simulated time of the first wrong marker; if none is wrong, of the first marker
    fault: Optional[Kind] = None  # fault that most wrong markers have; None if unknown
    namespaces: FrozenSet[Tuple[str, str]] = frozenset()  # topic and namespace of its markers


def judge_namespaces(recording: Recording, until: float, rules: Rules) -> List[Placement]:
    """Return the placement of each topic and namespace that sent markers before a moment [s].

    If there are more than MAX_NAMESPACES, all markers get one score together. Otherwise a student could guess
    in many namespaces, and one guess would be right by chance.
    """
    markers = [marker for marker in recording.markers if marker.at < until]
    # additions and deletions, by topic and namespace; the lists are empty until the loop below
    by_namespace: Dict[Tuple[str, str], List[MarkerSample]] = {
        (marker.topic, marker.namespace): [] for marker in markers if marker.action == ADD
    }
    if len(by_namespace) > MAX_NAMESPACES:
        placement = _judge_together(recording, markers, rules)
        return [replace(placement, namespaces=frozenset(by_namespace))]
    for marker in markers:
        for (topic, namespace), members in by_namespace.items():
            # `delete all` deletes the markers of all namespaces of a topic, so it is added to each namespace
            if marker.topic == topic and (marker.namespace == namespace or marker.action == DELETE_ALL):
                members.append(marker)
    placements = []
    for topic_and_namespace, members in by_namespace.items():
        placement = _judge_together(recording, members, rules)
        placements.append(replace(placement, namespaces=frozenset({topic_and_namespace})))
    return placements


def _judge_together(recording: Recording, markers: Sequence[MarkerSample], rules: Rules) -> Placement:
    """Return one score for the markers of a namespace, or of all namespaces, and a sentence for the student.

    The sentence says how long the markers were right and how far they were from the pillar. If some were
    wrong, it adds the fault that most of them have, and the first wrong one.

    Args:
        recording: recording of the run.
        markers: additions and deletions in the order of time, with at least one addition.
        rules: rules of the rubric.
    """
    added = [marker for marker in markers if marker.action == ADD]
    first = added[0]
    # The sentence begins with topic and frame of the first marker, because most submissions use only one of
    # each. A stamp of 0 is named, because RViz then uses the transform of another time.
    title = f"{first.topic} in {first.frame}{', stamp 0' if first.stamp == 0.0 else ''}"
    # RViz does not draw a marker that has a `problem`
    invisible = [marker for marker in added if marker.problem]
    if len(invisible) == len(added):
        evidence = f"{title}: not visible: {invisible[0].problem}"
        return Placement(0.0, evidence, invisible[0].at, fault_of_invisible(invisible[0]))
    # score of each marker; the key is Python's `id(marker)`, because several markers may be equal
    scores = {id(marker): score_of(recording, marker, rules) for marker in added}
    moments = _score_moments(markers, scores)
    if not moments:  # RViz draws no marker at any moment
        return Placement(0.0, f"{title}: deleted as soon as it has come", first.at, Kind.DELETED)
    # moments with the pillar to the side of the robot, and moments with the pillar ahead
    groups = _by_direction(recording, moments, rules)
    score = _score_over_time(groups)
    percent_right = 100.0 * _time_fraction(moments, at_least=1.0)  # the sentence calls a score of 1 "right"
    distances = [distance_to_pillar(recording, marker) for marker in added if not marker.problem]
    evidence = f"{title}: right {percent_right:.0f} % of the time"
    evidence += f", {np.median(distances):.2f} m from the pillar's axis (median)"
    wrong = [marker for marker in added if scores[id(marker)] < 1.0]
    if not wrong:
        return Placement(score, evidence, first.at)
    if len(groups) > 1:
        # `_score_over_time` computes the score from these two fractions of time, so they explain the score
        parts = []
        for direction, group in groups.items():
            percent_with_points = 100.0 * _time_fraction(group)
            parts.append(f"{percent_with_points:.0f} % {direction}")
        evidence += f"; near enough for points: {', '.join(parts)}"
    placement = _with_fault(recording, added, wrong, Placement(score, evidence, wrong[0].at), rules)
    return _with_number_of_markers(placement, added, wrong)


def _with_fault(
    recording: Recording,
    added: Sequence[MarkerSample],
    wrong: Sequence[MarkerSample],
    placement: Placement,
    rules: Rules,
) -> Placement:
    """Return a placement with the fault that most wrong markers have, and with the first wrong marker.

    If the fault is a wrong sign of y, the score is at most MOST_IF_MIRRORED.

    Args:
        recording: recording of the run.
        added: all markers that are judged together.
        wrong: markers among them with a score below 1, at least one.
        placement: placement without a fault.
        rules: rules of the rubric.
    """
    score, evidence = placement.score, placement.evidence
    fault = find_fault(recording, wrong, len(wrong) / len(added), rules)
    if fault is Kind.MIRRORED:
        # While the pillar is straight ahead, mirrored markers are near the pillar and get points. But their y
        # always has the wrong sign, so the score is limited. Only markers that are drawn while the pillar is
        # to the side prove the wrong sign, so at least FEW such markers are needed.
        if len(off_axis(recording, wrong, rules)) >= FEW:
            score = min(score, MOST_IF_MIRRORED)
        upside_down = load_robot(recording.robot).lidar_mount.upside_down
        why = ", because this lidar is mounted upside down" if upside_down else ""
        evidence = f"mirrored: y has the wrong sign{why}; {evidence}"
    elif fault in FAULTS:  # a fault that is not in FAULTS adds no sentence
        evidence = f"{FAULTS[fault]}; {evidence}"
    evidence += f"; at {wrong[0].at:.2f} s {fault_text(recording, wrong[0])}"
    return Placement(score, evidence, placement.at, fault)


def _with_number_of_markers(
    placement: Placement, added: Sequence[MarkerSample], wrong: Sequence[MarkerSample]
) -> Placement:
    """Return a placement that also says how many different markers came in the run, if there are several.

    Markers are different if their topic, namespace or id is different. A marker does not replace a different
    one, so RViz draws both. The score of a moment then needs the fraction MOST, which is half, of the drawn
    markers.

    Args:
        placement: placement with the fault of the wrong markers.
        added: all markers that are judged together.
        wrong: markers among them with a score below 1.
    """
    number_different = len({(marker.topic, marker.namespace, marker.id) for marker in added})
    if number_different == 1:
        return placement
    fault = placement.fault
    # if half of the markers that came are right, points are lost only because RViz still draws older markers
    number_right = len(added) - len(wrong)
    if fault is None and number_right >= MOST * len(added):
        fault = Kind.OLD_ONES
    text = f"{number_different} markers in {_holder_of(added)}, and half of the drawn ones must be right"
    return replace(placement, evidence=f"{placement.evidence}; {text}", fault=fault)


def _holder_of(markers: Sequence[MarkerSample]) -> str:
    """Return the namespace of markers for a sentence, or the number of their topics and namespaces."""
    namespaces = {(marker.topic, marker.namespace) for marker in markers}
    if len(namespaces) == 1:
        return f"namespace '{markers[0].namespace}'"
    return f"{len(namespaces)} topics and namespaces"


def _score_moments(markers: Sequence[MarkerSample], scores: Mapping[int, float]) -> List[Moment]:
    """Return the moments at which markers came, each with its duration and one score for all drawn markers.

    The duration is the weight of the moment. If all moments had the same weight, the markers that a busy
    machine loses or delays would change the score.

    Args:
        markers: additions and deletions in the order of time.
        scores: score of each added marker, by Python's `id(marker)`.
    """
    # the lowest score comes first, because `_score_of_most` needs this order
    drawings = sorted(_drawings_of(markers, scores), key=lambda drawing: drawing.score)
    begins = np.array([drawing.begin for drawing in drawings])  # (N,) [s]
    ends = np.array([drawing.end for drawing in drawings])  # (N,) [s]
    sorted_scores = np.array([drawing.score for drawing in drawings])  # (N,)
    times, moment_scores = [], []
    for at in np.unique(begins):
        is_drawn = (begins <= at) & (at < ends)
        # no marker is drawn if the marker that came at this time was deleted at the same time
        if is_drawn.any():
            times.append(float(at))
            moment_scores.append(_score_of_most(sorted_scores[is_drawn]))
    # [s] a moment counts until the next one, but at most MAX_DURATION, so the last marker before a pause does
    # not count for the whole pause
    durations = np.minimum(np.diff(times), MAX_DURATION).tolist()
    # no moment follows the last moment, so it counts as long as the moment before it
    durations.append(durations[-1] if durations else MAX_DURATION)
    return list(map(Moment, times, durations, moment_scores))


def _score_of_most(sorted_scores: np.ndarray) -> float:
    """Return the highest score that at least the fraction MOST of the drawn markers reaches.

    With the scores 0, 0.2, 0.7 and 1, this is 0.7, because half of the markers have 0.7 or more.

    Args:
        sorted_scores: (K,) scores of the markers that are drawn at a moment, the lowest first, at least one.
    """
    count = ceil(MOST * len(sorted_scores))
    best_scores = sorted_scores[-count:]
    return float(best_scores[0])


def _drawings_of(markers: Sequence[MarkerSample], scores: Mapping[int, float]) -> List[_Drawing]:
    """Return the times in which RViz draws each added marker, and the marker's score.

    RViz draws a marker until its lifetime ends, or until it is deleted or replaced by a marker of the same
    topic, namespace and id. A marker with a `problem` counts as drawn, too, but its score is 0.

    Args:
        markers: additions and deletions in the order of time.
        scores: score of each added marker, by Python's `id(marker)`.
    """
    drawings: List[_Drawing] = []  # drawings of all added markers
    # drawings that have not ended at this point of the loop; keys are the topic, then (namespace, id)
    open_by_topic: Dict[str, Dict[Tuple[str, int], _Drawing]] = defaultdict(dict)
    for marker in markers:
        open_drawings, key = open_by_topic[marker.topic], (marker.namespace, marker.id)
        # an addition and a deletion both end the older marker of the same namespace and id
        ended_keys = list(open_drawings) if marker.action == DELETE_ALL else [key]
        for ended_key in ended_keys:
            if ended_key in open_drawings:
                ended = open_drawings.pop(ended_key)
                ended.end = min(ended.end, marker.at)
        if marker.action == ADD:
            drawing = _Drawing(marker.at, marker.until, scores[id(marker)])
            drawings.append(drawing)
            open_drawings[key] = drawing
    return drawings


def _by_direction(recording: Recording, moments: Sequence[Moment], rules: Rules) -> Dict[str, List[Moment]]:
    """Return the moments in two groups: with the pillar to the side of the robot, and with the pillar ahead.

    The groups are separate, because a marker whose y has the wrong sign is also right while the pillar is
    straight ahead. The keys are parts of the sentence for the student. A group of fewer than FEW moments is
    left out. If both groups are so small, all moments are one group, with an empty key.
    """
    aside: List[Moment] = []
    ahead: List[Moment] = []
    for moment in moments:
        _, bearing = pillar_from_robot(recording, moment.at)
        # a pillar behind the robot is also on the robot's x axis, but it is not ahead, so it counts as aside
        if abs(bearing) > 0.5 * pi or is_off_axis(recording, moment.at, rules):
            aside.append(moment)
        else:
            ahead.append(moment)
    groups = {"with the pillar to the side": aside, "with it ahead": ahead}
    large = {direction: group for direction, group in groups.items() if len(group) >= FEW}
    return large or {"": list(moments)}


def _time_fraction(moments: Sequence[Moment], at_least: float = 0.0) -> float:
    """Return the fraction of the moments' time in which the score is `at_least` or more, and is not 0."""
    right = [each for each in moments if each.score > 0.0 and each.score >= at_least]
    return _seconds(right) / _seconds(moments)


def _seconds(moments: Sequence[Moment]) -> float:
    """Return the sum of the times for which moments count [s]."""
    return sum(each.seconds for each in moments)


def _score_over_time(groups: Mapping[str, Sequence[Moment]]) -> float:
    """Return the mean score of the moments with a score above 0, times a factor for their fraction of time.

    The factor is 0 up to the fraction NEVER of the time, and 1 from ALWAYS on.

    Args:
        groups: result of `_by_direction`.
    """
    scoring = [moment for group in groups.values() for moment in group if moment.score > 0.0]
    if not scoring:
        return 0.0
    mean_score = sum(each.seconds * each.score for each in scoring) / _seconds(scoring)
    factor = (_scoring_fraction(groups) - NEVER) / (ALWAYS - NEVER)
    return mean_score * min(max(factor, 0.0), 1.0)


def _scoring_fraction(groups: Mapping[str, Sequence[Moment]]) -> float:
    """Return the fraction of time in which the score is above 0; time with the pillar ahead may count less.

    If there are two groups, the time with the pillar ahead counts as half of the time at most, because a
    wrong sign of y does not show then. A single group has the whole weight, also if it has the pillar ahead.

    Args:
        groups: result of `_by_direction`, so the moments with the pillar to the side come first.
    """
    if len(groups) == 1:
        (moments,) = groups.values()
        return _time_fraction(moments)
    aside, ahead = groups.values()
    seconds_aside, seconds_ahead = _seconds(aside), _seconds(ahead)
    weight_ahead = min(seconds_ahead / (seconds_aside + seconds_ahead), 0.5)
    fraction_aside, fraction_ahead = _time_fraction(aside), _time_fraction(ahead)
    # weighted mean: (1 - weight_ahead) * fraction_aside + weight_ahead * fraction_ahead
    return fraction_aside + weight_ahead * (fraction_ahead - fraction_aside)


def score_of(recording: Recording, marker: MarkerSample, rules: Rules) -> float:
    """Return the score of one marker, 0 to 1, by its distance from the pillar's axis and by its height.

    The score is 1 up to the distance `marker_full`, and then falls linearly; at `marker_half` it is 0.5.
    """
    if marker.problem:
        return 0.0
    size = recording.pillar_size
    robot_distance, _ = pillar_from_robot(recording, marker.at)
    # [m] tolerance that grows with the distance between robot and pillar, and with the pillar's radius
    slack = slack_of(recording, robot_distance, rules)
    distance = distance_to_pillar(recording, marker)
    # [m] a marker that is this much farther away than `marker_full` loses half of the score; at least 1e-6,
    # because the next line divides by this distance
    half_loss = max(rules.marker_half - rules.marker_full, 1e-6)
    score = 1.0 - 0.5 * (distance - slack - rules.marker_full) / half_loss
    # `reach` is the distance from the pillar's axis to the nearest point of the marker's shape, so a part of
    # the shape is inside the pillar
    touches = marker.reach <= size.radius
    # a huge marker touches the pillar from anywhere, so its position must also be near the pillar; for a
    # thicker pillar than the course's, the limit is larger
    if touches and distance <= MAX_TOUCH_DISTANCE + size.radius - PILLAR_RADIUS:
        score = max(score, TOUCHING)
    return min(max(score, 0.0), 1.0) * height_score(marker, size.height)
