"""Exercise 3: a node drives to the pillar and marks it in RViz; docs/rubrics.md has the rules for points."""

from __future__ import annotations

from dataclasses import replace
from typing import List, Optional, Sequence, Tuple

import numpy as np

from husky_grading.displays import MARKERS, ROBOT, SCAN, TF, RvizView
from husky_grading.drive.drive_end import NO_COMMAND, DriveEnd
from husky_grading.exercises.exercise import Exercise
from husky_grading.exercises.watch import DriveState, RosAccess, Watch
from husky_grading.hand_in.facts import Facts
from husky_grading.notes import Kind, Note, Subject
from husky_grading.recording import Recording
from husky_grading.records import DEFAULT_RULES, Item, Rules
from husky_grading.rubrics.causes import (
    MEMBER,
    behind,
    cause_of_silence,
    cause_of_stop,
    causes,
    first_cause,
    hint_on,
    is_nothing,
    with_cause,
)
from husky_grading.rubrics.items import by_hand, forfeited, over_trials, weighted
from husky_grading.rubrics.marker_faults import CHECK
from husky_grading.rubrics.marker_faults import HINTS as MARKER_HINTS
from husky_grading.rubrics.marker_places import judge_namespaces
from husky_grading.rubrics.rviz_view import (
    NAMES,
    SAVED,
    find_display_fault,
    hint_on_view,
    without_config,
)
from husky_highlevel_controller.course import STANDS, TOUCH
from husky_highlevel_controller.datatypes import TrueState

HALF_WAY = 0.5  # fraction of the way to the pillar that gives all points for the approach
# fraction of the way, and [m]; a robot that passes farther from the pillar than both gets half of the points
PAST, MIN_PAST = 0.1, 1.0
FIRST_STEPS = 0.1  # fraction of the way that gives half of the points for the approach
ASIDE, MOSTLY = 0.1, 0.6  # sine of the bearing at which the robot must turn; fraction of turns with its sign
TURNS_ON, ONE_WAY = 0.05, 0.9  # [rad/s] least rate of a turn; fraction of turns to one side
STOPPED = 1.0  # [s] time at rest at the end after which the robot has stopped
PERIOD, LATELY = 0.1, 1.0  # [s] longest time between two scans; time over which the last approach is measured
SILENT = 2.0  # [s] simulated time after which a submission that listens must have advertised its commands
NEARLY = 0.1  # [m] tolerance for "at the nearest point of the run"
ITEMS = (
    "drives towards the pillar",
    "reaches the pillar",
    "RViz shows TF, robot model, laser scan",
    "marker at the pillar",
    "marker in RViz",
)
NO_RUN = "there was no run"
# hints
STOPS = "compare the velocities that you send at this moment with the distance that you compute"
SLOW = "drive faster while the pillar is far away"
TURNS = "check the sign of angular.z: positive turns left, and the angle is in the lidar's own frame"
SWERVES = (
    "print the angle that you compute and angular.z, because these turns do not follow the pillar's angle"
)
NO_TURN = "set angular.z from the pillar's angle; a gain that is read into an int is cut to 0"
NO_SPEED = "set linear.x, too"
BACKWARDS = "check the sign of linear.x: positive drives ahead"
NO_MARKER = (
    "publish the marker in each callback of the scans; look for a condition, or an exception of TF that is "
    "caught, before the call of publish"
)
SLOWS = "let linear.x become smaller with the distance, and 0 in front of the pillar"


class PillarWatch(Watch):
    """Ends the run at the pillar, or as soon as the robot will not reach it any more."""

    def __init__(self, known: Recording, ros: RosAccess) -> None:
        super().__init__(known, ros)
        self._end = DriveEnd(known.pillar, known.robot)

    def on_truth(self, state: TrueState) -> None:
        """Follow the next true state."""
        self._end.update(state)

    def look(self, state: DriveState) -> Optional[Note]:
        """Return why the run is over, or None if it goes on."""
        deadline = super().look(state)
        if deadline:
            return deadline
        if state.listens and not state.advertises and state.now >= SILENT:
            return Note(Kind.NO_PUBLISHER, f"it had no publisher of velocity commands for {SILENT:g} s")
        if state.abandoned and not state.commands:
            return NO_COMMAND
        return self._end.reason(state.abandoned)


def judge_approach(recording: Recording) -> Item:
    """Grade whether the robot drives towards the pillar: 20 points.

    A robot that covers HALF_WAY of the way gets all points. It gets half of them if it covers FIRST_STEPS, or
    if it drives past the pillar. The hint names the most probable mistake.
    """
    item = Item(ITEMS[0], 0.0, 20.0, "", subject=Subject.DRIVE)
    gaps, times = recording.hull_gaps, recording.times
    if not recording.moving.any():
        return with_cause(item, "the robot never moves", first_cause(recording))
    way = max(gaps[0], 1e-6)
    nearest = int(np.argmin(gaps))
    nearer, distance = way - gaps[nearest], f"of the {way:.2f} m to the pillar"
    if nearer >= HALF_WAY * way:
        half = float(times[np.argmax(gaps <= (1.0 - HALF_WAY) * way)])
        evidence = f"covers half {distance} in {half:.2f} s"
        if gaps[nearest] > max(PAST * way, MIN_PAST) and gaps[-1] > gaps[nearest] + MIN_PAST:
            why, hint = _steering(recording)
            evidence += f", but it drives past the pillar, {gaps[nearest]:.2f} m away{why}"
            return replace(item, points=10.0, evidence=evidence, at=float(times[nearest]), hint=hint)
        return replace(item, points=20.0, evidence=evidence, at=half)
    at, end, points = float(times[nearest]), float(times[-1]), 0.0
    turns = float(np.abs(np.diff(np.unwrap(recording.poses[:, 2]))).sum()) / (2.0 * np.pi)
    if nearer >= FIRST_STEPS * way:
        evidence, points = f"covers {nearer:.2f} m {distance}, less than half, by {at:.2f} s", 10.0
    elif gaps[-1] > way + 0.5:
        evidence = f"drives away: {gaps[-1] - way:.2f} m farther from the pillar after {end:.2f} s"
        at = end
    elif turns > 1.0:
        evidence = f"turns round {turns:.1f} times in {end:.2f} s and comes no nearer"
    else:
        evidence = f"comes only {max(nearer, 0.0):.2f} m nearer, {distance}"
    cause = cause_of_stop(recording)
    why, hint = (behind(cause), hint_on(cause)) if cause else _steering(recording)
    if not cause and _stands_since(recording) is not None and recording.driving.any():
        why, hint = "", STOPS
    return replace(item, points=points, evidence=evidence + why, at=at, hint=hint)


def _steering(recording: Recording) -> Tuple[str, str]:
    """Return how a robot misses the pillar, as the end of a sentence, and the hint against it.

    The tests compare the signs of the turns with the side on which the pillar is.
    """
    if is_nothing(recording.fastest):
        return "; linear.x is 0 in all commands", NO_SPEED
    speeds, turns = recording.speeds[recording.moving].T
    if float(np.median(speeds)) < -STANDS:
        return "; it drives backwards", BACKWARDS
    dx, dy = (np.array(recording.pillar) - recording.poses[:, :2]).T
    sines = np.sin(np.arctan2(dy, dx) - recording.poses[:, 2])[recording.moving]
    aside = np.abs(sines) > ASIDE
    if is_nothing(recording.sharpest):
        return "; it never turns: angular.z is 0 in all commands", NO_TURN
    right = np.sign(sines[aside]) == np.sign(turns[aside])
    share = float(np.mean(right)) if len(right) else 0.0
    if share > MOSTLY:
        speed = float(np.median(np.abs(speeds[aside])))
        return "", (
            f"it turns towards the pillar, but too slowly for {speed:.1f} m/s: a larger gain, or slower "
            "while the angle is large"
        )
    turning = turns[np.abs(turns) > TURNS_ON]
    if (
        len(turning)
        and max(np.mean(turning > 0.0), np.mean(turning < 0.0)) >= ONE_WAY
        and share > 1.0 - MOSTLY
    ):
        return f"; it turns {'left' if turning[0] > 0.0 else 'right'} all the time", SWERVES
    return "", TURNS if share <= 1.0 - MOSTLY else SWERVES


def judge_arrival(
    recording: Recording, rules: Rules = DEFAULT_RULES, approach: Optional[Item] = None
) -> Item:
    """Grade whether the robot reaches the pillar: 30 points if it stands at the pillar or touches it.

    A robot that rams the pillar loses `ramming_costs` points. A robot that comes near enough, but does not
    stay there, gets 20 points. If the deadline ends a run that is still on its way, a person grades it.

    Args:
        recording: recording of the run.
        rules: rules of the rubric.
        approach: item of `judge_approach` for this run. If it lost points, its hint is used here, too.
    """
    item = Item(ITEMS[1], 0.0, 30.0, "", subject=Subject.DRIVE)
    gaps, times = recording.hull_gaps, recording.times
    if not len(times):
        return with_cause(item, NO_RUN, first_cause(recording))
    nearest = int(np.argmin(gaps))
    if gaps[nearest] > rules.reached:
        at = float(times[nearest])
        if _runs_out_of_time(recording):
            why = f"still on its way at the deadline of {at:.0f} s, with {gaps[-1]:.2f} m to go"
            return replace(item, points=None, evidence=by_hand(why), at=at, hint=SLOW)
        evidence = f"nearest {gaps[nearest]:.2f} m from the pillar at {at:.2f} s"
        evidence += f", at most {rules.reached:g} m is needed"
        if not recording.driving[nearest + 1 :].any() and recording.driving.any():
            evidence = f"stops short: {evidence}"
        if not recording.moving.any():
            return replace(item, evidence=evidence, at=at, hint=hint_on(first_cause(recording)))
        if approach is not None and not approach.full:
            return replace(item, evidence=evidence, at=at, hint=approach.hint)
        cause = cause_of_stop(recording)
        why, hint = (behind(cause), hint_on(cause)) if cause else ("", STOPS)
        if not cause and gaps[-1] > gaps[nearest] + NEARLY:
            why, hint = _steering(recording)
        return replace(item, evidence=evidence + why, at=at, hint=hint)
    reached = float(times[np.argmax(gaps <= rules.reached)])
    at = first_touch(recording)
    if at < np.inf:
        # the speed just before, because the touch itself slows the robot down
        before = recording.speeds[(times >= at - 0.2) & (times <= at), 0]
        speed = float(np.abs(before).max())
        if rules.rams(speed):
            evidence = f"rams the pillar at {speed:.2f} m/s; up to {rules.gentle:g} m/s costs no points"
            points = max(30.0 - rules.ramming_costs, 0.0)
            return replace(item, points=points, evidence=evidence, at=at, hint=SLOWS)
        return replace(item, points=30.0, evidence=f"reaches it, at {speed:.2f} m/s", at=at)
    stood = _stands_since(recording)
    if stood is not None and gaps[-1] <= rules.reached:
        evidence = f"stands {gaps[-1]:.2f} m from it since {stood:.2f} s"
        return replace(item, points=30.0, evidence=evidence, at=stood)
    evidence = f", but stands {gaps[-1]:.2f} m away in the end"
    if stood is None:
        evidence = f" at {float(times[nearest]):.2f} s, but does not stop there"
    evidence = f"comes within {gaps[nearest]:.2f} m{evidence}"
    return replace(item, points=20.0, evidence=evidence, at=reached, hint=SLOWS)


def judge_place(recording: Recording, rules: Rules = DEFAULT_RULES) -> Item:
    """Grade whether the marker is at the pillar: 20 points, by its distance and the fraction of the time."""
    item = Item(ITEMS[3], 0.0, 20.0, "", hint=CHECK, subject=Subject.MARKER)
    if not len(recording.times) and causes(recording):
        return with_cause(item, NO_RUN, first_cause(recording))
    cause = cause_of_silence(recording)
    if not recording.marker_topics:
        evidence = f"no topic of type visualization_msgs/Marker or MarkerArray{behind(cause)}"
        hint = hint_on(cause) if cause else f"make a publisher of visualization_msgs/Marker, and {MEMBER}"
        return replace(item, evidence=evidence, hint=hint)
    # after a push the pillar's position is unknown
    placements = judge_namespaces(recording, first_touch(recording), rules)
    if not placements:
        evidence = f"nothing came on {', '.join(recording.marker_topics)}{behind(cause)}"
        return replace(item, evidence=evidence, hint=hint_on(cause) if cause else NO_MARKER)
    best = max(placements, key=lambda placement: placement.score)
    hint = MARKER_HINTS.get(best.fault, CHECK) if best.fault else CHECK
    return replace(item, points=round(20.0 * best.score, 1), evidence=best.evidence, at=best.at, hint=hint)


def first_touch(recording: Recording) -> float:
    """Return the time at which the robot first touches the pillar [s]; inf if it does not."""
    touches = np.flatnonzero(recording.hull_gaps <= TOUCH)
    return float(recording.times[touches[0]]) if len(touches) else np.inf


def _runs_out_of_time(recording: Recording) -> bool:
    """Return whether the deadline ends a run that would reach the pillar in as much time again."""
    gaps, times = recording.hull_gaps, recording.times
    if times[-1] < recording.deadline - PERIOD or gaps[-1] > gaps.min() + NEARLY:
        return False
    before = int(np.searchsorted(times, times[-1] - LATELY))
    return bool((gaps[before] - gaps[-1]) / (times[-1] - times[before]) * recording.deadline > gaps[-1])


def _stands_since(recording: Recording) -> Optional[float]:
    """Return the time since which the robot stands until the end [s]; None if it does not."""
    moving = np.flatnonzero(recording.driving)
    row = moving[-1] + 1 if len(moving) else 0
    if row >= len(recording.times) or recording.times[-1] - recording.times[row] < STOPPED:
        return None
    return float(recording.times[row])


def judge_rviz(view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES) -> Item:
    """Grade whether RViz shows TF, robot model and laser scan: 6, 7 and 7 points."""
    item = Item(ITEMS[2], 0.0, 20.0, "", subject=Subject.DISPLAYS)
    if not view.source:
        return without_config(item, view, rules)
    if view.problem:
        return replace(item, evidence=f"{view.source}: {view.problem}", hint=hint_on_view(view))
    parts = {
        TF: (6.0, view.tf),
        ROBOT: (7.0, view.robot),
        SCAN: (7.0, view.scan and scan_topic in view.topics),
    }
    visible = ", ".join(NAMES[kind] for kind, (_, is_visible) in parts.items() if is_visible)
    faults = [
        find_display_fault(view, kind, scan_topic)
        for kind, (_, is_visible) in parts.items()
        if not is_visible
    ]
    findings = [evidence for evidence, _ in faults]
    if visible:
        findings.insert(0, f"visible: {visible}")
    return replace(
        item,
        points=sum(points for points, is_visible in parts.values() if is_visible),
        evidence=f"{view.source}: {'; '.join(findings)}",
        hint=f"{'; '.join(dict.fromkeys(hint for _, hint in faults))}, {SAVED}",
    )


def judge_shown(
    view: RvizView, recordings: Sequence[Recording], places: Sequence[Item], rules: Rules = DEFAULT_RULES
) -> Item:
    """Grade whether RViz shows the marker: 10 points, if it is at the pillar at times.

    `places` are the items of judge_place, one for each run.
    """
    item = Item(ITEMS[4], 0.0, 10.0, "", subject=Subject.MARKER_DISPLAY)
    drives = [recording for recording, place in zip(recordings, places) if place.points]
    markers = [marker for drive in drives for marker in drive.markers if not marker.problem]
    topics = {marker.topic for marker in markers}
    if not topics:
        hint = places[0].hint if places else CHECK
        return replace(item, evidence="no marker at the pillar that could be shown", hint=hint)
    if not view.source:
        return without_config(item, view, rules)
    drawn = {each.topic for each in markers if (each.topic, each.namespace) not in view.hidden}
    shown_topics = sorted(drawn & set(view.topics))
    if not shown_topics and topics & set(view.topics):
        evidence = (
            f"the namespace of the marker is switched off in the display of {', '.join(sorted(topics))}"
        )
        return replace(item, evidence=evidence, hint=f"switch it on, {SAVED}")
    if not shown_topics:
        evidence = f"RViz does not subscribe to {', '.join(sorted(topics))}"
        is_off = topics & {display.source for display in view.off if display.kind in MARKERS}
        others = [display.source for display in view.displays if display.kind in MARKERS]
        hint = f"add a display Marker of this topic, {SAVED}"
        if view.problem:
            evidence += f": {view.problem}"
            hint = hint_on_view(view)
        if is_off:
            evidence += f": the display of {', '.join(sorted(is_off))} is switched off"
        if is_off and not view.problem:
            hint = f"tick the display Marker, {SAVED}"
        elif others and not view.problem:
            hint = f"set the topic of the display Marker to {sorted(topics)[0]}, {SAVED}"
        return replace(item, evidence=evidence, hint=hint)
    return replace(item, points=10.0, evidence=f"RViz subscribes to {', '.join(shown_topics)}")


def judge_exercise_3(
    recordings: Sequence[Recording], view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Return the items of exercise 3: 20, 30 and 20 points, and 20 and 10 for the marker."""
    approaches = [judge_approach(recording) for recording in recordings]
    arrivals = [judge_arrival(each, rules, approach) for each, approach in zip(recordings, approaches)]
    places = [judge_place(recording, rules) for recording in recordings]
    items = [
        over_trials(approaches, rules.other_worlds),
        over_trials(arrivals, rules.other_worlds),
        judge_rviz(view, scan_topic, rules),
        over_trials(places, rules.other_worlds),
        judge_shown(view, recordings, places, rules),
    ]
    return weighted(forfeited(items, recordings), rules)


EXERCISE = Exercise(
    ITEMS,
    judge_exercise_3,
    pace=5.0,
    deadline=120.0,
    random_starts=True,
    facts=Facts(by_content=True),  # a launch file names the world with the pillar
    watch=PillarWatch,
)
