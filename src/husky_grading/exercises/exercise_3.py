"""Exercise 3: a node drives to the pillar and marks it in RViz; docs/rubrics.md has the rules for points."""

from __future__ import annotations

from dataclasses import replace
from typing import List, Optional, Sequence, Set, Tuple

import numpy as np

from husky_grading.displays import MARKER, MARKERS, ROBOT, SCAN, TF, RvizView
from husky_grading.drive.drive_end import NO_COMMAND, DriveEnd
from husky_grading.exercises.exercise import Exercise
from husky_grading.exercises.watch import DriveState, RosAccess, Watch
from husky_grading.hand_in.facts import Facts
from husky_grading.notes import Kind, Note, Subject
from husky_grading.recording import ADD, Recording
from husky_grading.records import DEFAULT_RULES, Item, Rules
from husky_grading.rubrics.causes import (
    KEEP_AS_MEMBER,
    as_ending,
    cause_of_no_marker,
    cause_of_stop,
    causes,
    first_cause,
    hint_on,
    with_cause,
)
from husky_grading.rubrics.items import by_hand, forfeited, over_trials, weighted
from husky_grading.rubrics.marker_faults import CHECK
from husky_grading.rubrics.marker_faults import HINTS as MARKER_HINTS
from husky_grading.rubrics.marker_places import Placement, judge_namespaces
from husky_grading.rubrics.rviz_view import (
    NAMES,
    SAVED,
    find_display_fault,
    hint_on_view,
    without_config,
)
from husky_grading.rubrics.steering import explain_steering
from husky_highlevel_controller.course import TOUCH
from husky_highlevel_controller.datatypes import TrueState

HALF_WAY = 0.5  # a robot that covers this fraction of the way to the pillar gets all points for the approach
# A robot drives past the pillar if two conditions hold. At its nearest point, its distance from the pillar is
# more than MIN_PASSING [m], and more than the fraction PASSING_FRACTION of the distance at the start. At the
# end of the run, it is more than MIN_PASSING farther away than at its nearest point. A robot that drives past
# gets half of the points for the approach.
PASSING_FRACTION, MIN_PASSING = 0.1, 1.0
# a robot that covers at least this fraction of the way, but less than HALF_WAY, gets half of the points
FIRST_STEPS = 0.1
STOPPED = 1.0  # [s] a robot has stopped if it has been at rest for at least this time at the end of the run
DEADLINE_MARGIN = 0.1  # [s] a run that ends this close to its deadline was ended by the deadline
LATELY = 1.0  # [s] time at the end of a run over which the speed of the approach to the pillar is measured
# [s] the run ends if, at this simulated time, a submission that subscribes to topics has no publisher of
# velocity commands
SILENT = 2.0
# [m] the robot has driven away if, at the end, it is farther from the pillar than at its nearest point by
# more than this
AWAY_FROM_NEAREST = 0.1
# [m] a robot that covers less than FIRST_STEPS of the way has driven away if, at the end, it is farther from
# the pillar than at the start by more than this
AWAY_FROM_START = 0.5
# [s] the speed of a touch is the highest speed within this simulated time before the touch, because the touch
# itself slows the robot down
JUST_BEFORE = 0.2
APPROACHES = "drives towards the pillar"
ARRIVES = "reaches the pillar"
SHOWS_DISPLAYS = "RViz shows TF, robot model, laser scan"
PLACES_MARKER = "marker at the pillar"
SHOWS_MARKER = "marker in RViz"
ITEMS = (APPROACHES, ARRIVES, SHOWS_DISPLAYS, PLACES_MARKER, SHOWS_MARKER)
NO_RUN = "there was no run"
# hints
STOPS = "compare the velocities that you send at this moment with the distance that you compute"
SLOW = "drive faster while the pillar is far away"
NO_MARKER = (
    "publish the marker in each callback of the scans; look for a condition, or an exception of TF that is "
    "caught, before the call of publish"
)
SLOWS = "let linear.x become smaller with the distance, and 0 in front of the pillar"


class PillarWatch(Watch):
    """Ends the run when the robot is at the pillar, or can no longer reach it."""

    def __init__(self, initial: Recording, ros: RosAccess) -> None:
        super().__init__(initial, ros)
        self._end = DriveEnd(initial.pillar, initial.robot)

    def on_truth(self, state: TrueState) -> None:
        """Follow the next true state."""
        self._end.update(state)

    def look(self, state: DriveState) -> Optional[Note]:
        """Return why the run is over, or None if it goes on."""
        out_of_time = super().look(state)
        if out_of_time:
            return out_of_time
        # a node runs and subscribes to topics, but it cannot drive the robot
        if state.listens and not state.advertises and state.now >= SILENT:
            return Note(Kind.NO_PUBLISHER, f"it had no publisher of velocity commands for {SILENT:g} s")
        # no node runs any more, and none has ever sent a command, so the robot will never move
        if state.abandoned and not state.commands:
            return NO_COMMAND
        # `DriveEnd` decides by the robot's motion. It waits less long for a robot that stands if no node runs
        # any more, because this robot will not start again.
        return self._end.reason(state.abandoned)


def judge_approach(recording: Recording) -> Item:
    """Grade whether the robot drives towards the pillar: 20 points.

    A robot that covers HALF_WAY of the way gets all points, or half of them if it drives past the pillar. A
    robot that covers less gets half of the points at most. The hint names the most probable mistake.
    """
    item = Item(APPROACHES, 0.0, 20.0, "", subject=Subject.DRIVE)
    # (N,) [m] gap between the robot's footprint and the pillar, at each of the times (N,) [s]
    gaps, times = recording.hull_gaps, recording.times
    if not recording.moving.any():
        return with_cause(item, "the robot never moves", first_cause(recording))
    # [m] gap at the start, which is the length of the way to the pillar; at least 1e-6, because the robot may
    # start at the pillar
    first_gap = max(gaps[0], 1e-6)
    nearest = int(np.argmin(gaps))  # index of the moment at which the robot is nearest to the pillar
    covered = first_gap - gaps[nearest]  # [m] part of the way that the robot has covered
    if covered >= HALF_WAY * first_gap:
        # [s] first time at which the robot has covered half of the way; `argmax` finds the first True
        half_time = float(times[np.argmax(gaps <= (1.0 - HALF_WAY) * first_gap)])
        evidence = f"covers half of the {first_gap:.2f} m to the pillar in {half_time:.2f} s"
        stays_far = gaps[nearest] > max(PASSING_FRACTION * first_gap, MIN_PASSING)
        drives_past = gaps[-1] > gaps[nearest] + MIN_PASSING
        if stays_far and drives_past:
            ending, hint, _ = explain_steering(recording)
            evidence += f", but it drives past the pillar, {gaps[nearest]:.2f} m away{ending}"
            return replace(item, points=10.0, evidence=evidence, at=float(times[nearest]), hint=hint)
        return replace(item, points=20.0, evidence=evidence, at=half_time)
    return _judge_short_way(item, recording, first_gap, covered, float(times[nearest]))


def _judge_short_way(item: Item, recording: Recording, first_gap: float, covered: float, at: float) -> Item:
    """Return the item of a robot that covers less than HALF_WAY of the way to the pillar.

    It gets half of the points if it covers the fraction FIRST_STEPS of the way, otherwise none. The evidence
    says how far it comes, or that it drives away or turns round.

    Args:
        item: the item without evidence.
        recording: the run.
        first_gap: length of the way to the pillar [m], never 0.
        covered: part of the way that the robot has covered [m].
        at: time at which the robot is nearest to the pillar [s].
    """
    points = 0.0
    end = float(recording.times[-1])  # [s] end of the run
    last_gap = recording.hull_gaps[-1]  # [m] gap to the pillar at the end of the run
    # number of full turns of the robot; turns to the left and to the right are added
    yaw_changes = np.diff(np.unwrap(recording.poses[:, 2]))
    full_turns = float(np.abs(yaw_changes).sum()) / (2.0 * np.pi)
    if covered >= FIRST_STEPS * first_gap:
        points = 10.0  # half of the item's 20 points
        evidence = (
            f"covers {covered:.2f} m of the {first_gap:.2f} m to the pillar, less than half, by {at:.2f} s"
        )
    elif last_gap > first_gap + AWAY_FROM_START:
        evidence = f"drives away: {last_gap - first_gap:.2f} m farther from the pillar after {end:.2f} s"
        at = end
    elif full_turns > 1.0:
        evidence = f"turns round {full_turns:.1f} times in {end:.2f} s and comes no nearer"
    else:
        evidence = f"comes only {max(covered, 0.0):.2f} m nearer, of the {first_gap:.2f} m to the pillar"
    ending, hint = _explain_short_way(recording)
    return replace(item, points=points, evidence=evidence + ending, at=at, hint=hint)


def _explain_short_way(recording: Recording) -> Tuple[str, str]:
    """Return why the robot probably does not come far, as an end of the evidence, and a hint.

    A finding such as an exception in the node is the best explanation. Without such a finding, the
    explanation is a mistake in the steering, or the stop itself.
    """
    steering = explain_steering(recording)
    cause = cause_of_stop(recording)
    if cause is not None:
        # A robot that turns away from the pillar often stops afterwards, because many nodes send no command
        # while the pillar is out of sight. The stop then only follows from the turn, so the hint is on the
        # turn.
        if steering.has_turned_away and cause.kind is Kind.COMMANDS_CEASE:
            return as_ending(cause), steering.hint
        return as_ending(cause), hint_on(cause)
    has_stopped = _stands_since(recording) is not None and recording.driving.any()
    if has_stopped and not steering.has_turned_away:
        return "", STOPS
    return steering.ending, steering.hint


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
    item = Item(ARRIVES, 0.0, 30.0, "", subject=Subject.DRIVE)
    if not len(recording.times):  # a run that has not begun has no poses
        return with_cause(item, NO_RUN, first_cause(recording))
    if recording.hull_gaps.min() > rules.reached:
        return _judge_miss(item, recording, rules, approach)
    # [s] time of the first touch; inf if the robot never touches the pillar
    touch_time = first_touch(recording)
    if touch_time < np.inf:
        return _judge_touch(item, recording, rules, touch_time)
    return _judge_stop(item, recording, rules)


def _judge_miss(item: Item, recording: Recording, rules: Rules, approach: Optional[Item]) -> Item:
    """Return the item of a robot that never comes near enough: no points, or graded by hand.

    `item` has no evidence yet. `approach` is the item of `judge_approach` for this run.
    """
    gaps = recording.hull_gaps  # (N,) [m] gap between the robot's footprint and the pillar
    nearest = int(np.argmin(gaps))  # index of the moment at which the robot is nearest to the pillar
    at = float(recording.times[nearest])
    if _runs_out_of_time(recording):
        # this robot comes nearer until the end of the run, so `at` is the deadline, or just before it
        why = f"still on its way at the deadline of {at:.0f} s, with {gaps[-1]:.2f} m to go"
        return replace(item, points=None, evidence=by_hand(why), at=at, hint=SLOW)
    evidence = f"nearest {gaps[nearest]:.2f} m from the pillar at {at:.2f} s"
    evidence += f", at most {rules.reached:g} m is needed"
    # the robot stops short if it has driven ahead or back, but has only stood or turned since it was nearest
    # to the pillar
    if recording.driving.any() and not recording.driving[nearest + 1 :].any():
        evidence = f"stops short: {evidence}"
    ending, hint = _explain_miss(recording, approach)
    return replace(item, evidence=evidence + ending, at=at, hint=hint)


def _explain_miss(recording: Recording, approach: Optional[Item]) -> Tuple[str, str]:
    """Return why the robot probably does not reach the pillar, as an end of the evidence, and a hint.

    The first explanation that fits counts. The end of the evidence is often empty. `approach` is the item of
    `judge_approach` for this run.
    """
    if not recording.moving.any():  # the robot has never driven or turned
        return "", hint_on(first_cause(recording))
    if approach is not None and not approach.full:
        return "", approach.hint  # the mistake in the approach has also kept the robot from the pillar
    cause = cause_of_stop(recording)
    if cause:
        return as_ending(cause), hint_on(cause)
    gaps = recording.hull_gaps  # (N,) [m] gap between the robot's footprint and the pillar
    has_driven_away = gaps[-1] > gaps.min() + AWAY_FROM_NEAREST
    if has_driven_away:
        ending, hint, _ = explain_steering(recording)
        return ending, hint
    return "", STOPS


def _judge_touch(item: Item, recording: Recording, rules: Rules, touch_time: float) -> Item:
    """Return the item of a robot that touches the pillar at `touch_time` [s].

    It gets all points, unless it is so fast that it rams the pillar by the rules.
    """
    times = recording.times
    just_before = (times >= touch_time - JUST_BEFORE) & (times <= touch_time)  # (N,) bool
    # [m/s] highest speed just before the touch, because the touch itself slows the robot down
    speed = float(np.abs(recording.speeds[just_before, 0]).max())
    if rules.rams(speed):
        evidence = f"rams the pillar at {speed:.2f} m/s; up to {rules.gentle:g} m/s costs no points"
        points = max(30.0 - rules.ramming_costs, 0.0)
        return replace(item, points=points, evidence=evidence, at=touch_time, hint=SLOWS)
    return replace(item, points=30.0, evidence=f"reaches it, at {speed:.2f} m/s", at=touch_time)


def _judge_stop(item: Item, recording: Recording, rules: Rules) -> Item:
    """Return the item of a robot that comes near enough to the pillar, and never touches it.

    It gets 30 points if it stands near enough at the end, otherwise 20. A gap up to `rules.reached` is near
    enough.
    """
    # (N,) [m] gap between the robot's footprint and the pillar, at each of the times (N,) [s]
    gaps, times = recording.hull_gaps, recording.times
    stood_since = _stands_since(recording)
    if stood_since is not None and gaps[-1] <= rules.reached:
        evidence = f"stands {gaps[-1]:.2f} m from it since {stood_since:.2f} s"
        return replace(item, points=30.0, evidence=evidence, at=stood_since)
    nearest = int(np.argmin(gaps))
    evidence = f"comes within {gaps[nearest]:.2f} m"
    if stood_since is None:
        evidence += f" at {float(times[nearest]):.2f} s, but does not stop there"
    else:
        evidence += f", but stands {gaps[-1]:.2f} m away in the end"
    # [s] first time at which the robot is near enough; `argmax` finds the first True
    reached_at = float(times[np.argmax(gaps <= rules.reached)])
    return replace(item, points=20.0, evidence=evidence, at=reached_at, hint=SLOWS)


def find_placements(recording: Recording, rules: Rules) -> List[Placement]:
    """Return the score of each topic's and namespace's markers, up to the first touch of the pillar.

    A push moves the pillar to an unknown position, so later markers do not count.
    """
    return judge_namespaces(recording, first_touch(recording), rules)


def points_for_place(placement: Placement) -> float:
    """Return the points that a placement gets, 0 to 20."""
    return round(20.0 * placement.score, 1)


def judge_place(recording: Recording, placements: Sequence[Placement]) -> Item:
    """Grade whether the marker is at the pillar: at most 20 points, by its distance and duration there."""
    item = Item(PLACES_MARKER, 0.0, 20.0, "", hint=CHECK, subject=Subject.MARKER)
    # the run has not begun, for example because the build failed; without such a reason, the tests below give
    # a better explanation
    if not len(recording.times) and causes(recording):
        return with_cause(item, NO_RUN, first_cause(recording))
    if not recording.marker_topics or not placements:
        return _judge_no_marker(item, recording)
    # the marker namespace with the most points counts, as docs/rubrics.md says
    best = max(placements, key=lambda placement: placement.score)
    hint = MARKER_HINTS.get(best.fault, CHECK) if best.fault else CHECK
    return replace(item, points=points_for_place(best), evidence=best.evidence, at=best.at, hint=hint)


def _judge_no_marker(item: Item, recording: Recording) -> Item:
    """Return the item of a run without a marker that could be judged: no points.

    The submission has no topic of markers, or no marker came before the robot touched the pillar.
    """
    cause = cause_of_no_marker(recording)
    if not recording.marker_topics:
        evidence = f"no topic of type visualization_msgs/Marker or MarkerArray{as_ending(cause)}"
        hint = f"make a publisher of visualization_msgs/Marker, and {KEEP_AS_MEMBER}"
        return replace(item, evidence=evidence, hint=hint_on(cause) if cause else hint)
    topics = ", ".join(recording.marker_topics)
    added = [marker for marker in recording.markers if marker.action == ADD]
    if added:  # all of them came after the touch, when markers do not count any more
        evidence = f"no marker came on {topics} before the robot touched the pillar"
        return replace(item, evidence=evidence, at=added[0].at, hint=NO_MARKER)
    evidence = f"nothing came on {topics}{as_ending(cause)}"
    return replace(item, evidence=evidence, hint=hint_on(cause) if cause else NO_MARKER)


def first_touch(recording: Recording) -> float:
    """Return the time at which the robot first touches the pillar [s]; inf if it does not."""
    touches = np.flatnonzero(recording.hull_gaps <= TOUCH)
    return float(recording.times[touches[0]]) if len(touches) else np.inf


def _runs_out_of_time(recording: Recording) -> bool:
    """Return whether the robot still came nearer at the deadline, and would arrive in twice the time.

    Such a robot is only slow, so it is not known whether it would have stopped at the pillar.
    """
    gaps, times = recording.hull_gaps, recording.times
    is_ended_early = times[-1] < recording.deadline - DEADLINE_MARGIN
    drives_away = gaps[-1] > gaps.min() + AWAY_FROM_NEAREST
    if is_ended_early or drives_away:
        return False
    before = int(np.searchsorted(times, times[-1] - LATELY))  # index of the pose LATELY before the end
    approach_speed = (gaps[before] - gaps[-1]) / (times[-1] - times[before])  # [m/s]
    # true if, at this speed, the robot would cover the rest of the way in a second run of the same length
    return bool(approach_speed * recording.deadline > gaps[-1])


def _stands_since(recording: Recording) -> Optional[float]:
    """Return the time [s] of the last stop, after which the robot does not drive again.

    It is None if the robot drives in the last STOPPED seconds of the run.
    """
    driving_rows = np.flatnonzero(recording.driving)  # indices of the poses at which the robot drives
    first_row_at_rest = driving_rows[-1] + 1 if len(driving_rows) else 0
    times_at_rest = recording.times[first_row_at_rest:]  # [s] times after the robot has driven the last time
    if not len(times_at_rest) or times_at_rest[-1] - times_at_rest[0] < STOPPED:
        return None
    return float(times_at_rest[0])


def judge_rviz(view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES) -> Item:
    """Grade whether RViz shows TF, robot model and laser scan: 6, 7 and 7 points."""
    item = Item(SHOWS_DISPLAYS, 0.0, 20.0, "", subject=Subject.DISPLAYS)
    if not view.source:
        return without_config(item, view, rules)
    if view.problem:  # RViz shows nothing, for example because the fixed frame does not exist
        return replace(item, evidence=f"{view.source}: {view.problem}", hint=hint_on_view(view))
    points_of_displays = {TF: 6.0, ROBOT: 7.0, SCAN: 7.0}
    is_visible = {TF: view.tf, ROBOT: view.robot, SCAN: view.scan and scan_topic in view.topics}
    points = 0.0
    visible, faults, hints = [], [], []
    for kind, points_of_display in points_of_displays.items():
        if is_visible[kind]:
            points += points_of_display
            visible.append(NAMES[kind])
        else:
            fault, hint = find_display_fault(view, kind, scan_topic)
            faults.append(fault)
            hints.append(hint)
    findings = [f"visible: {', '.join(visible)}", *faults] if visible else faults
    # without faults, the item has all points, so `weighted` later removes this hint
    hint = f"{'; '.join(hints)}, {SAVED}"
    return replace(item, points=points, evidence=f"{view.source}: {'; '.join(findings)}", hint=hint)


def judge_shown(
    view: RvizView,
    placements: Sequence[Placement],
    places: Sequence[Item],
    rules: Rules = DEFAULT_RULES,
) -> Item:
    """Grade whether RViz shows a marker that was at the pillar: 10 points.

    A marker was at the pillar if it has points for its place in at least one run.

    Args:
        view: view of RViz.
        placements: placements of all runs.
        places: items of `judge_place`, one for each run.
        rules: rules of the rubric.
    """
    item = Item(SHOWS_MARKER, 0.0, 10.0, "", subject=Subject.MARKER_DISPLAY)
    # topic and namespace of the markers that were at the pillar
    right_namespaces: Set[Tuple[str, str]] = set()
    for placement in placements:
        if points_for_place(placement) > 0.0:
            right_namespaces |= placement.namespaces
    topics = {topic for topic, _ in right_namespaces}
    if not topics:
        # the student must first place the marker right, so this hint says how to do that
        hint = places[0].hint if places else CHECK
        return replace(item, evidence="no marker at the pillar that could be shown", hint=hint)
    if not view.source:
        return without_config(item, view, rules)
    # `view.hidden` has the topics and namespaces that are switched off in the displays of RViz
    switched_on_topics = {topic for topic, _ in right_namespaces - set(view.hidden)}
    subscribed_topics = topics & set(view.topics)  # topics to which a display of RViz subscribes
    shown_topics = sorted(switched_on_topics & subscribed_topics)
    if shown_topics:
        return replace(item, points=10.0, evidence=f"RViz subscribes to {', '.join(shown_topics)}")
    if subscribed_topics:
        displays = ", ".join(sorted(subscribed_topics))
        evidence = f"the namespace of the marker is switched off in the display of {displays}"
        return replace(item, evidence=evidence, hint=f"switch it on, {SAVED}")
    evidence, hint = _explain_no_display(view, topics)
    return replace(item, evidence=evidence, hint=hint)


def _explain_no_display(view: RvizView, topics: Set[str]) -> Tuple[str, str]:
    """Return why no display of RViz subscribes to one of the markers' topics, and the hint.

    If there are two reasons, the evidence names both, and the hint is on the first one.
    """
    evidence = f"RViz does not subscribe to {', '.join(sorted(topics))}"
    # topics whose display is switched off or invisible
    switched_off = topics & {display.source for display in view.off if display.kind in MARKERS}
    if view.problem:
        evidence += f": {view.problem}"
    if switched_off:
        evidence += f": the display of {', '.join(sorted(switched_off))} is switched off"
    # displays of these topics that are for the other type of messages
    mistyped = [display for display in view.mistyped if display.source in topics]
    if mistyped:
        kind, topic = mistyped[0].kind, mistyped[0].source
        # a display has the same name as the type of messages that it shows
        wrong, right = ("Marker", "MarkerArray") if kind == MARKER else ("MarkerArray", "Marker")
        evidence += f": its display {wrong} does not show {topic}, whose type is visualization_msgs/{right}"
    if view.problem:
        return evidence, hint_on_view(view)
    if switched_off:
        return evidence, f"tick the display Marker, {SAVED}"
    if mistyped:
        return evidence, f"add a display {right} of {topic} instead, {SAVED}"
    if any(display.kind in MARKERS for display in view.displays):
        return evidence, f"set the topic of the display Marker to {sorted(topics)[0]}, {SAVED}"
    return evidence, f"add a display Marker of this topic, {SAVED}"


def judge_exercise_3(
    recordings: Sequence[Recording], view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Return the five items of exercise 3, with 100 points together.

    Approach, arrival and place of the marker are judged in each run, so `over_trials` makes one item of the
    items of all runs.
    """
    approaches = [judge_approach(recording) for recording in recordings]
    arrivals = [judge_arrival(each, rules, approach) for each, approach in zip(recordings, approaches)]
    # each run has a list of placements, one for each topic and namespace with markers
    placements_of_runs = [find_placements(recording, rules) for recording in recordings]
    places = [judge_place(recording, found) for recording, found in zip(recordings, placements_of_runs)]
    all_placements = [placement for found in placements_of_runs for placement in found]
    items = [
        over_trials(approaches, rules.other_worlds),
        over_trials(arrivals, rules.other_worlds),
        judge_rviz(view, scan_topic, rules),
        over_trials(places, rules.other_worlds),
        judge_shown(view, all_placements, places, rules),
    ]
    # `forfeited` removes the points if the submission has interfered with the simulator, and `weighted`
    # applies the weights of the teacher's rubric
    return weighted(forfeited(items, recordings), rules)


EXERCISE = Exercise(
    ITEMS,
    judge_exercise_3,
    pace=5.0,
    deadline=120.0,
    random_starts=True,
    # the right launch file is found by its content: it names the world with the pillar
    facts=Facts(by_content=True),
    watch=PillarWatch,
)
