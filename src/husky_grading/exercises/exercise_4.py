"""Exercise 4: a filter estimates the path of a bag, RViz shows its point cloud, a frame is above the robot.

Marking plays the bag of the robot to the filter that the submission starts, so no node drives. `SHEETS` has
the points of both exercise sheets: Husky of 2018, 100 points; SMB of 2021, 100 points and a bonus of 10.
"""

from __future__ import annotations

import re
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from husky_grading.displays import RvizView
from husky_grading.drive.bring_up import once_up, set_robot_parameters
from husky_grading.drive.ros_graph import is_published
from husky_grading.drive.trials import Trial
from husky_grading.exercises.exercise import Exercise
from husky_grading.exercises.watch import DriveState, RosAccess, Watch
from husky_grading.hand_in.facts import Facts
from husky_grading.hand_in.package_files import first_mention
from husky_grading.isolation.files import UnreadableFileError, read_xml, walk
from husky_grading.isolation.forked import BAG_PLAYER
from husky_grading.isolation.own_files import VisibleCode
from husky_grading.isolation.process import Process
from husky_grading.isolation.ros_network import Network
from husky_grading.notes import Kind, Note, Subject
from husky_grading.recording import EstimatedPath, Recording, table
from husky_grading.records import DEFAULT_ROBOT, DEFAULT_RULES, SMB, Item, MarkingConfig, Rules
from husky_grading.rubrics.causes import causes, hint_on, silent_text
from husky_grading.rubrics.items import by_hand, forfeited, weighted
from husky_grading.rubrics.rviz_view import DISPLAYS, without_config
from husky_grading.submission import NamedRobot, Plan, RobotPackages
from husky_highlevel_controller.robot import load_robot

FILTERED, ODOMETRY = "/odometry/filtered", "nav_msgs/Odometry"  # topic of the filter's estimate, and its type
PLAYER = "rosbag/play"  # package/type of the node that plays a bag
TOP_VIEW_FRAME = "smb_top_view"
MAX_FILE = 1_000_000  # [bytes] larger configuration files of rqt_multiplot are not read
# at most MAX_CURVES curves of a package are read; longer names of topics and fields are cut to MAX_NAME
# characters
MAX_CURVES, MAX_NAME = 100, 200
MAX_ESTIMATES = 50_000
# [s] the bag counts as played when only this time is left, because the last true pose may come before the end
BAG_MARGIN = 0.1
# After the bag's end, the run waits for the last estimates. It ends as soon as the stamp of an estimate is at
# most LAST_MARGIN [s] before the bag's end, or if no estimate has come for the wall time SILENCE [s].
LAST_MARGIN, SILENCE = 1.0, 10.0
# A package that names one of these packages is for the SMB. The names /rslidar_points and smb_top_view prove
# nothing, because a package for the Husky may have them, too.
PACKAGES_OF_THE_SMB = re.compile(r"\bsmb_(?:control|description)\b")
# topics of the point cloud, in our bags and on the exercise sheet of 2018
CLOUD_TOPICS = {"/rslidar_points", "/velodyne/assembled_cloud_filtered"}
MIN_ESTIMATES = 10
# [s] a path is complete only if its first estimate is at most LATEST_BEGIN after the bag's begin, and its
# last estimate at most END_MARGIN before the bag's end
LATEST_BEGIN, END_MARGIN = 5.0, 2.0
MAX_GAP = 5.0  # [s] longest allowed time between the stamps of two estimates
# largest allowed error of the path: TOLERANCE [m], or this fraction of the path's length if that is more
TOLERANCE, TOLERANCE_OF_LENGTH = 1.0, 0.02
# [m] required position of the frame smb_top_view in base_link; its tolerance
ABOVE, NEAR = (0.0, 0.0, 2.0), 0.1
COLOURING = "AxisColor Z"  # required colouring of the point cloud
SIZE, SIZE_TOLERANCE = 0.05, 0.005  # [m] required size of the points, and tolerance of this size

PLOT_HINT = "plot x and y of /odometry/filtered: pose/pose/position/x and .../y, and save the configuration"
INPUTS_HINT = (
    "compare the filter's inputs with `rosbag info`, and check that localization.yaml and use_sim_time are "
    "loaded"
)
TOP_VIEW_HINT = "publish it by static_transform_publisher: args=0 0 2 0 0 0 base_link smb_top_view"
CLOUD_HINT = f"add a display PointCloud2 of /rslidar_points; {DISPLAYS}"
STYLE_HINT = "set in the display PointCloud2: Color Transformer AxisColor, Axis Z, Size (m) 0.05"
RENAME_HINT = "the frame {} is at the right place, but it must be called smb_top_view"
PLAYS_HINT = "start a node of rosbag, type play, with args=--clock --rate=0.5 and the bag's file"
# option of `rosbag play` that sets the speed of the bag
_RATE = re.compile(r"(?:^|\s)(?:-r\s*|--rate(?:=|\s+))(\d*\.?\d+)")
# pattern of the folders in a path, which are left out of the report
_FOLDERS = re.compile(r"(?<![^\s=])[^\s=]*/")
_POSITION = re.compile(r"(?P<topic>.+)/pose/pose/position/x")


class Verdict(NamedTuple):
    """Judgement of one item, whose points depend on the exercise sheet."""

    share: Optional[float]  # fraction of the points, 0 to 1; None if the item is graded by hand
    evidence: str
    hint: str


@dataclass(frozen=True, eq=False)
class Playback:
    """Facts of a submission, and observations while a bag was played to its filter."""

    top_view: np.ndarray = table("[s, m, m, m] times and positions of smb_top_view in base_link", 4)
    players: Tuple[str, ...] = ()  # arguments of each `rosbag play` in the launch file of the submission
    # curves in the submission's rqt_multiplot files: quantity along x and quantity along y, each as
    # /topic/field
    curves: Tuple[Tuple[str, str], ...] = ()
    # [m] Positions of all frames in base_link at the end of the run. They are kept only if there was no frame
    # smb_top_view, because the top view may have another name.
    places: Mapping[str, Tuple[float, float, float]] = field(default_factory=dict)


def named_bag(planned: Plan) -> NamedRobot:
    """Return the robot whose bag is played: the SMB if the package names packages of the SMB.

    The choice is certain, so it does not change if the submission subscribes to another robot's scans.
    """
    mention = first_mention(planned, PACKAGES_OF_THE_SMB)
    if mention:
        why = f"the SMB's bag is played, because {mention.path.name} names {mention.match.group()}"
        return NamedRobot(SMB, why, is_certain=True)
    why = "the Husky's bag is played, because the package names no package of the SMB"
    return NamedRobot(DEFAULT_ROBOT, why, is_certain=True)


def read_facts(planned: Plan) -> Mapping[str, Any]:
    """Return the bags that the launch file plays, and the curves that rqt_multiplot draws."""
    players = [arguments for node, arguments in planned.left_out_arguments if node == PLAYER]
    curves = curves_in(planned.package_path) if planned.package_path else ()
    return {"players": players, "curves": [list(curve) for curve in curves]}


def curves_in(package: Path) -> Tuple[Tuple[str, str], ...]:
    """Return the quantity on x and the quantity on y of each curve of rqt_multiplot, as /topic/field."""
    curves = []
    for path in walk(package):
        if path.suffix != ".xml":
            continue
        with suppress(UnreadableFileError):
            root = read_xml(path, MAX_FILE)
            if root.tag == "rqt_multiplot":
                for axes in root.iter("axes"):  # each curve has one element `axes`
                    quantities = _quantities(axes)
                    if quantities:
                        curves.append(quantities)
    return tuple(curves[:MAX_CURVES])


def _quantities(axes: Any) -> Optional[Tuple[str, str]]:
    """Return the quantity on x and the quantity on y of a curve, each as /topic/field.

    Return None if one of them is missing. `axes` is the XML element of the curve's two axes.
    """
    quantities = []
    for tag in ("x_axis", "y_axis"):
        axis = axes.find(tag)
        if axis is None:
            return None
        topic, field_name = axis.findtext("topic"), axis.findtext("field")
        if not topic or not field_name:
            return None
        quantities.append(f"/{topic.strip('/')}/{field_name}"[:MAX_NAME])
    x_quantity, y_quantity = quantities
    return x_quantity, y_quantity


def play(network: Network, trial: Trial, config: MarkingConfig, truth_socket: str = "") -> Process:
    """Start the player of the robot's bag in the simulator's place, and return it when it is up.

    The player writes the true poses to the socket with the path `truth_socket`, as the simulator does.

    Raises:
        MarkingError: the player does not start.
    """
    set_robot_parameters(network, config)
    # the arguments are the robot, the random seed, the real-time factor and the length of the bag [s]
    command = [BAG_PLAYER, config.robot_name, *map(str, (trial.seed, config.pace, config.deadline))]
    player = network.start("simulator", command, HUSKY_TRUTH_SOCKET=truth_socket)
    # the bag player advertises /clock after all other topics, so it is ready when /clock is there
    return once_up(player, lambda: is_published(network.uri, "/clock"))


class FilterWatch(Watch):
    """Keeps the filter's estimates and the positions of smb_top_view until the bag has been played."""

    follows = frozenset({ODOMETRY})
    reads_scans = False

    def __init__(self, initial: Recording, ros: RosAccess) -> None:
        super().__init__(initial, ros)
        # [s, m, m] stamp, x and y of each estimate, by topic
        self._paths: Dict[str, List[Tuple[float, float, float]]] = {}
        # [s, m, m, m] simulated time, and position of the frame smb_top_view in base_link
        self._top_view: List[Tuple[float, ...]] = []
        # [s] wall time of the last estimate; before the first one, wall time at which the watch began
        self._last_estimate_at = time.monotonic()

    @property
    def input_topic(self) -> str:
        """Return the topic of the bag's wheel odometry."""
        return f"/{load_robot(self._initial_recording.robot).topics.wheel_odometry}"

    def is_submission_ready(self, state: DriveState) -> bool:
        """Return whether the submission subscribes to the bag's odometry; it need not send commands."""
        return state.subscribed

    def on_message(self, topic: str, message: Any) -> None:
        """Keep the estimate in a message, at most MAX_ESTIMATES for each topic."""
        self._last_estimate_at = time.monotonic()
        path = self._paths.setdefault(topic, [])
        if len(path) < MAX_ESTIMATES:
            place = message.pose.pose.position
            path.append((message.header.stamp.to_sec(), place.x, place.y))

    def look(self, state: DriveState) -> Optional[Note]:
        """Keep the position of smb_top_view, and return why the run is over, or None if it goes on."""
        place = self._ros.place(TOP_VIEW_FRAME)  # position in base_link [m]; None if there is no such frame
        # [s] simulated time of the last kept position; at most one position is kept for each time
        latest = self._top_view[-1][0] if self._top_view else 0.0
        if place is not None and state.now > latest:
            self._top_view.append((state.now, *place))
        if state.abandoned:
            return Note(Kind.NODES_ENDED, "its nodes had ended")
        # [s] simulated time at which the bag counts as played; the bag ends at the deadline of the run
        end = self._initial_recording.deadline - BAG_MARGIN
        if state.now < end or self._waits_for_estimates(end):
            return None
        return Note(Kind.PLAN_DONE, "the bag was played")

    def _waits_for_estimates(self, end: float) -> bool:
        """Return whether the filter may still send its estimates of the last part of the bag.

        A slow filter sends these estimates only after the bag's end [s]. Nothing more is expected if no
        estimate has come at all, if the stamp of the last one is near the bag's end, or if none has come for
        SILENCE.

        A filter may also go on sending estimates whose stamps never come near the end. `drive/run.py` then
        ends the run, because simulated time has stood still for too long.
        """
        if not self._paths:  # no estimate has come
            return False
        for path in self._paths.values():
            # a path is empty for a moment, because `on_message` adds its first point in another thread
            if path:
                last_stamp, _, _ = path[-1]
                if last_stamp >= end - LAST_MARGIN:
                    return False
        seconds_without_estimate = time.monotonic() - self._last_estimate_at  # wall time
        return seconds_without_estimate <= SILENCE

    def kept(self) -> Dict[str, Any]:
        """Return the positions of smb_top_view; if it never came, the positions of all other frames."""
        places = {} if self._top_view else self._ros.places()
        return {"top_view": np.array(self._top_view).reshape(-1, 4), "places": places}

    @property
    def estimate(self) -> EstimatedPath:
        """Return the path on the topic FILTERED; if no estimate came there, the longest path."""
        topic = FILTERED
        if not self._paths.get(FILTERED):
            topic = max(self._paths, key=lambda name: len(self._paths[name]), default="")
        return EstimatedPath(topic, np.array(self._paths.get(topic, ())).reshape(-1, 3))


def judge_plot(_recording: Recording, playback: Playback, _view: RvizView) -> Verdict:
    """Grade whether rqt_multiplot plots the path: all points for the topic FILTERED, half for another topic.

    Without a configuration of rqt_multiplot the item is graded by hand.
    """
    if not playback.curves:
        return Verdict(None, by_hand("no configuration of rqt_multiplot was handed in"), PLOT_HINT)
    topics = []  # topics of the curves that show a path: y of the topic's position over x of this position
    for x, y in playback.curves:
        match = _POSITION.fullmatch(x)
        if match and y == f"{match['topic']}/pose/pose/position/y":
            topics.append(match["topic"])
    shown_curves = playback.curves[:3]  # more curves would make the sentence too long
    evidence = "rqt_multiplot: " + "; ".join(f"x {x}, y {y}" for x, y in shown_curves)
    share = 0.0
    if FILTERED in topics:
        share = 1.0
    elif topics:
        share = 0.5
    return Verdict(share, evidence, PLOT_HINT)


def judge_path(recording: Recording, _playback: Playback, _view: RvizView) -> Verdict:
    """Grade the filter's path of the bag: all points if it is complete and accurate, otherwise half of them.

    With fewer than MIN_ESTIMATES estimates there are no points.
    """
    estimate = recording.estimate or EstimatedPath()
    # (N, 3) [s, m, m] stamp, x and y of each estimate; estimates with NaN or infinity are left out
    path = estimate.points[np.isfinite(estimate.points).all(axis=1)]
    if len(path) < MIN_ESTIMATES or not len(recording.times):
        why, hint = _explain_few_estimates(recording)
        return Verdict(0.0, f"{len(path)} estimates on {estimate.topic or FILTERED}: {why}", hint)
    stamps = path[:, 0]
    end = float(recording.times[-1])  # [s] end of the bag
    largest_error = _largest_error(path, recording)
    true_x, true_y = recording.poses[:, :2].T  # (M,) [m] each, in the world
    length = float(np.hypot(np.diff(true_x), np.diff(true_y)).sum())  # [m] length of the true path
    largest_gap = float(np.diff(np.sort(stamps)).max())  # [s] longest time between two estimates
    is_whole = stamps[0] <= LATEST_BEGIN and stamps[-1] >= end - END_MARGIN and largest_gap <= MAX_GAP
    is_accurate = largest_error <= max(TOLERANCE, TOLERANCE_OF_LENGTH * length)
    evidence = f"{estimate.topic}: estimates from {stamps[0]:.1f} to {stamps[-1]:.1f} of {end:.1f} s, "
    evidence += f"at most {largest_gap:.1f} s apart, up to {largest_error:.2f} m from the true path of "
    evidence += f"{length:.1f} m"
    return Verdict(1.0 if is_whole and is_accurate else 0.5, evidence, INPUTS_HINT)


def _largest_error(path: np.ndarray, recording: Recording) -> float:
    """Return the largest distance [m] of an estimate from the true position at the same time.

    The bag's robot starts at the origin of the world, so estimates in odom are also positions in the world.
    `path` has stamp, x and y of each estimate, (N, 3) [s, m, m].
    """
    stamps, x, y = path.T  # (N,) each
    true_x, true_y = recording.poses[:, :2].T  # (M,) [m] each, in the world
    # the true poses have other times than the estimates, so the true positions are interpolated
    x_errors = x - np.interp(stamps, recording.times, true_x)
    y_errors = y - np.interp(stamps, recording.times, true_y)
    return float(np.hypot(x_errors, y_errors).max())


def _explain_few_estimates(recording: Recording) -> Tuple[str, str]:
    """Return why fewer than MIN_ESTIMATES estimates came, as a part of a sentence, and the hint on it."""
    reasons = causes(recording)
    if reasons:  # such as a node that has crashed
        return reasons[0].text, hint_on(reasons[0])
    # the filter itself subscribes to `set_pose`, so a missing publisher of this topic is not the cause
    silent = ", ".join(topic for topic in recording.silent_topics if topic.rpartition("/")[2] != "set_pose")
    if recording.subscribed and silent:
        cause = Note(Kind.SILENT_TOPIC, silent_text(silent))
        return cause.text, hint_on(cause)
    if recording.subscribed:
        return "a node gets the bag's wheel odometry, but none publishes nav_msgs/Odometry", INPUTS_HINT
    # no node gets even the wheel odometry of the bag, so the hint is on all inputs
    if silent:
        return silent_text(silent), INPUTS_HINT
    return "no node subscribes to the bag's wheel odometry", INPUTS_HINT


def judge_cloud(_recording: Recording, _playback: Playback, view: RvizView) -> Verdict:
    """Grade whether RViz shows the bag's point cloud."""
    if view.problem:  # RViz shows nothing
        return Verdict(0.0, view.problem, CLOUD_HINT)
    topics = [cloud.source for cloud in view.clouds]
    evidence = f"{view.source}: point cloud of {', '.join(topics) or 'no topic'}"
    is_shown = any(topic in CLOUD_TOPICS for topic in topics)
    return Verdict(1.0 if is_shown else 0.0, evidence, CLOUD_HINT)


def judge_style(_recording: Recording, _playback: Playback, view: RvizView) -> Verdict:
    """Grade whether the point cloud is coloured by z (half), and its points are 0.05 m large (half).

    If RViz shows several point clouds, the one with the best style counts.
    """
    styles = []  # fraction of the item's points, and a description, for each point cloud
    for cloud in view.clouds:
        share = 0.5 if cloud.colouring == COLOURING else 0.0
        if abs(cloud.size - SIZE) <= SIZE_TOLERANCE:
            share += 0.5
        styles.append((share, f"{cloud.colouring}, {cloud.size:g} m"))
    share, style = max(styles, default=(0.0, "no point cloud"))
    return Verdict(share, f"{view.source}: {style}", STYLE_HINT)


def judge_top_view(_recording: Recording, playback: Playback, _view: RvizView) -> Verdict:
    """Grade whether the frame smb_top_view is 2 m above base_link at three moments of the run."""
    rows = playback.top_view  # (N, 4) [s, m, m, m] time, and position of smb_top_view in base_link
    if len(rows) < 3:  # too few for three moments
        # if the frame never came, `places` has the positions of all other frames; one of them may be the top
        # view under a wrong name
        frames_above = [frame for frame, place in sorted(playback.places.items()) if _is_above(place)]
        evidence = "no transform from base_link to smb_top_view"
        if frames_above:
            evidence += f", but {frames_above[0]} is 2 m above it"
            return Verdict(0.0, evidence, RENAME_HINT.format(frames_above[0]))
        return Verdict(0.0, evidence, TOP_VIEW_HINT)
    # rows after one, two and three quarters of all rows
    quarters = np.linspace(0, len(rows) - 1, 5).astype(int)
    moments = rows[quarters[1:4]]
    is_there = all(_is_above(place) for place in moments[:, 1:])
    places = "; ".join(f"({x:.2f}, {y:.2f}, {z:.2f}) m at {at:.1f} s" for at, x, y, z in moments)
    return Verdict(float(is_there), f"in base_link: {places}", TOP_VIEW_HINT)


def _is_above(place: Sequence[float]) -> bool:
    """Return whether a position in base_link [m] is the right one for the top view."""
    return float(np.linalg.norm(np.subtract(place, ABOVE))) <= NEAR


def judge_player(_recording: Recording, playback: Playback, _view: RvizView) -> Verdict:
    """Grade whether the launch file plays a bag."""
    # arguments of each `rosbag play`, with file names instead of paths
    calls = "; ".join(_FOLDERS.sub("", player) for player in playback.players)
    return Verdict(1.0 if calls else 0.0, f"its launch file plays {calls or 'no bag'}", PLAYS_HINT)


def judge_half_speed(recording: Recording, playback: Playback, view: RvizView) -> Verdict:
    """Grade whether the launch file plays a bag at half speed, with the evidence of `judge_player`."""
    rates = [float(rate) for player in playback.players for rate in _RATE.findall(player)]
    evidence = judge_player(recording, playback, view).evidence
    return Verdict(1.0 if 0.5 in rates else 0.0, evidence, PLAYS_HINT)


def leave_to_teacher(_recording: Recording, _playback: Playback, _view: RvizView) -> Verdict:
    """Leave an item to be graded by hand."""
    return Verdict(None, by_hand(), "")


class SheetItem(NamedTuple):
    """Item of the exercise sheets, and the function that grades it."""

    husky_points: float  # points on the Husky's sheet; 0 if the sheet does not have the item
    smb_points: float  # points on the SMB's sheet
    subject: Subject
    judge: Callable[[Recording, Playback, RvizView], Verdict]


SHEETS = {
    "explains the filter": SheetItem(0.0, 10.0, Subject.CODE, leave_to_teacher),
    "explains its topics": SheetItem(0.0, 10.0, Subject.CODE, leave_to_teacher),
    "plots the simulated path": SheetItem(30.0, 20.0, Subject.CODE, judge_plot),
    "recorded path": SheetItem(40.0, 30.0, Subject.DRIVE, judge_path),
    "RViz shows the point cloud": SheetItem(30.0, 10.0, Subject.DISPLAYS, judge_cloud),
    "style of the point cloud": SheetItem(0.0, 10.0, Subject.DISPLAYS, judge_style),
    "top view moves with the robot": SheetItem(0.0, 10.0, Subject.DRIVE, judge_top_view),
    "bonus: plays the bag": SheetItem(0.0, 5.0, Subject.CODE, judge_player),
    "bonus: at half speed": SheetItem(0.0, 5.0, Subject.CODE, judge_half_speed),
}
ITEMS = tuple(SHEETS)


def judge_exercise_4(
    recordings: Sequence[Recording], view: RvizView, _scan_topic: str, rules: Rules = DEFAULT_RULES
) -> List[Item]:
    """Return the items of the exercise sheet of the robot whose bag was played."""
    recording = recordings[0]  # this exercise has a single run
    items = []
    playback = recording.watched_as(Playback)
    for name, sheet_item in SHEETS.items():
        max_points = sheet_item.smb_points if recording.robot == SMB else sheet_item.husky_points
        item = Item(name, 0.0, max_points, "", subject=sheet_item.subject)
        if sheet_item.subject is Subject.DISPLAYS and not view.source:
            items.append(without_config(item, view, rules))
        else:
            share, evidence, hint = sheet_item.judge(recording, playback, view)
            points = None if share is None else share * max_points  # None if it is graded by hand
            items.append(replace(item, points=points, evidence=evidence, hint=hint))
    # items that this robot's exercise sheet does not have are left out
    items = [item for item in items if item.max_points]
    # `forfeited` takes the points of a submission that has interfered with the simulator, and `weighted`
    # applies the weights of the teacher's rubric
    return weighted(forfeited(items, recordings), rules)


EXERCISE = Exercise(
    ITEMS,
    judge_exercise_4,
    pace=5.0,
    deadline=90.0,
    facts=Facts(
        # the submission starts the filter, but `grade` plays the bag
        robot_packages=RobotPackages(by_submission=("robot_localization",), by_marking=("rosbag",)),
        node="ekf_localization_node",
        visible_code=VisibleCode.FILTER,
        find_robot=named_bag,
        read_facts=read_facts,
    ),
    bring_up=play,
    watch=FilterWatch,
)
