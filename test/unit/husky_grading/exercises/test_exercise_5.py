"""Exercise 5: what a machine can judge of it, and which call of the service is due when."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from husky_grading.displays import RvizView
from husky_grading.exercises.exercise_5 import (
    Call,
    CallPlan,
    ServiceCalls,
    ServiceWatch,
    judge_calls,
    judge_exercise_5,
)
from husky_grading.exercises.watch import Answer, DriveState
from husky_grading.notes import Kind, Note
from husky_grading.recording import Recording
from husky_highlevel_controller.config import to_plain
from husky_highlevel_controller.datatypes import Pose2D

TIMES = np.arange(0.02, 20.0, 0.02)  # [s]
SCAN = "/front/scan"
VIEW = RvizView()


def recording(speeds=0.0, made=None, **more):
    poses, twists = np.zeros((len(TIMES), 3)), np.zeros((len(TIMES), 2))
    twists[:, 0] = speeds
    watched = to_plain(made or ServiceCalls())
    return Recording(Pose2D(), (20.0, 5.0), 60.0, TIMES, poses, twists, TIMES, watched=watched, **more)


def called(*pairs, services=("/start_stop",), still=()):
    """Calls every 4 s from 1 s on: (data, speed afterwards); it drives before, but between two moments."""
    speeds, calls = np.full(len(TIMES), 0.5), []
    for number, (data, speed) in enumerate(pairs):
        at = 1.0 + 4.0 * number
        calls.append(Call(at, data, True, "", at))
        speeds[at + 0.5 <= TIMES] = speed
    if still:
        speeds[(still[0] < TIMES) & (still[1] > TIMES)] = 0.0
    return recording(speeds, ServiceCalls(services, (), tuple(calls)))


def with_calls(drive, *calls):
    """A drive with other calls."""
    return replace(drive, watched=to_plain(replace(drive.watched_as(ServiceCalls), calls=calls)))


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
        (STANDS, (0.4, 99.0), None, None, "the robot already stood before each call"),
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
            "/other has looked it up 212 times; each call",
            "check the calls of that node",
        ),
        ({"/waits": 2}, "0.50 m/s after true", "check that no other node of yours calls the service"),
    ],
)
def test_another_node_that_calls_a_service_which_stops_nothing_is_named(callers, evidence, hint):
    never_stops = called((False, 0.5), (True, 0.5), (False, 0.5), (True, 0.5))
    made = replace(never_stops.watched_as(ServiceCalls), callers=callers)
    never_stops = replace(never_stops, watched=to_plain(made))
    for item in judge_calls(never_stops):
        assert hint in item.hint
    stop = judge_calls(never_stops)[0]
    assert evidence in stop.evidence
    assert "/waits" not in stop.evidence


def test_another_service_of_the_right_type_is_left_to_a_person_if_the_first_one_stops_nothing():
    services = ("/enable_log", "/start_stop")
    never_stops = [(False, 0.5), (True, 0.5), (False, 0.5), (True, 0.5)]
    items = judge_exercise_5([called(*never_stops, services=services)], VIEW, SCAN)
    assert [item.points for item in items] == [None] * 4
    assert items[0].evidence.endswith(
        "/enable_log stops nothing, and /start_stop of the same type was not called"
    )
    items = judge_exercise_5([called(*STOPS, services=services)], VIEW, SCAN)
    assert [item.points for item in items] == [50.0, 50.0, None, None]
    items = judge_exercise_5([called(*STANDS, still=(0.0, 99.0), services=services)], VIEW, SCAN)
    assert [item.points for item in items] == [0.0, 0.0, None, None], "it never drives"


@pytest.mark.parametrize(
    ("pairs", "stop", "start"),
    [
        ([(False, 0.0), (False, 0.0), (True, 0.5), (False, 0.0), (True, 0.5)], 50.0, 50.0),
        ([(False, 0.5), (True, 0.0), (True, 0.0), (False, 0.5), (True, 0.0)], 50.0, 50.0),
        # it changes between driving and standing at each call
        ([(False, 0.0), (False, 0.5), (True, 0.0), (False, 0.5), (True, 0.0)], 25.0, None),
        ([(False, 0.5), (True, 0.0), (True, 0.5), (False, 0.0), (True, 0.5)], 25.0, None),
        # it starts again after some time
        ([(False, 0.0), (False, 0.5), (True, 0.5), (False, 0.0), (True, 0.5)], 25.0, 50.0),
    ],
)
def test_a_value_that_has_stopped_the_robot_must_not_start_it_when_it_is_repeated(pairs, stop, start):
    items = judge_calls(called(*pairs))
    assert [item.points for item in items] == [stop, start]
    assert ("it drives at 0.50 m/s" in items[0].evidence) == (stop < 50.0)
    assert ("2 of 2" in items[0].evidence) == (stop == 50.0)


@pytest.mark.parametrize(("stopping", "values"), [(False, "FFTFT"), (True, "FTTFT"), (None, "FTFT")])
def test_the_first_value_that_stops_the_robot_is_sent_once_more(stopping, values):
    plan, made, speed = CallPlan(), "", 0.5
    for tick in range(600):
        value = plan.due(0.1 * tick, speed)
        if value is not None:
            made += str(value)[0]
            speed = 0.0 if value is stopping else 0.5
            plan.answered(0.1 * tick)
    assert made == values


def test_an_error_of_a_service_that_works_is_told_and_costs_nothing():
    obeys = called(*STOPS)
    calls = obeys.watched_as(ServiceCalls).calls
    refused = [replace(each, success=False, answer="handler returned None") for each in calls]
    said = judge_calls(with_calls(obeys, *refused))
    assert "None" not in said[0].evidence, "an answer without success may be meant so"
    errors = judge_calls(with_calls(obeys, *(replace(each, is_error=True) for each in refused)))
    assert [item.points for item in errors] == [50.0, 50.0]
    for item in errors:
        assert item.evidence.endswith(
            " after 2 of 2 calls, but 2 of them had an error: handler returned None"
        )


def test_a_call_that_takes_long_is_judged_from_its_answer():
    late = called((False, 0.0))
    speeds = late.speeds.copy()
    speeds[(late.times > 1.0) & (late.times < 2.7)] = 0.5  # a busy machine: the call arrives after 1.6 s
    late = replace(late, speeds=speeds)
    assert judge_calls(late)[0].points == 0.0
    late = with_calls(late, Call(1.0, False, True, "", 2.6))
    assert judge_calls(late)[0].points == 50.0


def test_a_call_after_which_the_drive_ends_is_not_judged():
    """Without a moment after the call nobody knows what it did."""
    stops = called((False, 0.0), (True, 0.5), (False, 0.0))
    at = float(TIMES[-1]) - 0.5
    started = with_calls(stops, *stops.watched_as(ServiceCalls).calls, Call(at, True, True, "", at))
    assert [item.points for item in judge_calls(started)] == [50.0, 50.0]
    assert "drives after 1 of 1 calls" in judge_calls(started)[1].evidence
    only = recording(0.5, ServiceCalls(("/start_stop",), (), (Call(at, False, True, "", at),)))
    assert [item.points for item in judge_calls(only)] == [None, None]
    assert "the run ended before the effect" in judge_calls(only)[0].evidence


SLOW = Note(Kind.UNANSWERED_SCANS, "it does not answer every scan with a command")


@pytest.mark.parametrize(
    ("notes", "evidence"),
    [
        ((Note(Kind.NODE_FAILED, "node x ends"),), "no std_srvs/SetBool service: node x ends"),
        # these notes are not reasons for a missing service
        ((SLOW, Note(Kind.FLOOD, "it floods cmd_vel")), "no std_srvs/SetBool service"),
    ],
)
def test_no_service_is_told(notes, evidence):
    assert [item.evidence for item in judge_calls(recording(notes=notes))] == [evidence] * 2


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_service_of_another_type_is_left_to_a_person(speed):
    items = judge_exercise_5([recording(speed, ServiceCalls((), ("/go (std_srvs/Empty)",)))], VIEW, SCAN)
    assert [item.points for item in items[:2]] == [None, None]
    assert items[0].evidence == "to be graded by hand: no std_srvs/SetBool service, but /go (std_srvs/Empty)"


@pytest.mark.parametrize(
    "items",
    [
        judge_exercise_5([recording()], VIEW, SCAN),
        judge_exercise_5([recording(1.0)], VIEW, SCAN),
        judge_exercise_5(
            [recording(1.0, ServiceCalls(("/stop",), (), (Call(5.0, True, True, "", 5.1),)))], VIEW, SCAN
        ),
    ],
)
def test_every_item_that_lost_points_says_what_to_look_at(items):
    lost = [item for item in items if item.points is not None and not item.full]
    assert lost
    assert [item.name for item in lost if not item.hint] == []


def test_calls_come_four_seconds_after_the_last_answer_from_a_second_after_it_drives():
    plan, made = CallPlan(), []
    for tick in range(300):
        now = 0.1 * tick
        if made and round(now - made[-1][0], 1) == 1.0:
            plan.answered(now)
        value = plan.due(now, 0.5 if now > 3.0 else 0.0)
        if value is not None:
            made.append((round(now, 1), value))
            assert plan.reason(now + 10.0, has_service=True) is None, "the call is not answered"
    assert [value for _, value in made] == [False, True, False, True]
    assert made[0][0] in (4.1, 4.2)
    assert all(4.9 <= b[0] - a[0] <= 5.2 for a, b in zip(made, made[1:]))
    assert plan.reason(30.0, has_service=True).kind is Kind.PLAN_DONE
    assert CallPlan().reason(26.0, has_service=False).text == "it offered no start/stop service for 25 s"
    waits = CallPlan()
    assert [waits.due(now, 0.0) for now in (7.9, 8.0)] == [None, False], "it may wait for a call to drive"


def test_the_service_of_the_right_type_is_called_and_its_answer_is_kept_with_the_moment_it_came():
    asked, answers = [], []
    types = {"/go": "std_srvs/Empty", "/stop": "std_srvs/SetBool"}
    ros = SimpleNamespace(
        service_types=lambda names: {name: types[name] for name in names},
        call=lambda *call: asked.append(call),
        answer=lambda: answers[0] if answers else None,
        callers=lambda name: {"/other": 3},
    )
    watch = ServiceWatch(recording(), ros)
    assert watch.look(DriveState(8.0, 0.5, services=("/go", "/stop"))) is None
    assert asked == [("/stop", False)]
    assert watch.look(DriveState(8.5, 0.5)) is None
    assert watch.kept()["calls"] == []
    answers.append(Answer(True, "stopped"))
    assert watch.look(DriveState(9.0, 0.0)) is None
    call = {"at": 8.0, "data": False, "success": True, "answer": "stopped", "answered_at": 9.0}
    made = {**call, "is_error": False}
    services = {"services": ["/stop"], "other_services": ["/go (std_srvs/Empty)"]}
    assert watch.kept() == {**services, "calls": [made], "callers": {"/other": 3}}
    assert watch.look(DriveState(60.0, 0.0)).kind is Kind.DEADLINE


def test_a_submission_that_a_call_has_stopped_may_be_silent_and_no_other():
    answers = []
    ros = SimpleNamespace(
        service_types=lambda names: {"/stop": "std_srvs/SetBool"},
        call=lambda *_: None,
        answer=lambda: answers[0] if answers else None,
    )
    watch = ServiceWatch(recording(), ros)
    assert not watch.has_silenced(7.9), "no call yet"
    watch.look(DriveState(8.0, 0.5))
    assert watch.has_silenced(8.1), "also while the call is on its way"
    answers.append(Answer(True, ""))
    watch.look(DriveState(8.2, 0.0))
    assert watch.has_silenced(8.1)
    assert not watch.has_silenced(9.0), "it has sent a command since"
