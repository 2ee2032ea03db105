"""Exercise 3's rubric on drives made of numbers: who deserves what, and which sentence."""

import ast
import json
import trace
from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pytest
import yaml

from husky_grading.displays import RvizView
from husky_grading.drive import ros_graph
from husky_grading.drive.drive_end import NODES_ENDED
from husky_grading.exercises import exercise_3
from husky_grading.exercises.exercise_3 import (
    judge_approach,
    judge_arrival,
    judge_exercise_3,
    judge_place,
)
from husky_grading.notes import Kind, Note
from husky_grading.recording import (
    MarkerSample,
    Recording,
    hull_gaps,
    pose_jumps,
    recording_to_json,
)
from husky_grading.records import DEFAULT_RULES, Rules, total
from husky_grading.rubrics.items import (
    left_to_chance,
    left_to_choice,
    over_trials,
    told_once,
)
from husky_grading.settings import load_rules
from husky_highlevel_controller.config import ConfigError, from_plain
from husky_highlevel_controller.course import PILLARS
from husky_highlevel_controller.datatypes import Pose2D

PILLAR = (10.0, 0.0)  # [m]
NOSE = 0.4937  # [m], from base_link to the front
PERIOD = 0.02  # [s]
SCAN = "/front/scan"
FULL_VIEW = RvizView("its rviz node", topics=(SCAN, "/marker"), tf=True, robot=True, scan=True)


def drive(*legs, **more):
    """A recording of legs along x: (to x [m], speed [m/s]) or (seconds, 0) to stand."""
    x, xs, speeds = 0.0, [], []
    for amount, speed in legs:
        steps = round((abs(amount - x) / abs(speed) if speed else amount) / PERIOD)
        xs += list(x + np.arange(1, steps + 1) * PERIOD * speed)
        speeds += [speed] * steps
        x = xs[-1] if xs else 0.0
    times = np.round(PERIOD * np.arange(1, len(xs) + 1), 2)
    poses = np.column_stack([xs, np.zeros((len(xs), 2))])
    twists = np.column_stack([speeds, np.zeros(len(xs))])
    given = dict(command_count=len(xs), subscribed=True)
    return Recording(Pose2D(), PILLAR, 60.0, times, poses, twists, times, **{**given, **more})


def sample(at, position, number=0, size=0.4, **more):
    """A marker as wide and high as `size` [m]."""
    reach = max(np.hypot(position[0] - PILLAR[0], position[1] - PILLAR[1]) - size / 2.0, 0.0)
    given = dict(
        reach=reach, low=position[2] - size / 2.0, high=position[2] + size / 2.0, stamp=at, frame="odom"
    )
    return MarkerSample("/marker", "pillar", number, at, position=position, **{**given, **more})


def markers(recording, position, stamp=None, problem="", every=5):
    """A marker in each fifth row; `position` is one, or a function of the row."""
    at = position if callable(position) else lambda row: position
    shown = tuple(
        sample(float(t), at(row), stamp=float(t) if stamp is None else stamp, problem=problem)
        for row, t in enumerate(recording.times)
        if row % every == 0
    )
    return replace(recording, markers=shown, marker_topics=("/marker",))


WAY = 10.0 - 0.2 - NOSE  # [m], to the pillar's surface
TO_PILLAR = WAY - 0.2  # [m], 0.2 m from the surface
GOOD = drive((TO_PILLAR, 0.5), (3.0, 0.0))


@pytest.mark.parametrize(
    ("robot", "pose", "gap"),
    [
        ("husky", (0.0, 0.0, 0.0), WAY),
        ("husky", (0.0, 0.0, np.pi / 2), 10.0 - 0.2 - 0.34255),  # its wheels stick out sideways
        ("husky", (10.0, -1.0, np.pi / 2), 1.0 - 0.2 - NOSE),
        ("husky", (10.0, 0.0, 0.0), -0.2),
        ("smb", (0.0, 0.0, 0.0), np.hypot(10.0 - 0.4059, 0.235) - 1.0),  # whose pillar is thicker
    ],
)
def test_the_gap_is_from_the_outline_of_the_robot_that_drove_to_the_surface_of_its_pillar(robot, pose, gap):
    assert hull_gaps(np.array([pose]), PILLAR, robot)[0] == pytest.approx(gap, abs=1e-4)


# ---------------------------------------------------------------------------- towards the pillar


@pytest.mark.parametrize(
    ("recording", "points", "at", "evidence"),
    [
        (GOOD, 20.0, 9.3, "half of the 9.30 m"),
        (drive((0.08 * WAY, 0.5), (3.0, 0.0)), 0.0, None, "comes only"),
        (drive((0.12 * WAY, 0.5), (3.0, 0.0)), 10.0, None, "covers"),
        (drive((0.48 * WAY, 0.5), (3.0, 0.0)), 10.0, None, "covers"),
        (drive((0.52 * WAY, 0.5), (3.0, 0.0)), 20.0, None, "half of"),
        (replace(drive((20.0, 0.5)), pillar=(15.0, 1.5)), 20.0, None, "half of"),
        (replace(drive((20.0, 0.5)), pillar=(15.0, 4.0)), 10.0, None, "drives past the pillar, 3."),
        (drive((-5.0, -0.5)), 0.0, 10.0, "drives away: 4.99 m farther"),
    ],
)
def test_points_for_driving_towards_the_pillar(recording, points, at, evidence):
    item = judge_approach(recording)
    assert (item.points, item.max_points) == (points, 20.0)
    assert at is None or item.at == pytest.approx(at, abs=0.1)
    assert evidence in item.evidence
    assert ("drives past" in item.evidence) is ("drives past" in evidence)


ENDS = (Note(Kind.NODE_ENDED, "node n ends during the drive (exit code 0)"),)
STOOD = Note(Kind.NEVER_MOVED, "other words")


@pytest.mark.parametrize(
    ("more", "cause"),
    [
        ({"notes": (Note(Kind.NODE_FAILED, "node x ends"),)}, "node x ends"),
        ({"subscribed": False}, "it does not subscribe to the scans"),
        ({"zero_count": 250, "notes": (Note(Kind.LAUNCH_PREFIX, "dropped"),)}, "all 250 commands were zero"),
        (
            {"command_count": 0, "unread_topics": ("/husky/cmd_vel",)},
            "it sends its commands to /husky/cmd_ve",
        ),
        # a node that ends without an error is a cause where no other runs
        ({"command_count": 0, "notes": ENDS, "ended": NODES_ENDED}, "node n ends during the drive"),
        ({"command_count": 0, "notes": ENDS, "ended": STOOD}, "nothing came on cmd_vel"),
        ({}, "in spite of 250 commands"),
    ],
)
def test_who_never_moves_is_told_the_cause(more, cause):
    stands = drive((5.0, 0.0), **more)
    item = judge_approach(stands)
    assert item.evidence.startswith(f"the robot never moves: {cause}")
    assert (item.points, item.hint) == (0.0, judge_arrival(stands).hint)


# ---------------------------------------------------------------------------- at the pillar


def trembling():
    speeds = GOOD.speeds.copy()
    speeds[-100:, 1] = 0.3 * (-1.0) ** np.arange(100)
    return replace(GOOD, speeds=speeds)


def short_by(gap):
    return drive((WAY - gap, 0.5), (3.0, 0.0))


HUNG = replace(drive((3.0, 0.5), (9.0, 0.0)), commands=np.array([0.02, 0.04]), command_count=2)


@pytest.mark.parametrize(
    ("recording", "points", "at", "evidence"),
    [
        (GOOD, 30.0, TO_PILLAR / 0.5, "stands 0.20 m from it since"),
        (trembling(), 30.0, None, "stands"),
        (drive((WAY, 0.4)), 30.0, None, "reaches it, at 0.40 m/s"),
        (drive((12.0, 1.0)), 30.0, WAY, "reaches it, at 1.00 m/s"),
        # being there without staying costs a third
        (drive((TO_PILLAR, 0.5), (5.0, -0.5), (3.0, 0.0)), 20.0, None, "but stands 4.31 m away in the end"),
        (drive((TO_PILLAR, 0.5), (5.0, -0.5)), 20.0, None, "does not stop there"),
        (drive((TO_PILLAR, 0.5), (0.5, 0.0)), 20.0, None, "does not stop there"),
        (short_by(0.34), 30.0, None, "stands"),
        (short_by(0.36), 0.0, None, "stops short: nearest 0.36 m from the pillar"),
        (HUNG, 0.0, None, "2 commands, the last at 0.04 s, then none: its callback waits"),
        # who is on its way at the deadline is for a person, not who is too slow, stands, or ended before it
        (drive((6.0, 0.1)), None, 60.0, "on its way, at the deadline of 60 s"),
        (drive((3.5, 0.0585)), 0.0, None, "nearest 5.81 m"),
        (drive((5.8, 0.1), (2.0, 0.0)), 0.0, None, "stops short: nearest 3.51 m"),
        (drive((6.0, 0.15)), 0.0, None, "nearest 3.31 m"),
    ],
)
def test_points_for_reaching_the_pillar(recording, points, at, evidence):
    item = judge_arrival(recording)
    assert item.points == points
    assert at is None or item.at == pytest.approx(at, abs=0.1)
    assert evidence in item.evidence
    assert ("then none" in item.evidence) == (recording is HUNG)


@pytest.mark.parametrize(
    ("speed", "points"), [(0.4, 30.0), (0.5, 30.0), (0.54, 30.0), (0.6, 20.0), (1.0, 20.0)]
)
def test_ramming_may_cost_points_and_never_at_the_speed_that_is_allowed(speed, points):
    item = judge_arrival(drive((12.0, speed)), Rules(ramming_costs=10.0))
    assert item.points == points
    assert ("rams the pillar" in item.evidence) == (points < 30.0)


# ---------------------------------------------------------------------------- the marker


LOST = '"map" passed to lookupTransform does not exist'


@pytest.mark.parametrize(
    ("recording", "evidence"),
    [
        (GOOD, "no topic of type visualization_msgs/Marker"),
        (replace(GOOD, marker_topics=("/marker",)), "nothing came on /marker"),
        (markers(GOOD, (nan, nan, nan), problem=LOST), f"not to be seen: {LOST}"),
        (
            markers(GOOD, (10.0, 0.0, -1.5e33)),
            "at (1.0e+01, 0.0e+00, -1.5e+33): has each coordinate been giv",
        ),
    ],
)
def test_what_nobody_can_see_is_no_marker(recording, evidence):
    item = judge_place(recording)
    assert item.points == 0.0
    assert evidence in item.evidence


@pytest.mark.parametrize(("share", "points"), [(0.1, 0.0), (0.3, 3.3), (0.5, 10.0), (0.7, 16.7), (0.9, 20.0)])
def test_points_grow_with_the_time_for_which_the_marker_is_right(share, points):
    last = share * len(GOOD.times)
    item = judge_place(markers(GOOD, lambda row: (10.0, 0.0, 0.0) if row < last else (0.0, 0.0, 0.0)))
    assert item.points == pytest.approx(points, abs=0.2)


@pytest.mark.parametrize(
    ("position", "size", "points", "evidence"),
    [
        ((10.0, 0.0, 0.0), {}, 20.0, "right 100 % of the time"),
        ((9.8, 0.0, 0.3), {}, 20.0, "right 100 % of the time"),
        ((10.1, 0.25, 1.2), {}, 20.0, "right 100 % of the time"),
        (
            (0.0, 0.0, 0.0),
            {},
            0.0,
            "at (0.00, 0.00, 0.00), the pillar at (10.00, 0.00): 9.80 m in front of the pillar",
        ),
        ((10.0, 2.0, 0.0), {}, 0.0, "2.00 m too far left"),
        ((9.0, 1.0, 0.0), {}, 0.0, "0.80 m in front of the pillar and 1.00 m too far left"),
        ((10.0, 0.0, 3.4), {}, 0.0, "z is wrong, it is drawn from 3.20 to 3.60 m"),
        # no cliff in the distance and the height
        ((9.7, 0.0, 0.0), {}, 20.0, ""),
        ((9.6, 0.0, 0.0), {}, 15.0, ""),
        ((9.5, 0.0, 0.0), {}, 10.0, ""),
        ((9.4, 0.0, 0.0), {}, 5.0, ""),
        ((9.2, 0.0, 0.0), {}, 0.0, ""),
        ((10.0, 0.0, 2.64), {}, 16.0, ""),
        ((10.0, 0.0, 2.85), {}, 10.0, ""),
        ((10.0, 0.0, -0.64), {}, 16.0, ""),
        ((9.1, 0.0, 0.0), {"reach": 0.2}, 10.0, ""),  # a wide one that touches the pillar
        ((0.0, 0.0, 0.0), {"reach": 0.0}, 0.0, ""),  # a huge one around it
        ((10.0, 0.0, 2.5), {"low": 0.8}, 20.0, ""),  # a tall one whose middle is above it
    ],
)
def test_points_by_the_distance_the_height_and_the_size_of_a_marker(position, size, points, evidence):
    sized = with_samples(replace(marker, **size) for marker in markers(GOOD, position).markers)
    item = judge_place(sized, Rules(marker_per_metre=0.0))
    assert item.points == pytest.approx(points, abs=0.05)
    assert evidence in item.evidence
    assert item.at == PERIOD


def turning(place_of, frame="odom", **more):
    """A drive that turns 25 degrees to the pillar in 4 s and drives there; markers by base_link."""
    straight = drive((4.0, 0.0), (TO_PILLAR, 0.5))
    yaw = np.clip(-0.44 + 0.44 * straight.times / 4.0, -0.44, 0.0)
    poses = np.column_stack([straight.poses[:, :2], yaw])

    def place(row):
        x, y, yaw = poses[row]
        c, s, dx, dy = np.cos(yaw), np.sin(yaw), 10.0 - x, -y
        ahead, left = place_of(dx * c + dy * s, dy * c - dx * s)
        return x + ahead * c - left * s, y + ahead * s + left * c, 0.0

    marked = markers(replace(straight, poses=poses), place)
    return replace(marked, markers=tuple(replace(each, frame=frame, **more) for each in marked.markers))


def mirrored(x, y):
    return x, -y


def test_a_mirrored_marker_gets_half_at_most_and_is_named():
    assert judge_place(turning(lambda x, y: (x, y))).points == 20.0
    item = judge_place(turning(mirrored))
    assert 9.0 <= item.points <= 10.0
    assert item.evidence.startswith("mirrored: y has the wrong sign, for this laser hangs upside down; ")
    assert "0 % with the pillar to the side, 100 % with it ahead" in item.evidence
    assert "upside down" not in judge_place(replace(turning(mirrored), robot="smb")).evidence


def test_the_fault_of_a_marker_is_named_as_it_is_in_the_code():
    """Those of test/submissions are named in their recordings."""
    whole_metres = judge_place(turning(lambda x, y: (np.trunc(x), np.trunc(y)), "base_link"))
    assert "whole metres" in whole_metres.evidence
    near = judge_place(turning(lambda x, y: (x - 1.5, y), "front_laser"))
    assert "m in front of the pillar, seen" in near.evidence
    assert near.hint.startswith("check header.frame_id")
    assert "base_link" not in near.hint
    assert "NaN" not in judge_place(turning(lambda x, y: (nan, y), problem="its alpha is 0")).hint


def with_samples(samples):
    return replace(GOOD, markers=tuple(samples), marker_topics=("/marker",))


RIGHT, WRONG = (10.0, 0.0, 0.0), (3.0, 0.0, 0.0)


@pytest.mark.parametrize("apart", ["id", "namespace", "topic"])
@pytest.mark.parametrize(
    ("is_right", "points"),
    [(lambda row: True, 20.0), (lambda row: row >= 10, 20.0), (lambda row: row % 10 == 0, 0.0)],
    ids=["always", "after a while", "one of ten"],
)
def test_a_new_marker_for_each_scan_counts_by_all_that_is_drawn_whatever_tells_them_apart(
    is_right, points, apart
):
    drawn = [
        replace(
            sample(float(t), RIGHT if is_right(row) else WRONG),
            **{apart: row if apart == "id" else f"/{row}"},
        )
        for row, t in enumerate(GOOD.times[::5])
    ]
    item = judge_place(with_samples(drawn))
    assert item.points == points
    assert points or f"{len(drawn)} markers in " in item.evidence


def test_what_is_deleted_too_old_or_in_another_namespace_is_not_drawn_in_its_place():
    wrong = [sample(0.02, WRONG, number) for number in range(1, 9)]
    right = [sample(float(t), RIGHT) for t in GOOD.times[::5]]
    cleared = replace(wrong[0], at=0.03, action="delete all")
    for others, points in (
        (wrong, 0.0),
        ([replace(marker, until=0.1) for marker in wrong], 20.0),
        ([*wrong, cleared], 20.0),
        ([replace(marker, namespace="path") for marker in wrong], 20.0),
    ):
        assert judge_place(with_samples([*others, *right])).points == points
    gone = judge_place(with_samples([right[0], replace(right[0], action="delete")]))
    assert (gone.points, "deleted as soon as it comes" in gone.evidence) == (0.0, True)


def lines_run(function):
    """Number of Python lines that a call runs."""
    tracer = trace.Trace(trace=False)
    tracer.runfunc(function)
    return sum(tracer.results().counts.values())


@pytest.mark.parametrize("until", [20.0, np.inf])
def test_twice_the_markers_take_twice_the_work_also_where_they_live_long_or_are_deleted(until):
    def work(count):
        row = range(count)
        samples = [sample(0.02 * (n + 1), (10.0, 0.0, 0.5), n, until=0.02 * n + until) for n in row]
        deleted = [replace(each, action="delete all", topic=f"/{n % 20}") for n, each in enumerate(samples)]
        return lines_run(lambda: judge_exercise_3([with_samples([*samples, *deleted])], FULL_VIEW, SCAN))

    work(100)  # fills caches
    assert work(800) < 2.5 * work(400)


# ---------------------------------------------------------------------------- RViz


def shown(view, position=RIGHT, rules=DEFAULT_RULES):
    recording = markers(GOOD, position)
    return exercise_3.judge_shown(view, [recording], [judge_place(recording, rules)], rules)


@pytest.mark.parametrize(
    ("change", "points"),
    [
        ({}, 20.0),
        ({"tf": False}, 14.0),
        ({"robot": False}, 13.0),
        ({"scan": False}, 13.0),
        ({"topics": ("/scan",)}, 13.0),  # points of another topic
        ({"problem": "RViz ends"}, 0.0),
        ({"source": ""}, None),  # for a person
    ],
)
def test_each_display_has_its_points(change, points):
    assert exercise_3.judge_rviz(replace(FULL_VIEW, **change), SCAN).points == points


@pytest.mark.parametrize(
    ("view", "position", "points", "evidence"),
    [
        ({}, RIGHT, 10.0, "RViz subscribes to /marker"),
        ({}, (0.0, 0.0, 0.0), 0.0, "no marker at the pillar"),
        ({"topics": (SCAN,)}, RIGHT, 0.0, "RViz does not subscribe to /marker"),
        ({"hidden": (("/marker", "pillar"),)}, RIGHT, 0.0, "switched off"),
        ({"hidden": (("/marker", "other"),)}, RIGHT, 10.0, "RViz subscribes to /marker"),
    ],
)
def test_the_marker_in_rviz_counts_only_where_it_is_right(view, position, points, evidence):
    item = shown(replace(FULL_VIEW, **view), position)
    assert item.points == points
    assert evidence in item.evidence


@pytest.mark.parametrize(
    ("no_rviz_config", "started", "points"),
    [("person", True, None), ("zero", True, 0.0), ("node", True, 20.0), ("node", False, 0.0)],
)
def test_a_teacher_says_what_a_hand_in_without_rviz_s_configuration_gets(no_rviz_config, started, points):
    rules, view = Rules(no_rviz_config=no_rviz_config), RvizView(started=started)
    assert exercise_3.judge_rviz(view, SCAN, rules).points == points
    assert shown(view, rules=rules).points == (points if points is None else points / 2.0)


# ---------------------------------------------------------------------------- everything


def test_one_drive_that_interferes_costs_all_points_and_displays_are_no_chance():
    """Points of whole hand-ins are those of the kept recordings."""
    all_of_it = markers(GOOD, RIGHT)
    items = judge_exercise_3([all_of_it], FULL_VIEW, SCAN)
    assert total(items) == (100.0, 100.0)
    assert left_to_chance(items, "chance")[2].points == 20.0
    cheated = replace(all_of_it, violations=("the robot jumps 19.87 m at 1.48 s",))
    items = judge_exercise_3([all_of_it, cheated], FULL_VIEW, SCAN)
    assert total(items) == (0.0, 100.0)
    assert items[0].evidence == "no points: the robot jumps 19.87 m at 1.48 s"


def test_what_lost_points_by_one_of_equal_launch_files_is_for_a_person_and_full_marks_stand():
    full = judge_exercise_3([markers(GOOD, RIGHT)], FULL_VIEW, SCAN)
    assert left_to_choice(full, ("a.launch", "b.launch")) == full
    items = left_to_choice(judge_exercise_3([GOOD], FULL_VIEW, SCAN), ("a.launch", "b.launch"))
    assert [item.points for item in items] == [20.0, 30.0, 20.0, None, None]
    assert (
        "its launch files a.launch and b.launch fit alike, and a.launch was started: no topic"
        in items[3].evidence
    )


def test_a_cause_is_told_once_and_the_same_result_of_all_drives_has_no_sums():
    short = [drive((3.0, 0.0)), drive((3.0, 0.0))]
    items = told_once(judge_exercise_3(short, FULL_VIEW, SCAN))
    assert items[1].hint == "the same as for 'drives towards the pillar'"
    assert items[3].evidence.endswith("; likewise in 1 other worlds")


def test_the_course_s_world_counts_most_and_the_worst_drive_is_told():
    short, third = drive((3.0, 0.0)), 1.0 / 3.0

    def over_arrivals(drives, other_worlds):
        return over_trials(list(map(judge_arrival, drives)), other_worlds)

    item = over_arrivals([GOOD, short, GOOD], third)
    assert item.points == 25.0
    assert item.evidence.endswith("(drive 2; of 30 points 30 in the course's world, 15 in 2 others)")
    assert item.drive == 2
    for drives, weight, points in (
        ([GOOD, short, short], third, 20.0),
        ([short, GOOD, GOOD], third, 10.0),
        ([GOOD, short, short], 0.0, 30.0),
        ([short], third, 0.0),
        ([drive((TO_PILLAR, 0.5)), drive((6.0, 0.1))], 0.3, None),  # one is for a person
    ):
        assert over_arrivals(drives, weight).points == points


def test_no_rule_of_marking_searches_a_sentence():
    folder = Path(exercise_3.__file__).parents[1]
    patterns = ("exercises/*.py", "rubrics/*.py", "reports/*.py", "judge.py", "review.py")
    files = [path for pattern in patterns for path in folder.glob(pattern)]
    for path, node in ((file, node) for file in files for node in ast.walk(ast.parse(file.read_text()))):
        assert not (isinstance(node, ast.Attribute) and node.attr in ("startswith", "endswith")), path
        if isinstance(node, ast.Compare) and isinstance(node.left, ast.Constant):
            found = isinstance(node.ops[0], (ast.In, ast.NotIn)) and isinstance(node.left.value, str)
            assert not found or node.left.value == "#", f"{path}:{node.lineno}"


def rules_of(content, folder):
    path = folder / "rubric.yaml"
    path.write_text(yaml.safe_dump(content))
    return load_rules(path, exercise_3.ITEMS)


def test_a_teacher_may_weigh_items_and_leave_one_to_a_person(tmp_path):
    content = {"weights": {"reaches the pillar": 60}, "by_person": ["marker in RViz"], "ramming_costs": 10}
    rules = rules_of(content, tmp_path)
    items = judge_exercise_3([markers(drive((12.0, 1.0)), RIGHT)], FULL_VIEW, SCAN, rules)
    assert [item.points for item in items] == [20.0, 40.0, 20.0, 20.0, None]
    assert total(items) == (100.0, 120.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"wieghts": {}}, "rubric.yaml: 'wieghts' is not known; there are: reached"),
        ({"weights": {"reaches": 10}}, "'reaches' is not an item; there are: drives towards"),
        ({"weights": {"reaches the pillar": -1}}, "weights/reaches the pillar = -1 is out of range"),
        ({"reached": 9.0}, "reached = 9.0 is out of range"),
        ({"by_person": "all"}, "by_person = 'all' is not a list"),
    ],
)
def test_a_rubric_file_with_a_mistake_is_refused(content, words, tmp_path):
    with pytest.raises(ConfigError, match=words):
        rules_of(content, tmp_path)


# ---------------------------------------------------------------------------- the recording


def test_a_recording_comes_back_from_its_text():
    made = replace(markers(GOOD, (10.0, 0.0, nan)), robot="smb", notes=ENDS)
    again = from_plain(Recording, json.loads(recording_to_json(made)), "")
    assert np.array_equal(again.poses, np.round(made.poses, 4))
    assert again.markers[3].topic == "/marker"
    assert (again.start, again.notes, again.pillar_size) == (made.start, ENDS, PILLARS["smb"])
    assert judge_arrival(again) == judge_arrival(made)


def test_a_pose_that_jumps_is_named():
    assert pose_jumps(GOOD.times, GOOD.poses) == []
    moved = GOOD.poses.copy()
    moved[100:, 0] += 5.0
    assert pose_jumps(GOOD.times, moved) == ["the robot jumps 5.01 m at 2.02 s"]


def test_topics_that_lead_nowhere_and_topics_that_are_forged():
    ours = {"/husky_simulator", "/marking_recorder"}
    publishers = {"/front/scan": ["/husky_simulator", "/me"], "/drive": ["/me"], "/cmd_vel": ["/me"]}
    subscribers = {"/scan": ["/me"], "/clock": ["/me"], "/cmd_vel": ["/husky_simulator"]}
    types = {"/drive": "geometry_msgs/Twist", "/cmd_vel": "geometry_msgs/Twist"}
    assert ros_graph.silent_topics(publishers, subscribers, ours) == ["/scan"]
    assert ros_graph.unread_topics(publishers, subscribers, types, ours) == ["/drive"]
    assert ros_graph.forged_topics(publishers, ("/clock", "/front/scan"), ours) == [("/front/scan", "/me")]
    assert ros_graph.topics_of_truth(subscribers, ours) == []
    for topic in (
        "/ground_truth/odom",
        "/husky_simulator/world/update_full",
        "/husky_simulator/world/update",
    ):
        assert ros_graph.topics_of_truth({topic: ["/marking_recorder", "/me"]}, ours) == [(topic, "/me")]
