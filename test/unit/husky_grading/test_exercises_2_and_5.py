"""Exercises 2 and 5: what a machine can judge of them."""

from dataclasses import replace

import numpy as np
import pytest

from husky_grading.displays import RvizView
from husky_grading.notes import Kind, Note
from husky_grading.recording import Call, Recording
from husky_grading.records import Rules, total
from husky_grading.rubrics.exercise_2 import judge_exercise_2, judge_output
from husky_grading.rubrics.exercise_5 import judge_calls, judge_exercise_5
from husky_highlevel_controller.datatypes import Pose2D

TIMES = np.arange(0.02, 20.0, 0.02)  # [s]
SCAN = "/front/scan"
NEAREST = np.column_stack([TIMES, np.interp(TIMES, [2.0, 12.0], [20.0, 15.0])])
VIEW = RvizView("its rviz node", topics=(SCAN,), scan=True, fixed_frame="odom")


def recording(speeds=0.0, **more):
    twists = np.zeros((len(TIMES), 2))
    twists[:, 0] = speeds
    poses = np.zeros((len(TIMES), 3))
    return Recording(Pose2D(), (20.0, 5.0), 60.0, TIMES, poses, twists, TIMES, nearest=NEAREST, **more)


def told(first, last, lines=50, shape="[INFO] [1700000000.123456, 17.420000]: smallest range {:.3f} m"):
    return "\n".join(shape.format(value) for value in np.linspace(first, last, lines))


@pytest.mark.parametrize(
    ("item", "changes", "points"),
    [
        # the smallest range must be printed and follow the drive
        (0, {"output": told(20.0, 15.0)}, 40.0),
        (0, {"output": told(20.0, 15.0), "subscribed": False}, 0.0),
        (0, {"output": told(20.0, 15.0, shape="{:.2f}")}, 40.0),
        (0, {"output": told(19.99, 19.98)}, 20.0),  # it does not follow the drive
        (0, {"output": told(15.0, 20.0)}, 20.0),  # the wrong way round
        (0, {"output": told(20.0, 15.0, lines=3)}, 0.0),
        (0, {"output": told(1.0, 2.0)}, 0.0),  # the stamps of the log alone are not ranges
        (0, {"output": ""}, 0.0),
        # topic and queue size are parameters
        (2, {"topic_parameters": ("/n/topic",), "queue_parameters": ("/n/queue",)}, 15.0),
        (2, {"topic_parameters": ("/n/t",)}, 8.0),
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
    topics = {"topic_parameters": ("/a",), "queue_parameters": ("/b",)}
    items = judge_exercise_2([recording(subscribed=True, output=told(20.0, 15.0), **topics)], VIEW, SCAN)
    assert total(items) == (70.0, 70.0)
    assert [item.max_points for item in items if item.points is None] == [30.0]


def called(*pairs, services=("/start_stop",), still=()):
    """Calls every 4 s from 1 s on: (data, speed afterwards); it drives before, but between two moments."""
    speeds, calls = np.full(len(TIMES), 0.5), []
    for number, (data, speed) in enumerate(pairs):
        at = 1.0 + 4.0 * number
        calls.append(Call(at, data, True, "", at))
        speeds[at + 0.5 <= TIMES] = speed
    if still:
        speeds[(still[0] < TIMES) & (still[1] > TIMES)] = 0.0
    return recording(speeds, calls=tuple(calls), services=services)


STOPS = [(False, 0.0), (True, 0.5), (False, 0.0), (True, 0.5)]
STANDS = [(False, 0.0), (True, 0.0), (False, 0.0), (True, 0.0)]


@pytest.mark.parametrize(
    ("pairs", "still", "stop", "start", "evidence"),
    [
        (STOPS, (), 50.0, 50.0, "stands after 2 of 2"),
        ([(False, 0.5), (True, 0.0), (False, 0.5), (True, 0.0)], (), 50.0, 50.0, ""),  # true stops
        ([(False, 0.0), (True, 0.5), (False, 0.5), (True, 0.5)], (), 25.0, 50.0, "stands after 1 of 2"),
        (STANDS, (), 50.0, 0.0, ""),
        (
            [(False, 0.5), (True, 0.5), (False, 0.5), (True, 0.5)],
            (),
            0.0,
            0.0,
            "neither value stops it: 0.50 m/s after false",
        ),
        (STANDS, (0.0, 99.0), 0.0, 0.0, ""),  # it never drives
        (STANDS, (0.4, 99.0), None, None, "stood already before each call: for a person"),
        (STOPS, (0.0, 5.5), 50.0, 50.0, ""),  # it waits for its first start
    ],
)
def test_the_service_stops_and_starts_again_and_again(pairs, still, stop, start, evidence):
    items = judge_exercise_5([called(*pairs, still=still)], VIEW, SCAN)
    assert [item.points for item in items] == [stop, start, None, None]
    assert evidence in items[0].evidence


@pytest.mark.parametrize(
    ("callers", "evidence", "hint"),
    [
        (
            {"/other": 212, "/waits": 2},
            "/other has looked it up 212 times, as each call",
            "what that node sends",
        ),
        ({"/waits": 2}, "0.50 m/s after true", "see that no other node of yours calls the service"),
    ],
)
def test_another_node_that_calls_a_service_which_stops_nothing_is_named(callers, evidence, hint):
    never_stops = called((False, 0.5), (True, 0.5), (False, 0.5), (True, 0.5))
    for item in judge_calls(replace(never_stops, callers=callers)):
        assert hint in item.hint
    stop = judge_calls(replace(never_stops, callers=callers))[0]
    assert evidence in stop.evidence
    assert "/waits" not in stop.evidence


def test_a_call_that_takes_long_is_judged_from_its_answer():
    late = called((False, 0.0))
    speeds = late.speeds.copy()
    speeds[(late.times > 1.0) & (late.times < 2.7)] = 0.5  # a busy machine: the call arrives after 1.6 s
    late = replace(late, speeds=speeds)
    assert judge_calls(late)[0].points == 0.0
    late = replace(late, calls=(replace(late.calls[0], answered_at=2.6),))
    assert judge_calls(late)[0].points == 50.0


def test_a_call_after_which_the_drive_ends_is_not_judged():
    """Without a moment after the call nobody knows what it did."""
    stops = called((False, 0.0), (True, 0.5), (False, 0.0))
    at = float(TIMES[-1]) - 0.5
    started = replace(stops, calls=(*stops.calls, Call(at, True, True, "", at)))
    assert [item.points for item in judge_calls(started)] == [50.0, 50.0]
    assert "drives after 1 of 1 calls" in judge_calls(started)[1].evidence
    only = recording(0.5, calls=(Call(at, False, True, "", at),), services=("/start_stop",))
    assert [item.points for item in judge_calls(only)] == [None, None]
    assert "the drive ended before its effect" in judge_calls(only)[0].evidence


SLOW = Note(Kind.UNANSWERED_SCANS, "it does not answer every scan with a command")


@pytest.mark.parametrize(
    ("notes", "evidence"),
    [
        ((Note(Kind.NODE_FAILED, "node x ends"),), "no std_srvs/SetBool service: node x ends"),
        # that it sleeps is no reason to have none
        ((SLOW, Note(Kind.FLOOD, "it floods cmd_vel")), "no std_srvs/SetBool service"),
    ],
)
def test_no_service_is_told(notes, evidence):
    assert [item.evidence for item in judge_calls(recording(notes=notes))] == [evidence] * 2
    assert "does not subscribe to the scans" in judge_output(recording(notes=(SLOW,))).evidence


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_service_of_another_type_is_left_to_a_person(speed):
    items = judge_exercise_5([recording(speed, other_services=("/go (std_srvs/Empty)",))], VIEW, SCAN)
    assert [item.points for item in items[:2]] == [None, None]
    assert items[0].evidence == "no std_srvs/SetBool service, but /go (std_srvs/Empty): for a person"


@pytest.mark.parametrize(
    "items",
    [
        judge_exercise_2([recording()], RvizView(), SCAN, Rules(no_rviz_config="zero")),
        judge_exercise_2([recording(subscribed=True, output=told(20.0, 19.9))], VIEW, SCAN),
        judge_exercise_2([recording(subscribed=True)], replace(VIEW, fixed_frame="map"), SCAN),
        judge_exercise_2([recording(violations=("it resets the simulator",))], VIEW, SCAN),
        judge_exercise_5([recording()], VIEW, SCAN),
        judge_exercise_5([recording(1.0)], VIEW, SCAN),
        judge_exercise_5(
            [recording(1.0, services=("/stop",), calls=(Call(5.0, True, True, "", 5.1),))], VIEW, SCAN
        ),
    ],
)
def test_every_item_that_lost_points_says_what_to_look_at(items):
    lost = [item for item in items if item.points is not None and not item.full]
    assert lost
    assert [item.name for item in lost if not item.hint] == []
