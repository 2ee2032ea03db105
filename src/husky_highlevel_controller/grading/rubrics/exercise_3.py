"""Judges recorded drives by the rubric of exercise 3; docs/marking.md says the same in words."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import List, Optional, Sequence

import numpy as np

from husky_highlevel_controller.course import TOUCH
from husky_highlevel_controller.grading.drive.recording import Recording
from husky_highlevel_controller.grading.records import DEFAULT_RULES, Item, Rules, RvizView
from husky_highlevel_controller.grading.rubrics.items import forfeited, over_trials
from husky_highlevel_controller.grading.rubrics.markers import judge_namespaces

HALF_WAY = 0.5  # of the way to the pillar: who has come that far drives towards it
FIRST_STEPS = 0.1  # of the way: who has come that far has begun to
STOPPED = 1.0  # [s], so long it must stand in the end to have stopped
MOST, SOME = 0.8, 0.2  # of the moments at which a marker came
ITEMS = (
    "drives towards the pillar",
    "reaches the pillar",
    "RViz shows TF, robot model, laser scan",
    "marker at the pillar",
    "marker in RViz",
)
NO_VIEW = "for a person: no RViz configuration was handed in"


# ---------------------------------------------------------------------------- one drive


def judge_approach(recording: Recording) -> Item:
    """The Husky drives towards the pillar: 20."""
    item = Item(ITEMS[0], 0.0, 20.0, "")
    gaps, times = recording.hull_gaps, recording.times
    if not len(times):
        return replace(item, evidence=_why_it_stands(recording))
    way = max(gaps[0], 1e-6)
    nearest = int(np.argmin(gaps))
    covered = (way - gaps[nearest]) / way
    if not recording.moving.any():
        return replace(item, evidence=_why_it_stands(recording))
    distance = f"of the {way:.2f} m to the pillar"
    if covered >= HALF_WAY:
        half = float(times[np.argmax(gaps <= (1.0 - HALF_WAY) * way)])
        return replace(
            item, points=20.0, evidence=f"half {distance} are behind it after {half:.2f} s", at=half
        )
    at = float(times[nearest])
    if covered >= FIRST_STEPS:
        words = f"covers {way - gaps[nearest]:.2f} m {distance}, less than half, by {at:.2f} s"
        return replace(item, points=10.0, evidence=words, at=at)
    turned = float(np.abs(np.diff(np.unwrap(recording.poses[:, 2]))).sum())
    end = float(times[-1])
    if gaps[-1] > way + 0.5:
        words = f"drives away: {gaps[-1] - way:.2f} m farther from the pillar after {end:.2f} s"
    elif turned > 2.0 * np.pi:
        words = f"turns round {turned / (2.0 * np.pi):.1f} times in {end:.2f} s and comes no nearer"
    else:
        words = f"comes only {max(way - gaps[nearest], 0.0):.2f} m nearer, {distance}"
    return replace(item, evidence=words, at=at if gaps[-1] <= way + 0.5 else end)


def judge_arrival(recording: Recording, rules: Rules = DEFAULT_RULES) -> Item:
    """The Husky reaches the pillar, by standing at it or by touching it at any speed: 30."""
    item = Item(ITEMS[1], 0.0, 30.0, "")
    gaps, times = recording.hull_gaps, recording.times
    if not len(times):
        return replace(item, evidence="there was no drive")
    nearest = int(np.argmin(gaps))
    if gaps[nearest] > rules.reached:
        at = float(times[nearest])
        words = f"nearest {gaps[nearest]:.2f} m from the pillar, wanted {rules.reached:g} m, at {at:.2f} s"
        if not recording.driving[nearest + 1 :].any() and recording.driving.any():
            words = f"stops short: {words}"
        return replace(item, evidence=words, at=at)
    reached = float(times[np.argmax(gaps <= rules.reached)])
    touches = np.flatnonzero(gaps <= TOUCH)
    if len(touches):
        at = float(times[touches[0]])
        # the speed just before: the touch itself slows the robot down
        before = recording.speeds[(times >= at - 0.2) & (times <= at), 0]
        speed = float(np.abs(before).max())
        if rules.rams(speed):
            words = f"rams the pillar at {speed:.2f} m/s, at most {rules.gentle:g} m/s are gentle"
            return replace(item, points=max(30.0 - rules.ramming_costs, 0.0), evidence=words, at=at)
        return replace(item, points=30.0, evidence=f"reaches it, at {speed:.2f} m/s", at=at)
    stood = _stands_since(recording)
    if stood is None:
        words = (
            f"comes within {gaps[nearest]:.2f} m at {float(times[nearest]):.2f} s, but does not stop there"
        )
        return replace(item, points=20.0, evidence=words, at=reached)
    if gaps[-1] > rules.reached:
        words = f"comes within {gaps[nearest]:.2f} m, but stands {gaps[-1]:.2f} m away in the end"
        return replace(item, points=20.0, evidence=words, at=reached)
    return replace(
        item, points=30.0, evidence=f"stands {gaps[-1]:.2f} m from it since {stood:.2f} s", at=stood
    )


def judge_place(recording: Recording, rules: Rules = DEFAULT_RULES) -> Item:
    """The marker is at the pillar: 20 for most of the time; 10 for some of it, or for most of it near by."""
    item = Item(ITEMS[3], 0.0, 20.0, "")
    if not recording.marker_topics:
        return replace(item, evidence="no topic of type visualization_msgs/Marker or MarkerArray")
    # after a push it is not known where the pillar is
    judged = judge_namespaces(recording, first_touch(recording), rules)
    if not judged:
        return replace(item, evidence=f"nothing came on {', '.join(recording.marker_topics)}")
    best = max(judged, key=lambda shares: shares.order)
    points = 20.0 if best.full >= MOST else 10.0 if best.full >= SOME or best.half >= MOST else 0.0
    return replace(item, points=points, evidence=best.evidence, at=best.at)


def first_touch(recording: Recording) -> float:
    """When the robot first touches the pillar [s]; inf if it does not."""
    touches = np.flatnonzero(recording.hull_gaps <= TOUCH)
    return float(recording.times[touches[0]]) if len(touches) else np.inf


def _stands_since(recording: Recording) -> Optional[float]:
    """Since when it stands for good [s]; None if it does not."""
    moving = np.flatnonzero(recording.driving)
    row = moving[-1] + 1 if len(moving) else 0
    if row >= len(recording.times) or recording.times[-1] - recording.times[row] < STOPPED:
        return None
    return float(recording.times[row])


def _why_it_stands(recording: Recording) -> str:
    """The first cause in the chain from scan to wheels."""
    return f"the robot never moves: {first_cause(recording)}"


def causes(recording: Recording) -> List[str]:
    """Notes on what went wrong; that it sleeps, is slow or sends too much is no cause."""
    harmless = ("does not answer", "it floods")
    return [note for note in recording.notes if not any(words in note for words in harmless)]


def first_cause(recording: Recording) -> str:
    """Why the robot stands: the first link of the chain node, scan, command that is broken."""
    silent, unread = ", ".join(recording.silent_topics), ", ".join(recording.unread_topics)
    ended = causes(recording)
    if not recording.subscribed and silent and not ended:
        return f"it listens to {silent}, where nothing is sent"
    if ended:
        return ended[0]
    if not recording.subscribed:
        return "it does not subscribe to the scans"
    if not recording.command_count:
        return (
            f"it sends its commands to {unread}, which has no subscriber"
            if unread
            else "nothing came on cmd_vel"
            if recording.advertised
            else "it advertises no cmd_vel"
        )
    if recording.zero_count == recording.command_count:
        return f"all {recording.command_count} commands were zero"
    return f"in spite of {recording.command_count} commands"


# ---------------------------------------------------------------------------- the whole submission


def judge_rviz(view: RvizView, scan_topic: str) -> Item:
    """RViz shows TF, robot model and laser scan: 6, 7 and 7."""
    item = Item(ITEMS[2], 0.0, 20.0, "")
    if not view.judged:
        return replace(item, points=None, evidence=f"not judged: {view.problem}")
    if not view.source:
        return replace(item, points=None, evidence=NO_VIEW)
    if view.problem:
        return replace(item, evidence=f"{view.source}: {view.problem}")
    listens = scan_topic in view.topics
    parts = [
        (6.0, view.tf, "frames"),
        (7.0, view.robot, "robot model"),
        (7.0, view.scan and listens, "laser scan"),
    ]
    seen = [what for _, there, what in parts if there]
    unseen = [what for _, there, what in parts if not there]
    words = f"{view.source}: "
    words += "; ".join(
        [f"{', '.join(seen)} to be seen"] * bool(seen)
        + [f"{', '.join(unseen)} not to be seen"] * bool(unseen)
    )
    if not listens:
        words += f"; does not subscribe to {scan_topic}"
    return replace(item, points=sum(points for points, there, _ in parts if there), evidence=words)


def judge_shown(view: RvizView, recordings: Sequence[Recording], rules: Rules = DEFAULT_RULES) -> Item:
    """RViz shows the marker: 10, if it is at the pillar at least at times."""
    item = Item(ITEMS[4], 0.0, 10.0, "")
    if not view.judged:
        return replace(item, points=None, evidence=f"not judged: {view.problem}")
    placed = [recording for recording in recordings if judge_place(recording, rules).points]
    published = {marker.topic for recording in placed for marker in recording.markers if not marker.problem}
    if not published:
        return replace(item, evidence="no marker at the pillar that could be shown")
    if not view.source:
        return replace(item, points=None, evidence=NO_VIEW)
    shown = sorted(published & set(view.topics))
    if not shown:
        return replace(item, evidence=f"RViz does not subscribe to {', '.join(sorted(published))}")
    return replace(item, points=10.0, evidence=f"RViz subscribes to {', '.join(shown)}")


def judge_exercise_3(
    recordings: Sequence[Recording], view: RvizView, scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """All of exercise 3: 20, 30, 20, and 20 and 10 for the marker."""
    items = [
        over_trials(recordings, judge_approach),
        over_trials(recordings, partial(judge_arrival, rules=rules)),
        judge_rviz(view, scan_topic),
        over_trials(recordings, partial(judge_place, rules=rules)),
        judge_shown(view, recordings, rules),
    ]
    return rules.apply(forfeited(items, recordings))
