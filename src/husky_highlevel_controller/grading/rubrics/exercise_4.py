"""The rubric of exercise 4: a filter's path of a bag, the bag's point cloud in RViz, a frame above the robot.

Both sheets are data: the Husky's of 2018, 100 points; the SMB's of 2021, 100 and a bonus of 10.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Callable, Dict, List, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.grading.displays import RvizView
from husky_highlevel_controller.grading.notes import Kind, Note, Subject
from husky_highlevel_controller.grading.recording import Playback, Recording
from husky_highlevel_controller.grading.records import DEFAULT_RULES, Item, Rules
from husky_highlevel_controller.grading.rubrics.causes import causes, hint_on
from husky_highlevel_controller.grading.rubrics.exercise_3 import DISPLAYS, without_config
from husky_highlevel_controller.grading.rubrics.items import forfeited, weighted

FILTERED = "/odometry/filtered"
CLOUDS = {"/rslidar_points", "/velodyne/assembled_cloud_filtered"}  # of our bags; of the Husky's of 2018
MIN_ESTIMATES = 10
BEGIN, END = 5.0, 2.0  # [s], after the begin and before the end of the bag: between them it must estimate
TOLERANCE, TOLERANCE_OF_LENGTH = 1.0, 0.02  # [m] from the true path, and of its length: the larger counts
ABOVE, NEAR = (0.0, 0.0, 2.0), 0.1  # [m], place of the top view in base_link; so near it is there
COLOURING, SIZE, SAME_SIZE = "AxisColor Z", 0.05, 0.005  # of the cloud's points [m]

PLOT = "plot x and y of /odometry/filtered: pose/pose/position/x and .../y, and save the configuration"
INPUTS = "compare the filter's inputs with `rosbag info`: are localization.yaml and use_sim_time loaded?"
TOP_VIEW = "publish it by static_transform_publisher: args=0 0 2 0 0 0 base_link smb_top_view"
STYLE = "in the display PointCloud2: Color Transformer AxisColor, Axis Z, Size (m) 0.05"
PLAYS = "a node of rosbag, type play, with args=--clock --rate=0.5 and the bag's file"
Judge = Callable[[Item, Recording, RvizView, Rules], Item]
_RATE = re.compile(r"(?:^|\s)(?:-r\s*|--rate(?:=|\s+))(\d*\.?\d+)")
_POSITION = re.compile(r"(?P<topic>.+)/pose/pose/position/x")


def judge_by_person(item: Item, _recording: Recording, _view: RvizView, _rules: Rules) -> Item:
    """An explanation, which a person judges."""
    return replace(item, points=None, evidence="for a person")


def judge_plot(item: Item, recording: Recording, _view: RvizView, _rules: Rules) -> Item:
    """The path is plotted in rqt_multiplot: all, or half of another topic; a person where no file is."""
    curves = (recording.playback or Playback()).curves
    if not curves:
        return replace(item, points=None, evidence="for a person: no configuration of rqt_multiplot")
    xs = [_POSITION.fullmatch(x) for x, y in curves if y == x[:-1] + "y"]
    topics = [match["topic"] for match in xs if match]
    evidence = "rqt_multiplot: " + "; ".join(f"x {x}, y {y}" for x, y in curves[:3])
    share = 1.0 if FILTERED in topics else 0.5 * bool(topics)
    return replace(item, points=share * item.max_points, evidence=evidence, hint=PLOT)


def judge_path(item: Item, recording: Recording, _view: RvizView, _rules: Rules) -> Item:
    """The filter's path of the bag is complete and true: all; half if it comes and differs."""
    playback = recording.playback or Playback()
    if len(playback.path) < MIN_ESTIMATES or not len(recording.times):
        cause = _cause(recording)
        evidence = f"{len(playback.path)} estimates on {playback.topic or FILTERED}: {cause.text}"
        return replace(item, evidence=evidence, hint=hint_on(cause) if recording.subscribed else INPUTS)
    stamps, end = playback.path[:, 0], float(recording.times[-1])
    true = [np.interp(stamps, recording.times, column) for column in recording.poses[:, :2].T]
    off = float(np.hypot(*(playback.path[:, 1:].T - true)).max())
    length = float(np.hypot(*np.diff(recording.poses[:, :2], axis=0).T).sum())
    is_whole = stamps[0] <= BEGIN and stamps[-1] >= end - END
    is_true = off <= max(TOLERANCE, TOLERANCE_OF_LENGTH * length)
    evidence = f"{playback.topic}: from {stamps[0]:.1f} to {stamps[-1]:.1f} of {end:.1f} s, "
    evidence += f"up to {off:.2f} m from the true path of {length:.1f} m"
    share = 1.0 if is_whole and is_true else 0.5
    return replace(item, points=share * item.max_points, evidence=evidence, hint=INPUTS)


def _cause(recording: Recording) -> Note:
    """Cause for which no estimate came."""
    silent = ", ".join(topic for topic in recording.silent_topics if topic.rpartition("/")[2] != "set_pose")
    if silent and not causes(recording):
        return Note(Kind.SILENT_TOPIC, f"it listens to {silent}, where nothing is sent")
    return (causes(recording) or [Note(Kind.NO_SCANS, "nothing listens to the bag's wheel odometry")])[0]


def judge_cloud(item: Item, _recording: Recording, view: RvizView, rules: Rules) -> Item:
    """RViz shows the bag's point cloud."""
    if not view.source:
        return without_config(item, view, rules)
    topics = ", ".join(cloud.source for cloud in view.clouds)
    evidence = view.problem or f"{view.source}: point cloud of {topics or 'no topic'}"
    is_visible = not view.problem and any(cloud.source in CLOUDS for cloud in view.clouds)
    hint = f"a display PointCloud2 of /rslidar_points; {DISPLAYS}"
    return replace(item, points=item.max_points * is_visible, evidence=evidence, hint=hint)


def judge_style(item: Item, _recording: Recording, view: RvizView, rules: Rules) -> Item:
    """The cloud's points are coloured by z, and 0.05 m large: half each."""
    if not view.source:
        return without_config(item, view, rules)
    halves = [
        ((cloud.colouring == COLOURING) + (abs(cloud.size - SIZE) <= SAME_SIZE), cloud)
        for cloud in view.clouds
    ]
    share, cloud = max(halves, key=lambda half: half[0], default=(0, None))
    evidence = f"{view.source}: " + (f"{cloud.colouring}, {cloud.size:g} m" if cloud else "no point cloud")
    return replace(item, points=share / 2.0 * item.max_points, evidence=evidence, hint=STYLE)


def judge_top_view(item: Item, recording: Recording, _view: RvizView, _rules: Rules) -> Item:
    """The top view is 2 m above base_link at three moments of the drive."""
    rows = (recording.playback or Playback()).top_view
    if len(rows) < 3:
        return replace(item, evidence="no transform from base_link to smb_top_view", hint=TOP_VIEW)
    moments = rows[np.linspace(0, len(rows) - 1, 5).astype(int)[1:4]]
    is_there = bool((np.linalg.norm(moments[:, 1:] - ABOVE, axis=1) <= NEAR).all())
    places = "; ".join(f"({x:.2f}, {y:.2f}, {z:.2f}) m at {at:.1f} s" for at, x, y, z in moments)
    return replace(item, points=item.max_points * is_there, evidence=f"in base_link: {places}", hint=TOP_VIEW)


def judge_player(item: Item, recording: Recording, _view: RvizView, _rules: Rules) -> Item:
    """The launch file plays the bag; for the second bonus, at half speed."""
    players = (recording.playback or Playback()).players
    calls = "; ".join(re.sub(r"[^\s=]*/", "", player) for player in players)  # no folder of this machine
    evidence = f"its launch file plays: {calls}" if players else "its launch file plays no bag"
    rates = [float(rate) for player in players for rate in _RATE.findall(player)]
    does = 0.5 in rates if item.name == HALF_SPEED else bool(players)
    return replace(item, points=item.max_points * does, evidence=evidence, hint=PLAYS)


HALF_SPEED = "bonus: at half speed"
# items with their points of the Husky's and of the SMB's sheet
SHEETS: Dict[str, Tuple[float, float, Subject, Judge]] = {
    "explains the filter": (0.0, 10.0, Subject.CODE, judge_by_person),
    "explains its topics": (0.0, 10.0, Subject.CODE, judge_by_person),
    "plots the simulated path": (30.0, 20.0, Subject.CODE, judge_plot),
    "recorded path": (40.0, 30.0, Subject.DRIVE, judge_path),
    "RViz shows the point cloud": (30.0, 10.0, Subject.DISPLAYS, judge_cloud),
    "style of the point cloud": (0.0, 10.0, Subject.DISPLAYS, judge_style),
    "top view moves with the robot": (0.0, 10.0, Subject.DRIVE, judge_top_view),
    "bonus: plays the bag": (0.0, 5.0, Subject.CODE, judge_player),
    HALF_SPEED: (0.0, 5.0, Subject.CODE, judge_player),
}
ITEMS = tuple(SHEETS)


def judge_exercise_4(
    recordings: Sequence[Recording], view: RvizView, _scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Items of the sheet of the robot whose bag was played."""
    items = []
    for name, (husky, smb, subject, judge) in SHEETS.items():
        points = smb if recordings[0].robot == "smb" else husky
        if points:
            item = Item(name, 0.0, points, "", subject=subject)
            items.append(judge(item, recordings[0], view, rules))
    return weighted(forfeited(items, recordings), rules)
