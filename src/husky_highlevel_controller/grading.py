"""Judges recorded drives by the rubric of exercise 3; docs/marking.md tells the same in words.

In: `Recording`s, and what RViz showed. Out: `Item`s: points, and the evidence in a sentence.
Must not know: ROS, files, how a drive is recorded.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from math import hypot
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.recording import Recording, Shown

HALF_WAY = 0.5  # of the way to the pillar: who has come that far drives towards it
FIRST_STEPS = 0.1  # of the way: who has come that far has begun to
REACHED = 0.35  # [m], from the outline to the pillar's surface; 0.5 m from the lidar when it looks at it
TOUCH = 0.01  # [m], this near it touches
GENTLE = 0.5  # [m/s], a faster robot rams
STOPPED = 1.0  # [s], so long it must stand in the end to have stopped
MARKER_NEAR, MARKER_FAR = 0.3, 0.01  # [m], and for each metre between robot and pillar: from the centre
MARKER_LOW, MARKER_HIGH = -0.8, 1.8  # [m], heights in the world: the pillar's, and 0.3 m
MOST, SOME = 0.8, 0.2  # of the markers


@dataclass(frozen=True)
class Item:
    """One line of the table."""

    name: str
    points: Optional[float]  # None: a machine cannot judge it
    most: float
    evidence: str
    at: Optional[float] = None  # [s], simulated: the moment the evidence is about

    @property
    def full(self) -> bool:
        """All points there are, or nothing a machine could give."""
        return self.points is None or self.points >= self.most - 1e-9


@dataclass(frozen=True)
class RvizView:
    """What the submission's RViz showed."""

    source: str = ""  # where its configuration comes from; empty: there is none
    topics: Tuple[str, ...] = ()  # it subscribes to
    tf: bool = False  # frames are to be seen
    robot: bool = False  # the robot model is to be seen
    scan: bool = False  # the laser's points are to be seen
    problem: str = ""  # why there was nothing to look at
    judged: bool = True  # False: this machine cannot run RViz
    fixed_frame: str = ""


# ---------------------------------------------------------------------------- one drive


def judge_approach(recording: Recording) -> Item:
    """The Husky drives towards the pillar: 20."""
    item = Item("drives towards the pillar", 0.0, 20.0, "")
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


def judge_arrival(recording: Recording) -> Item:
    """The Husky reaches the pillar: 20 for being there, 10 for doing so under control."""
    item = Item("reaches the pillar", 0.0, 30.0, "")
    gaps, times = recording.hull_gaps, recording.times
    if not len(times):
        return replace(item, evidence="there was no drive")
    nearest = int(np.argmin(gaps))
    if gaps[nearest] > REACHED:
        at = float(times[nearest])
        words = f"nearest {gaps[nearest]:.2f} m from the pillar, wanted {REACHED:g} m, at {at:.2f} s"
        if not recording.driving[nearest + 1 :].any() and recording.driving.any():
            words = f"stops short: {words}"
        return replace(item, evidence=words, at=at)
    reached = float(times[np.argmax(gaps <= REACHED)])
    touches = np.flatnonzero(gaps <= TOUCH)
    if len(touches):
        touch = touches[0]
        at = float(times[touch])
        # the speed just before: the touch itself slows the robot down
        before = recording.speeds[(times >= at - 0.2) & (times <= at), 0]
        speed = float(np.abs(before).max())
        if speed > GENTLE:
            words = f"rams the pillar at {speed:.2f} m/s, at {at:.2f} s"
            return replace(item, points=20.0, evidence=words, at=at)
        return replace(item, points=30.0, evidence=f"touches it at {speed:.2f} m/s, at {at:.2f} s", at=at)
    stood = _stands_since(recording)
    if stood is None:
        words = (
            f"comes within {gaps[nearest]:.2f} m at {float(times[nearest]):.2f} s, but does not stop there"
        )
        return replace(item, points=20.0, evidence=words, at=reached)
    if gaps[-1] > REACHED:
        words = f"comes within {gaps[nearest]:.2f} m, but stands {gaps[-1]:.2f} m away in the end"
        return replace(item, points=20.0, evidence=words, at=reached)
    return replace(
        item, points=30.0, evidence=f"stands {gaps[-1]:.2f} m from it since {stood:.2f} s", at=stood
    )


def judge_place(recording: Recording) -> Item:
    """The marker is at the pillar: 20 for most of the time, 10 for some of it."""
    item = Item("marker at the pillar", 0.0, 20.0, "")
    if not recording.marker_topics:
        return replace(item, evidence="no topic of type visualization_msgs/Marker or MarkerArray")
    until = first_touch(recording)
    series: Dict[Tuple[str, str], List[Shown]] = defaultdict(list)
    for marker in recording.markers:
        if marker.at < until:  # after a push nobody knows where the pillar is
            series[marker.topic, marker.name].append(marker)
    if not series:
        return replace(item, evidence=f"nothing came on {', '.join(recording.marker_topics)}")
    judged = [_judge_series(recording, markers) for markers in series.values()]
    share, evidence, at = max(judged, key=lambda verdict: verdict[0])
    points = 20.0 if share >= MOST else 10.0 if share >= SOME else 0.0
    return replace(item, points=points, evidence=evidence, at=at)


def _judge_series(recording: Recording, markers: Sequence[Shown]) -> Tuple[float, str, float]:
    """How much of one marker's life it was right, in words, and when it was first right or wrong."""
    first = markers[0]
    name = f"{first.topic} in {first.frame}{', stamp 0' if first.stamp == 0.0 else ''}"
    lost = [marker for marker in markers if marker.problem]
    if len(lost) == len(markers):
        return 0.0, f"{name}: not to be seen: {lost[0].problem}", lost[0].at
    x, y = recording.pillar
    errors, right = [], []
    for marker in markers:
        row = min(int(np.searchsorted(recording.times, marker.at)), len(recording.times) - 1)
        away = hypot(x - recording.poses[row, 0], y - recording.poses[row, 1])
        error = hypot(marker.position[0] - x, marker.position[1] - y)
        errors.append(error)
        right.append(
            not marker.problem
            and error <= MARKER_NEAR + MARKER_FAR * away
            and MARKER_LOW <= marker.position[2] <= MARKER_HIGH
        )
    share = sum(right) / len(right)
    median = float(np.nanmedian(errors))
    words = (
        f"{name}: right {100.0 * share:.0f} % of the time, {median:.2f} m from the pillar's centre (median)"
    )
    if share >= MOST:
        return share, words, markers[right.index(True)].at
    wrong = markers[right.index(False)]
    px, py, pz = wrong.position
    if wrong.problem:
        words += f"; not to be seen at {wrong.at:.2f} s: {wrong.problem}"
    else:
        words += f"; at {wrong.at:.2f} s at ({px:.2f}, {py:.2f}, {pz:.2f}), the pillar at ({x:.2f}, {y:.2f})"
    return share, words, wrong.at


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
    if recording.notes:
        return f"the robot never moves: {recording.notes[0]}"
    if not recording.subscribed:
        return "the robot never moves: nobody listens to the scans"
    if not recording.command_count:
        return "the robot never moves: nothing came on cmd_vel"
    return f"the robot never moves, in spite of {recording.command_count} commands"


# ---------------------------------------------------------------------------- the whole submission


def judge_rviz(view: RvizView, scan_topic: str) -> Item:
    """RViz shows TF, robot model and laser scan: 6, 7 and 7."""
    item = Item("RViz shows TF, robot model, laser scan", 0.0, 20.0, "")
    if not view.judged:
        return replace(item, points=None, evidence=f"not judged: {view.problem}")
    if not view.source:
        return replace(item, evidence="no RViz configuration: no rviz node and no .rviz file")
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


def judge_shown(view: RvizView, recordings: Sequence[Recording]) -> Item:
    """RViz shows the marker: 10, if it is at the pillar at least at times."""
    item = Item("marker in RViz", 0.0, 10.0, "")
    if not view.judged:
        return replace(item, points=None, evidence=f"not judged: {view.problem}")
    placed = [recording for recording in recordings if judge_place(recording).points]
    published = {marker.topic for recording in placed for marker in recording.markers if not marker.problem}
    if not published:
        return replace(item, evidence="no marker at the pillar that could be shown")
    shown = sorted(published & set(view.topics))
    if not shown:
        return replace(item, evidence=f"RViz does not subscribe to {', '.join(sorted(published))}")
    return replace(item, points=10.0, evidence=f"RViz subscribes to {', '.join(shown)}")


def judge_exercise_3(recordings: Sequence[Recording], view: RvizView, scan_topic: str) -> List[Item]:
    """All of exercise 3: 20, 30, 20, and 20 and 10 for the marker."""
    return [
        over_trials(recordings, judge_approach),
        over_trials(recordings, judge_arrival),
        judge_rviz(view, scan_topic),
        over_trials(recordings, judge_place),
        judge_shown(view, recordings),
    ]


def over_trials(recordings: Sequence[Recording], judge: Callable[[Recording], Item]) -> Item:
    """The mean of all drives, with the evidence of the worst."""
    items = [judge(recording) for recording in recordings]
    number = min(range(len(items)), key=lambda n: items[n].points or 0.0)
    worst = items[number]
    if len(items) == 1:
        return worst
    points = round(float(np.mean([item.points or 0.0 for item in items])), 1)
    full = sum(item.full for item in items)
    words = f"full marks in {full} of {len(items)} drives; drive {number + 1}: {worst.evidence}"
    return replace(worst, points=points, evidence=words)


def total(items: Sequence[Item]) -> Tuple[float, float]:
    """Points, and how many a machine can give."""
    judged = [item for item in items if item.points is not None]
    return round(sum(item.points or 0.0 for item in judged), 1), sum(item.most for item in judged)
