"""Exercise 2: what a machine can judge of it, and how the robot drives meanwhile."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from husky_grading.displays import RvizView
from husky_grading.exercises.exercise_2 import (
    ReadParameters,
    StraightDrive,
    judge_exercise_2,
    judge_output,
)
from husky_grading.exercises.watch import DriveState
from husky_grading.notes import Kind, Note
from husky_grading.recording import Recording
from husky_grading.records import Rules, total
from husky_highlevel_controller.config import to_plain
from husky_highlevel_controller.datatypes import Pose2D

TIMES = np.arange(0.02, 20.0, 0.02)  # [s]
SCAN = "/front/scan"
NEAREST = np.column_stack([TIMES, np.interp(TIMES, [2.0, 12.0], [20.0, 15.0])])
VIEW = RvizView("its rviz node", topics=(SCAN,), scan=True, fixed_frame="odom")


def recording(read=None, **more):
    poses, twists = np.zeros((len(TIMES), 3)), np.zeros((len(TIMES), 2))
    watched = to_plain(read or ReadParameters())
    return Recording(
        Pose2D(), (20.0, 5.0), 60.0, TIMES, poses, twists, TIMES, nearest=NEAREST, watched=watched, **more
    )


def told(first, last, lines=50, shape="[INFO] [1700000000.123456, {stamp:.6f}]: smallest range {:.3f} m"):
    """Lines from the beginning to the end of the drive, with ranges that change as evenly as its."""
    values, stamps = np.linspace(first, last, lines), np.linspace(2.0, 12.0, lines)
    return "\n".join(shape.format(value, stamp=stamp) for value, stamp in zip(values, stamps))


def printed_of(ranges, delay=0.0, every=5):
    """Output of a node that prints the range of each fifth scan, this long after the scan [s]."""
    shape = "[ INFO] [1700000000.123456789, {:.9f}]: {:.3f}"
    return "\n".join(
        shape.format(stamp + delay, value) for stamp, value in zip(TIMES[::every], ranges[::every])
    )


def test_lists_of_ranges_are_told_not_to_count():
    item = judge_output(recording(subscribed=True, output=told(20.0, 15.0, shape="{:.2f}" + ", inf" * 10)))
    assert "0 lines have a range" in item.evidence
    assert "; 50 lines with more than 10 numbers do not count" in item.evidence
    assert "take the smallest of the valid ranges" in item.hint


@pytest.mark.parametrize(
    ("item", "changes", "points"),
    [
        # the smallest range must be printed and follow the drive
        (0, {"output": told(20.0, 15.0)}, 40.0),
        (0, {"output": told(20.0, 15.0), "subscribed": False}, 0.0),
        (0, {"output": told(20.0, 15.0, shape="{:.2f}")}, 40.0),
        (0, {"output": told(19.99, 19.98, shape="{:.2f}")}, 20.0),  # it does not follow the drive
        (0, {"output": told(15.0, 20.0, shape="{:.2f}")}, 20.0),  # the wrong way round
        # by the stamps of the log, the smallest range was another one at that time
        (0, {"output": told(15.0, 20.0)}, 0.0),
        (0, {"output": printed_of(NEAREST[:, 1])}, 40.0),
        (0, {"output": printed_of(NEAREST[:, 1], delay=0.9)}, 40.0),  # a slow node with a long queue
        (0, {"output": printed_of(NEAREST[:, 1] + 0.07)}, 0.0),  # the largest range of the same pillar
        (0, {"output": told(20.0, 15.0, lines=3)}, 0.0),
        # all ranges of the scan in one line, with few or with many returns
        (0, {"output": told(20.0, 15.0, shape="[inf, " + "inf, " * 400 + "{:.2f}, 20.1, nan]")}, 0.0),
        (0, {"output": told(20.0, 15.0, shape="(" + "25.5, " * 10 + "{:.2f})")}, 0.0),
        (
            0,
            {"output": told(20.0, 15.0, shape="{:.2f} of [0.1, 30.0] at 0.35 rad: 1.0, 2.0, v 0.5, w 0.1")},
            40.0,
        ),
        (0, {"output": told(1.0, 2.0)}, 0.0),  # the stamps of the log alone are not ranges
        (0, {"output": ""}, 0.0),
        # topic and queue size are parameters
        (2, {"read": ReadParameters(("/n/topic",), ("/n/queue",))}, 15.0),
        (2, {"read": ReadParameters(("/n/t",))}, 8.0),
        (2, {}, 0.0),
        # the scan is shown in odom
        (3, {"view": VIEW}, 15.0),
        (3, {"view": replace(VIEW, fixed_frame="map")}, 10.0),
        (3, {"view": replace(VIEW, scan=False)}, 0.0),
        (3, {"view": replace(VIEW, source="")}, None),
    ],
)
def test_points_of_exercise_2(item, changes, points):
    given = {"view": VIEW, "subscribed": True, **changes}
    view = given.pop("view")
    items = judge_exercise_2([recording(**given)], view, SCAN)
    assert items[item].points == points


def test_style_is_left_to_people():
    read = ReadParameters(("/a",), ("/b",))
    items = judge_exercise_2([recording(read, subscribed=True, output=told(20.0, 15.0))], VIEW, SCAN)
    assert total(items) == (70.0, 70.0)
    assert [item.max_points for item in items if item.points is None] == [30.0]


def test_that_it_does_not_answer_every_scan_is_no_reason_to_print_nothing():
    slow = Note(Kind.UNANSWERED_SCANS, "it does not answer every scan with a command")
    assert "does not subscribe to the scans" in judge_output(recording(notes=(slow,))).evidence


def test_a_run_whose_scans_measure_nothing_says_so():
    nothing = replace(
        recording(subscribed=True), nearest=np.column_stack([TIMES, np.full(len(TIMES), np.inf)])
    )
    assert judge_output(nothing).evidence == "nothing to print: no beam of any scan measured a range"


@pytest.mark.parametrize(
    "items",
    [
        judge_exercise_2([recording()], RvizView(), SCAN, Rules(no_rviz_config="zero")),
        judge_exercise_2([recording(subscribed=True, output=told(20.0, 19.9))], VIEW, SCAN),
        judge_exercise_2([recording(subscribed=True)], replace(VIEW, fixed_frame="map"), SCAN),
        judge_exercise_2([recording(violations=("it resets the simulator",))], VIEW, SCAN),
    ],
)
def test_every_item_that_lost_points_says_what_to_look_at(items):
    lost = [item for item in items if item.points is not None and not item.full]
    assert lost
    assert [item.name for item in lost if not item.hint] == []


def drive(parameters=None):
    """A drive of marking, and the speeds [m/s] that it commands."""
    speeds = []
    ros = SimpleNamespace(
        advertise_commands=lambda: None, command=speeds.append, parameters=lambda: parameters or {}
    )
    return StraightDrive(recording(), ros), speeds


def test_the_robot_drives_for_ten_seconds_and_the_drive_ends_where_it_stands():
    watch, speeds = drive()
    for stamp in (1.0, 5.0, 12.5):
        watch.on_scan(stamp)
    assert speeds == [0.0, 0.5, 0.0]
    assert watch.look(DriveState(12.0, 0.5)) is None
    assert watch.look(DriveState(13.5, 0.0)).kind is Kind.PLAN_DONE
    assert watch.is_submission_ready(DriveState(0.0, 0.0, subscribed=True)), "it sends no command"


def test_topic_and_queue_size_are_known_among_all_parameters():
    values = {"/n/topic": "front/scan", "/n/Queue": 5, "/n/size": 5, "/n/other": "/scan", "/n/queue": "no"}
    outside_of_the_node = {"/scan_topic_name": "/front/scan", "/scan_topic_queue_size": 5}
    values = {**values, **outside_of_the_node, "/n/use_queue": True}
    assert drive(values)[0].kept() == {
        "topics": ["/n/topic", "/scan_topic_name"],
        "queues": ["/n/Queue", "/scan_topic_queue_size"],
    }


def test_a_topic_of_scans_that_is_written_wrong_is_named():
    item = judge_output(recording(silent_topics=("/front_scan",)))
    assert item.evidence == "nothing to print: it subscribes to /front_scan, where nothing is published"
    assert "rostopic list" in item.hint


def test_a_number_that_is_not_the_smallest_range_is_named():
    item = judge_output(recording(subscribed=True, output=printed_of(NEAREST[:, 1] + 0.07)))
    assert item.evidence == "prints 20.07 m while the robot stands, but the smallest range is 20.00 m"


def test_the_smallest_range_counts_among_any_number_of_other_lines():
    beams = "\n".join(f"range[{number}]: inf" for number in range(720))
    item = judge_output(recording(subscribed=True, output=told(20.0, 15.0).replace("\n", f"\n{beams}\n")))
    assert item.points == 40.0
