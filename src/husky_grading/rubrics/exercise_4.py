"""The rubric of exercise 4: a filter's path of a bag, the bag's point cloud in RViz, a frame above the robot.

Both sheets are data: the Husky's of 2018, 100 points; the SMB's of 2021, 100 and a bonus of 10.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from husky_grading.displays import RvizView
from husky_grading.notes import Kind, Note, Subject
from husky_grading.recording import FILTERED, Playback, Recording
from husky_grading.records import DEFAULT_RULES, Item, Rules
from husky_grading.rubrics.causes import causes, hint_on
from husky_grading.rubrics.exercise_3 import DISPLAYS, without_config
from husky_grading.rubrics.items import forfeited, weighted

CLOUDS = {"/rslidar_points", "/velodyne/assembled_cloud_filtered"}  # of our bags; of the Husky's of 2018
MIN_ESTIMATES = 10
BEGIN, END = 5.0, 2.0  # [s], after the begin and before the end of the bag: between them it must estimate
GAP = 5.0  # [s], between two estimates, by their stamps
TOLERANCE, TOLERANCE_OF_LENGTH = 1.0, 0.02  # [m] from the true path, and of its length: the larger counts
ABOVE, NEAR = (0.0, 0.0, 2.0), 0.1  # [m], place of the top view in base_link; so near it is there
COLOURING, SIZE, SAME_SIZE = "AxisColor Z", 0.05, 0.005  # of the cloud's points [m]

PLOT = "plot x and y of /odometry/filtered: pose/pose/position/x and .../y, and save the configuration"
INPUTS = "compare the filter's inputs with `rosbag info`: are localization.yaml and use_sim_time loaded?"
TOP_VIEW = "publish it by static_transform_publisher: args=0 0 2 0 0 0 base_link smb_top_view"
RENAME = "the frame {} is there, but it must be called smb_top_view"
CLOUD = f"a display PointCloud2 of /rslidar_points; {DISPLAYS}"
STYLE = "in the display PointCloud2: Color Transformer AxisColor, Axis Z, Size (m) 0.05"
PLAYS = "a node of rosbag, type play, with args=--clock --rate=0.5 and the bag's file"
# share of the points, None where a person judges; evidence; what to look at
Verdict = Tuple[Optional[float], str, str]
BY_PERSON: Verdict = (None, "for a person", "")
_RATE = re.compile(r"(?:^|\s)(?:-r\s*|--rate(?:=|\s+))(\d*\.?\d+)")
_FOLDERS = re.compile(r"(?<![^\s=])[^\s=]*/")  # of a file's path, up to its name
_POSITION = re.compile(r"(?P<topic>.+)/pose/pose/position/x")


def judge_plot(_recording: Recording, playback: Playback, _view: RvizView) -> Verdict:
    """The path is plotted in rqt_multiplot: all, or half of another topic; a person where no file is."""
    if not playback.curves:
        return None, "for a person: no configuration of rqt_multiplot", PLOT
    xs = [_POSITION.fullmatch(x) for x, y in playback.curves if y == x[:-1] + "y"]
    topics = [match["topic"] for match in xs if match]
    evidence = "rqt_multiplot: " + "; ".join(f"x {x}, y {y}" for x, y in playback.curves[:3])
    return 1.0 if FILTERED in topics else 0.5 * bool(topics), evidence, PLOT


def judge_path(recording: Recording, playback: Playback, _view: RvizView) -> Verdict:
    """The filter's path of the bag is complete and true: all; half if it comes and differs."""
    path = playback.path[np.isfinite(playback.path).all(axis=1)]  # one that is not a number is no estimate
    estimates = len(path)
    if estimates < MIN_ESTIMATES or not len(recording.times):
        cause = _cause(recording)
        evidence = f"{estimates} estimates on {playback.topic or FILTERED}: {cause.text}"
        return 0.0, evidence, hint_on(cause) if recording.subscribed else INPUTS
    stamps, end = path[:, 0], float(recording.times[-1])
    true = [np.interp(stamps, recording.times, column) for column in recording.poses[:, :2].T]
    off = float(np.hypot(*(path[:, 1:].T - true)).max())
    length = float(np.hypot(*np.diff(recording.poses[:, :2], axis=0).T).sum())
    gap = float(np.diff(np.sort(stamps)).max())
    is_whole = stamps[0] <= BEGIN and stamps[-1] >= end - END and gap <= GAP
    is_true = off <= max(TOLERANCE, TOLERANCE_OF_LENGTH * length)
    evidence = f"{playback.topic}: from {stamps[0]:.1f} to {stamps[-1]:.1f} of {end:.1f} s, "
    evidence += f"at most {gap:.1f} s apart, up to {off:.2f} m from the true path of {length:.1f} m"
    return 1.0 if is_whole and is_true else 0.5, evidence, INPUTS


def _cause(recording: Recording) -> Note:
    """Cause for which no estimate came."""
    silent = ", ".join(topic for topic in recording.silent_topics if topic.rpartition("/")[2] != "set_pose")
    if silent and not causes(recording):
        return Note(Kind.SILENT_TOPIC, f"it listens to {silent}, where nothing is sent")
    return (causes(recording) or [Note(Kind.NO_SCANS, "nothing listens to the bag's wheel odometry")])[0]


def judge_cloud(_recording: Recording, _playback: Playback, view: RvizView) -> Verdict:
    """RViz shows the bag's point cloud."""
    topics = [cloud.source for cloud in view.clouds]
    evidence = view.problem or f"{view.source}: point cloud of {', '.join(topics) or 'no topic'}"
    return float(not view.problem and not CLOUDS.isdisjoint(topics)), evidence, CLOUD


def judge_style(_recording: Recording, _playback: Playback, view: RvizView) -> Verdict:
    """The cloud's points are coloured by z, and 0.05 m large: half each."""
    styles = [
        (
            0.5 * (cloud.colouring == COLOURING) + 0.5 * (abs(cloud.size - SIZE) <= SAME_SIZE),
            f"{cloud.colouring}, {cloud.size:g} m",
        )
        for cloud in view.clouds
    ]
    share, style = max(styles, default=(0.0, "no point cloud"))
    return share, f"{view.source}: {style}", STYLE


def judge_top_view(_recording: Recording, playback: Playback, _view: RvizView) -> Verdict:
    """The top view is 2 m above base_link at three moments of the drive."""
    rows = playback.top_view
    if len(rows) < 3:
        other = next((frame for frame, place in sorted(playback.places.items()) if _is_above(place)), "")
        evidence = "no transform from base_link to smb_top_view"
        if other:
            return 0.0, f"{evidence}, but {other} is 2 m above it", RENAME.format(other)
        return 0.0, evidence, TOP_VIEW
    moments = rows[np.linspace(0, len(rows) - 1, 5).astype(int)[1:4]]
    is_there = all(_is_above(place) for place in moments[:, 1:])
    places = "; ".join(f"({x:.2f}, {y:.2f}, {z:.2f}) m at {at:.1f} s" for at, x, y, z in moments)
    return float(is_there), f"in base_link: {places}", TOP_VIEW


def _is_above(place: Sequence[float]) -> bool:
    """Whether a place in base_link [m] is that of the top view."""
    return float(np.linalg.norm(np.subtract(place, ABOVE))) <= NEAR


def judge_player(_recording: Recording, playback: Playback, _view: RvizView) -> Verdict:
    """The launch file plays a bag."""
    calls = "; ".join(_FOLDERS.sub("", player) for player in playback.players)
    return float(bool(calls)), f"its launch file plays {calls or 'no bag'}", PLAYS


def judge_half_speed(recording: Recording, playback: Playback, view: RvizView) -> Verdict:
    """The launch file plays a bag at half speed."""
    rates = [float(rate) for player in playback.players for rate in _RATE.findall(player)]
    return float(0.5 in rates), *judge_player(recording, playback, view)[1:]


# items with their points of the Husky's and of the SMB's sheet
SHEETS: Dict[str, Tuple[float, float, Subject, Callable[[Recording, Playback, RvizView], Verdict]]] = {
    "explains the filter": (0.0, 10.0, Subject.CODE, lambda *_: BY_PERSON),
    "explains its topics": (0.0, 10.0, Subject.CODE, lambda *_: BY_PERSON),
    "plots the simulated path": (30.0, 20.0, Subject.CODE, judge_plot),
    "recorded path": (40.0, 30.0, Subject.DRIVE, judge_path),
    "RViz shows the point cloud": (30.0, 10.0, Subject.DISPLAYS, judge_cloud),
    "style of the point cloud": (0.0, 10.0, Subject.DISPLAYS, judge_style),
    "top view moves with the robot": (0.0, 10.0, Subject.DRIVE, judge_top_view),
    "bonus: plays the bag": (0.0, 5.0, Subject.CODE, judge_player),
    "bonus: at half speed": (0.0, 5.0, Subject.CODE, judge_half_speed),
}
ITEMS = tuple(SHEETS)


def judge_exercise_4(
    recordings: Sequence[Recording], view: RvizView, _scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Items of the sheet of the robot whose bag was played."""
    recording, items = recordings[0], []
    for name, (husky, smb, subject, judge) in SHEETS.items():
        item = Item(name, 0.0, smb if recording.robot == "smb" else husky, "", subject=subject)
        if subject is Subject.DISPLAYS and not view.source:
            items.append(without_config(item, view, rules))
        else:
            share, evidence, hint = judge(recording, recording.playback or Playback(), view)
            points = None if share is None else share * item.max_points
            items.append(replace(item, points=points, evidence=evidence, hint=hint))
    return weighted(forfeited([item for item in items if item.max_points], recordings), rules)
