"""Marker of the pillar: points by its place, its size, and the time for which it is right."""

import trace
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from drives import FULL_VIEW, GOOD, PERIOD, RIGHT, SCAN, WRONG, drive, markers, place, sample, with_samples

from husky_grading.exercises.exercise_3 import judge_exercise_3
from husky_grading.records import Rules

LOST = '"map" passed to lookupTransform does not exist'


def test_a_marker_in_an_unknown_frame_is_told_the_frame_of_the_scan():
    lost = markers(GOOD, (nan, nan, nan), problem="there is no frame 'base_laser'")
    samples = [replace(each, has_frame=False) for each in lost.markers]
    item = place(replace(lost, markers=tuple(samples)))
    assert "not visible: there is no frame 'base_laser'" in item.evidence
    assert item.hint == "set header.frame_id of the marker to the one of the scan's header"
    half = [each if row % 2 else markers(GOOD, RIGHT).markers[row] for row, each in enumerate(samples)]
    assert place(replace(lost, markers=tuple(half))).hint == item.hint


@pytest.mark.parametrize(
    ("recording", "evidence"),
    [
        (GOOD, "no topic of type visualization_msgs/Marker"),
        (replace(GOOD, marker_topics=("/marker",)), "nothing came on /marker"),
        (markers(GOOD, (nan, nan, nan), problem=LOST), f"not visible: {LOST}"),
        (
            markers(GOOD, (10.0, 0.0, -1.5e33)),
            "at (1.0e+01, 0.0e+00, -1.5e+33); give each coordinate a value",
        ),
    ],
)
def test_what_nobody_can_see_is_no_marker(recording, evidence):
    item = place(recording)
    assert item.points == 0.0
    assert evidence in item.evidence


def test_a_first_marker_after_the_touch_is_said_to_be_late():
    touching = markers(drive((10.0, 0.5)), RIGHT)
    late = replace(touching, markers=touching.markers[-1:])
    assert place(late).evidence == "no marker came on /marker before the robot touched the pillar"
    deletion = replace(touching.markers[0], action="delete all")
    assert place(replace(touching, markers=(deletion,))).evidence == "nothing came on /marker"


@pytest.mark.parametrize(("share", "points"), [(0.1, 0.0), (0.3, 3.3), (0.5, 10.0), (0.7, 16.7), (0.9, 20.0)])
def test_points_grow_with_the_time_for_which_the_marker_is_right(share, points):
    last = share * len(GOOD.times)
    item = place(markers(GOOD, lambda row: (10.0, 0.0, 0.0) if row < last else (0.0, 0.0, 0.0)))
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
    item = place(sized, Rules(marker_per_metre=0.0))
    assert item.points == pytest.approx(points, abs=0.05)
    assert evidence in item.evidence
    assert item.at == PERIOD


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
    item = place(with_samples(drawn))
    assert item.points == points
    assert points or f"{len(drawn)} markers in " in item.evidence


@pytest.mark.parametrize("lost", [0, 10, 3])
def test_markers_that_a_busy_machine_loses_cost_no_point_of_one_that_turns_on_the_spot(lost):
    """The lidar does not see what is behind it: the marker is wrong then, also on the axis."""
    standing = drive((25.0, 0.0))
    yaw = (standing.times + np.pi) % (2.0 * np.pi) - np.pi  # [rad], at 1 rad/s; the pillar is on the x axis
    turning = replace(standing, poses=np.column_stack([standing.poses[:, :2], yaw]))
    marked = markers(turning, lambda row: RIGHT if abs(yaw[row]) < 2.3 else WRONG, every=1)
    kept = [
        each
        for row, each in enumerate(marked.markers)
        if not (lost and row % lost == 0 and abs(yaw[row]) < 2.3)
    ]
    item = place(replace(marked, markers=tuple(kept)))
    assert item.points == pytest.approx(17.7, abs=0.1)
    assert "73 % with the pillar to the side, 100 % with it ahead" in item.evidence


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
        assert place(with_samples([*others, *right])).points == points
    gone = place(with_samples([right[0], replace(right[0], action="delete")]))
    assert (gone.points, "deleted as soon as it has come" in gone.evidence) == (0.0, True)


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
