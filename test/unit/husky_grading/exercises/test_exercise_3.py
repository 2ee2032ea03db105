"""Exercise 3's rubric on drives made of numbers: who deserves what, and which sentence."""

from dataclasses import replace

import numpy as np
import pytest
from drives import FULL_VIEW, GOOD, RIGHT, SCAN, TO_PILLAR, WAY, drive, markers

from husky_grading.displays import RvizDisplay, RvizView
from husky_grading.drive.drive_end import NODES_ENDED
from husky_grading.exercises import exercise_3
from husky_grading.exercises.exercise_3 import find_placements, judge_approach, judge_arrival, judge_place
from husky_grading.notes import Kind, Note
from husky_grading.records import DEFAULT_RULES, Rules
from husky_grading.rubrics import steering
from husky_grading.rubrics.causes import hint_on


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


ENDS = (Note(Kind.NODE_ENDED, "node n ends during the run (exit code 0)"),)
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
        ({"command_count": 0, "notes": ENDS, "ended": NODES_ENDED}, "node n ends during the run"),
        ({"command_count": 0, "notes": ENDS, "ended": STOOD}, "nothing came on cmd_vel"),
        ({}, "in spite of 250 commands"),
    ],
)
def test_who_never_moves_is_told_the_cause(more, cause):
    stands = drive((5.0, 0.0), **more)
    item = judge_approach(stands)
    assert item.evidence.startswith(f"the robot never moves: {cause}")
    assert (item.points, item.hint) == (0.0, judge_arrival(stands).hint)


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
        # who is on its way at the deadline is graded by hand, not who is too slow, stands, or ended before it
        (drive((6.0, 0.1)), None, 60.0, "on its way at the deadline of 60 s"),
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


def turning(rate, **more):
    """A robot that turns [rad/s] while it covers 0.5 m, with the pillar to its left, and then stands."""
    recording = drive((0.5, 0.5), (9.0, 0.0), sharpest=abs(rate))
    poses, speeds = recording.poses.copy(), recording.speeds.copy()
    speeds[:, 1] = np.where(speeds[:, 0] > 0.0, rate, 0.0)
    poses[:, 2] = np.cumsum(speeds[:, 1]) * 0.02
    return replace(recording, poses=poses, speeds=speeds, pillar=(10.0, 3.0), **more)


CEASE = {"commands": np.array([0.02, 1.0]), "command_count": 50}


@pytest.mark.parametrize("more", [{}, CEASE], ids=["it sends zero", "it sends nothing"])
@pytest.mark.parametrize("rate", [-0.5, 0.1, 0.0])
def test_a_robot_that_turns_away_and_then_stops_is_told_the_sign(rate, more):
    recording = turning(rate, **more)
    item = judge_approach(recording)
    assert item.points == 0.0
    assert (item.hint == steering.TURNS) == (rate < 0.0), item
    assert judge_arrival(recording, approach=item).hint == item.hint
    assert ("then none" in item.evidence) == bool(more)


def test_a_robot_that_turns_away_and_then_fails_is_told_of_its_failure():
    failed = Note(Kind.NODE_FAILED, "node x ends")
    assert judge_approach(turning(-0.5, notes=(failed,))).hint == hint_on(failed)


@pytest.mark.parametrize(
    ("speed", "points"), [(0.4, 30.0), (0.5, 30.0), (0.54, 30.0), (0.6, 20.0), (1.0, 20.0)]
)
def test_ramming_may_cost_points_and_never_at_the_speed_that_is_allowed(speed, points):
    item = judge_arrival(drive((12.0, speed)), Rules(ramming_costs=10.0))
    assert item.points == points
    assert ("rams the pillar" in item.evidence) == (points < 30.0)


def shown(view, position=RIGHT, rules=DEFAULT_RULES):
    recording = markers(GOOD, position)
    placements = find_placements(recording, rules)
    return exercise_3.judge_shown(view, placements, [judge_place(recording, placements)], rules)


@pytest.mark.parametrize(
    ("change", "points"),
    [
        ({}, 20.0),
        ({"tf": False}, 14.0),
        ({"robot": False}, 13.0),
        ({"scan": False}, 13.0),
        ({"topics": ("/scan",)}, 13.0),  # points of another topic
        ({"problem": "RViz ends"}, 0.0),
        ({"source": ""}, None),  # graded by hand
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


@pytest.mark.parametrize(("kind", "other"), [("Marker", "MarkerArray"), ("MarkerArray", "Marker")])
def test_a_display_of_the_other_type_of_markers_is_told_with_the_one_that_fits(kind, other):
    display = RvizDisplay(f"rviz/{kind}", "/marker")
    item = shown(replace(FULL_VIEW, topics=(SCAN,), displays=(display,), mistyped=(display,)))
    assert item.points == 0.0
    assert (
        f"its display {kind} does not show /marker, whose type is visualization_msgs/{other}" in item.evidence
    )
    assert f"add a display {other} of /marker" in item.hint


def test_a_marker_elsewhere_that_rviz_shows_is_not_the_marker_at_the_pillar():
    recording = markers(GOOD, RIGHT)
    elsewhere = [replace(each, topic="/elsewhere", position=(0.0, 0.0, 0.0)) for each in recording.markers]
    recording = replace(recording, markers=(*recording.markers, *elsewhere))
    view = replace(FULL_VIEW, topics=(SCAN, "/elsewhere"))
    item = exercise_3.judge_shown(view, find_placements(recording, DEFAULT_RULES), [])
    assert (item.points, item.evidence) == (0.0, "RViz does not subscribe to /marker")


def test_only_topics_with_a_display_are_said_to_have_a_hidden_namespace():
    recording = markers(GOOD, RIGHT)
    other = replace(recording, markers=tuple(replace(each, topic="/other") for each in recording.markers))
    placements = [each for run in (recording, other) for each in find_placements(run, DEFAULT_RULES)]
    view = replace(FULL_VIEW, hidden=(("/marker", "pillar"),))
    item = exercise_3.judge_shown(view, placements, [])
    assert (item.points, "in the display of /marker" in item.evidence) == (0.0, True)
    assert "/other" not in item.evidence


@pytest.mark.parametrize(
    ("no_rviz_config", "started", "points"),
    [("person", True, None), ("zero", True, 0.0), ("node", True, 20.0), ("node", False, 0.0)],
)
def test_a_teacher_says_what_a_hand_in_without_rviz_s_configuration_gets(no_rviz_config, started, points):
    rules, view = Rules(no_rviz_config=no_rviz_config), RvizView(started=started)
    assert exercise_3.judge_rviz(view, SCAN, rules).points == points
    assert shown(view, rules=rules).points == (points if points is None else points / 2.0)
