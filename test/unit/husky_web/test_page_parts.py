"""What the page does: holding to drive, who may come in, parameters, the log, curves, worlds, rays."""

import asyncio
import json
import queue
import re
import threading
from dataclasses import fields
from math import inf
from time import monotonic
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.datatypes import IDENTITY, STOP, HuskyError, Twist2D
from husky_web import actions, drawing, state_bar, topics
from husky_web.log import (
    CAPACITY,
    EARLIER,
    LEVELS,
    SHOWN,
    Filter,
    Line,
    LogBuffer,
    lines_of_rosout,
    log_to_html,
)
from husky_web.mouse import Drag, Mouse, point_on_level
from husky_web.page_server import _parse, refusal
from husky_web.pages import MOVE
from husky_web.parameters import (
    by_group,
    from_yaml,
    parameters,
    shown_value,
    to_yaml,
)
from husky_web.plots import CHARTS, Curve, chart_html, fixed, nice_ticks
from husky_web.recorder import recording_page
from husky_web.state_bar import Figures, Moving, RobotStatus, StopReason, state_html
from husky_web.teleop import EXPIRY, HoldToDrive, clamp_axis, set_speed
from husky_web.viser_private import LoopEvent

AHEAD, TURN = Twist2D(0.5, 0.0), Twist2D(0.0, 0.8)


def test_the_page_that_took_hold_first_drives_until_it_lets_go_is_silent_or_gone():
    hold = HoldToDrive()
    assert hold.command(0.0) is None
    hold.hold(1, AHEAD, 0.0)
    hold.hold(2, TURN, 0.1)
    hold.release(2)
    assert hold.command(EXPIRY - 0.01) == AHEAD
    hold.hold(1, STOP, EXPIRY - 0.01)
    assert [hold.command(0.25), hold.command(0.3)] == [STOP, None], "it stops once"
    hold.hold(1, AHEAD, 1.0)
    assert hold.command(1.0 + EXPIRY + 0.01) == STOP, "silent"
    hold.hold(1, AHEAD, 2.0)
    hold.hold(2, TURN, 3.0)  # page 1 is silent by now
    assert hold.command(3.0) == TURN
    hold.release(2)
    assert hold.command(3.01) == STOP
    assert not hold.is_active


@pytest.mark.parametrize(
    ("value", "axis"),
    [
        *[(value, None) for value in ("1", None, True, float("nan"), float("inf"), [1])],
        *[(3, 1.0), (-0.5, -0.5), (10**400, 1.0)],
    ],
)
def test_an_axis_is_a_number_limited_to_full_speed(value, axis):
    assert clamp_axis(value) == axis


def test_junk_on_the_drive_channel_is_no_message():
    assert _parse("[" * 999) is None
    assert _parse('{"linear": NaN}') == {"linear": pytest.approx(float("nan"), nan_ok=True)}


HERE = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize(
    ("headers", "path", "is_loopback", "token", "words"),
    [
        (HERE, "/", True, None, None),
        ({"Host": "localhost:9000", "Origin": "http://localhost:9000"}, "/drive", True, None, None),
        ({"Host": "evil.example:8080"}, "/", True, None, "evil.example"),  # a name that points here by DNS
        ({**HERE, "Origin": "http://evil.example"}, "/drive", True, None, "another site"),
        ({**HERE, "Origin": "null"}, "/", True, None, "another site"),
        ({"Host": "10.0.0.5:8080"}, "/", False, "s3cret", "token"),
        ({"Host": "10.0.0.5:8080"}, "/?token=wrong", False, "s3cret", "token"),
        ({"Host": "10.0.0.5:8080"}, "/?token=s3cret", False, "s3cret", None),
        ({"Host": "10.0.0.5:8080", "Cookie": "husky_token=s3cret"}, "/drive", False, "s3cret", None),
        ({"Host": "10.0.0.5:8080", "Cookie": "husky_token=s3cre"}, "/drive", False, "s3cret", "token"),
    ],
)
def test_who_may_come_in(headers, path, is_loopback, token, words):
    reason = refusal(headers, path, is_loopback, token)
    assert (reason is None) if words is None else (words in reason)


def entry(name, kind, low, high, default, description="", **more):
    shown = dict(name=name, type=kind, min=low, max=high, default=default, description=description)
    return {**shown, **more}


DESCRIPTION = {
    "parameters": [
        entry("p_gain", "double", 0.0, 10.0, 2.0, description="forward speed for each metre [1/s]"),
        entry("beams", "int", 1, 720, 2),
        entry("search", "bool", False, True, True),
    ],
    "groups": {"more": {"parameters": [entry("name", "str", "", "", "x")], "groups": {}}},
}


def test_parameters_of_all_groups_with_their_units():
    found = parameters(DESCRIPTION)
    labels = ["p_gain [1/s]", "beams", "search (default on)", "name (default x)"]
    assert [item.label for item in found] == labels
    assert [item.has_slider for item in found] == [True, True, False, False]
    assert [found[0].step, found[1].step] == [0.01, 1]


def test_the_controller_s_parameters_are_grouped_and_another_server_s_are_as_it_says():
    records = (*fields(ControlConfig), *fields(PillarConfig))
    ours = parameters({"parameters": [entry(item.name, "double", 0.0, 1.0, 0.5) for item in records]})
    groups = by_group(ours)
    assert list(groups) == ["Gains", "Limits", "Search", "Detection"]
    assert [item.name for item in groups["Gains"]] == ["p_gain_vel", "p_gain_ang"]
    assert {item.name for item in groups["Detection"]} == {item.name for item in fields(PillarConfig)}
    named = {"more": {**DESCRIPTION["groups"]["more"], "name": "more"}}
    assert list(by_group(parameters({**DESCRIPTION, "groups": named}))) == ["", "Search", "more"]


def test_an_enumeration_has_choices_and_shows_its_values_by_name():
    method = "{'enum': [{'name': 'Low', 'value': 0}, {'name': 'High', 'value': 2}]}"
    (found,) = parameters({"parameters": [entry("level", "int", 0, 2, 0, edit_method=method)]})
    assert found.choices == (("Low", 0), ("High", 2))
    assert not found.has_slider
    # its field has the names as options; a value among them would be sent again at each update
    assert [shown_value(found, value) for value in (0, 2, 7)] == ["Low", "High", 7]


def test_yaml_goes_round():
    known = {"/node": parameters(DESCRIPTION)}
    values = {"/node": {"p_gain": 3.5, "beams": 4, "search": False, "name": "y"}}
    assert from_yaml(to_yaml(values), known) == values


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "no YAML"),
        ("3", "name nodes"),
        ("/other: {p_gain: 1}", "/other"),
        ("/node: {q_gain: 1}", "q_gain"),
        ("/node: {p_gain: 11}", "p_gain = 11 is not within 0.0..10.0"),
        ("/node: {p_gain: fast}", "p_gain = 'fast'"),
        ("/node: {beams: 2.5}", "beams = 2.5"),
        ("/node: {search: 1}", "search = 1"),
        ("/node: {p_gain: .nan}", "p_gain"),
    ],
)
def test_a_file_that_cannot_be_is_refused_in_words(text, words):
    with pytest.raises(HuskyError) as error:
        from_yaml(text, {"/node": parameters(DESCRIPTION)})
    assert words in str(error.value)


def line(text, level="info", node="/robot", stamp=1.0):
    header = SimpleNamespace(stamp=SimpleNamespace(to_sec=lambda: stamp))
    return SimpleNamespace(level=LEVELS[level], header=header, name=node, msg=text)


def log_of(*lines):
    log = LogBuffer()
    for each in lines:
        log.add(each)
    return log


def test_the_log_is_filtered_newest_first_and_capped():
    numbered = (line(f"line {number}") for number in range(CAPACITY + 10))
    log = log_of(*numbered, line("Pillar lost", "warn", "/controller"))
    assert [item.text for item in log.select(Filter())[:2]] == ["Pillar lost", f"line {CAPACITY + 9}"]
    assert len(log.select(Filter())) == SHOWN
    assert [item.text for item in log.select(Filter(level=LEVELS["warn"]))] == ["Pillar lost"]
    assert [item.text for item in log.select(Filter(node="contr", text="pillar"))] == ["Pillar lost"]
    assert log.select(Filter(text="line 3 ")) == []


ROSOUT = """the end of a line that is cut off
0.000000000  Node Startup
0.020000000 INFO /controller [node.py:12(Node.run)] [topics: /clock, /rosout] driving [2 pillars]
1795748647.638548000 WARN /smb/driver two
lines, and [brackets]
7.500000000 ERROR /cpp [/src/a.cpp:5(main)] [topics: /rosout] boom
"""


def test_what_rosout_has_written_before_comes_before_each_line_once():
    earlier = lines_of_rosout(ROSOUT)
    assert earlier == [
        Line(LEVELS["info"], 0.02, "/controller", "driving [2 pillars]"),
        Line(LEVELS["warn"], 1795748647.638548, "/smb/driver", "two\nlines, and [brackets]"),
        Line(LEVELS["error"], 7.5, "/cpp", "boom"),
    ]
    log = log_of(line("driving [2 pillars]", node="/controller", stamp=0.02), line("newest"))
    log.add_earlier(earlier)
    texts = [item.text for item in log.select(Filter())]
    assert texts == ["newest", "driving [2 pillars]", "boom", "two\nlines, and [brackets]"]
    assert log.count == 4, "so that pages draw it anew"
    log = log_of(*(line(f"line {number}") for number in range(CAPACITY - 5)))
    log.add_earlier(lines_of_rosout("".join(f"1.0 INFO /n {number}\n" for number in range(2 * EARLIER))))
    assert log.select(Filter())[0].text == f"line {CAPACITY - 6}", "what is new stays"


def test_lines_of_the_log_are_cut_are_never_markup_and_show_the_time_of_day_where_it_is_wall_time():
    assert len(log_to_html(log_of(*[line("x" * 200_000)] * 20).select(Filter()))) < 40_000
    hostile = line("<script>alert(1)</script>", node="/<b>")
    times = (line("a", stamp=12.5), line("a", stamp=1700000000.0))
    html = log_to_html(log_of(hostile, *times).select(Filter()))
    assert "<script>" not in html
    assert "/<b>" not in html
    assert ">12.50<" in html
    assert ">22:13:20<" in html


def test_a_curve_keeps_its_window_and_begins_anew_when_time_runs_backwards():
    curve = Curve(1, window=10.0)
    for second in range(30):
        curve.add(float(second), second / 2.0)
        curve.add(float(second), -1.0)  # the clock stands still
    times, values = curve.arrays
    assert times.tolist() == [float(second) for second in range(19, 30)]
    assert values[-1] == 14.5
    curve.add(0.0, 7.0)
    assert [array.tolist() for array in curve.arrays] == [[0.0], [7.0]]


def test_a_rate_is_the_growth_over_the_last_seconds():
    amounts = Curve(1, window=2.0)
    assert amounts.rate is None
    for second in np.arange(0.0, 10.0, 0.5):
        amounts.add(second, min(50.0 * second, 425.0))
    assert amounts.rate == pytest.approx(25.0)  # from 375 at 7.5 s to 425 at 8.5 s and later
    amounts.add(10.0, 0.0)  # counted anew
    assert amounts.rate is None


@pytest.mark.parametrize(
    ("down", "level", "point"),
    [(-1, 0.5, (1.5, 0.0, 0.5)), (1, 0.0, None), (0, 0.0, None), (-1e-4, 0.0, None)],
)
def test_a_click_meets_the_ground_below_the_horizon_only(down, level, point):
    assert point_on_level((0, 0, 2), (1, 0, down), level) == (point and pytest.approx(point))


@pytest.mark.parametrize("value", [float("nan"), 1.7e308, -1.7e308, 1e12])
def test_a_chart_draws_what_is_no_measurement_as_a_gap_and_survives_nothing(value):
    speed = CHARTS[2]
    times, values = np.arange(5.0), np.array([0.0, 0.1, value, -value, 0.2])
    html = chart_html(speed, (times, values, values))
    curve = re.search(r'class="curve commanded" d="([^"]+)"', html)
    assert re.sub("[0-9.,]", "", curve.group(1)) == "MLM"
    assert len(html) < 5000
    assert 'text-anchor="end">0.2<' in html
    assert "<svg" in chart_html(speed, (np.zeros(0),) * 3)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -5.0, 0.0, 50.0, 1e308])
def test_a_speed_that_no_slider_has_is_not_taken(value):
    teleop = SimpleNamespace(max_linear=0.5)
    for sent, taken in ((value, 0.5), (0.7, 0.7)):
        set_speed(teleop, "max_linear", 1.0, SimpleNamespace(target=SimpleNamespace(value=sent)))
        assert teleop.max_linear == taken


def test_a_chart_marks_a_change_of_a_parameter_while_it_is_in_the_window():
    times = np.arange(0.0, 100.0)
    marks = [(50.0, "p_gain_vel 2 > 1"), (90.0, "<p_gain_ang> 2 > 4")]
    html = chart_html(CHARTS[0], (times, times), marks)
    assert "p_gain_vel" not in html
    assert "&lt;p_gain_ang&gt; 2 &gt; 4" in html


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [(0.0, 19.69, [0, 10, 20]), (-0.02, 0.25, [-0.1, 0, 0.1, 0.2, 0.3]), (0.0, 1.0, [0, 0.5, 1.0])],
)
def test_ticks_are_round_and_hold_all_values(low, high, ticks):
    assert nice_ticks(low, high) == pytest.approx(ticks)


def test_a_message_of_another_thread_wakes_the_pages_by_their_own_loop():
    # viser sets the event in both; the first is a race that ends the caller (seen in a drive)
    async def scenario():
        event, loop = LoopEvent(), asyncio.get_running_loop()
        waiter = loop.create_task(event.wait())
        await loop.run_in_executor(None, event.set)
        before = event.is_set()
        loop.call_soon_threadsafe(event.set)
        await asyncio.wait_for(waiter, 10.0)
        return before, event.is_set()

    assert asyncio.run(scenario()) == (False, True)


def test_a_number_that_rounds_to_nothing_has_no_sign():
    assert [fixed(value, 2) for value in (-0.001, 0.0, -0.01, 1.005, -12.0)] == [
        "0.00", "0.00", "-0.01", "1.00", "-12.00",
    ]  # fmt: skip


def test_a_recording_is_a_page_of_the_drive_and_without_a_pillar_too():
    rows = [(0.1 * step, 0.05 * step, 0.0, 0.0, np.nan, np.nan) for step in range(20)]
    seen = [*rows, (2.0, 1.0, 0.0, 0.0, 3.0, 1.0)]
    for rows_of_drive, robot, pillars in ((rows, "another", []), (seen, "smb", [[3.0, 1.0]])):
        page = recording_page(rows_of_drive, robot)
        drive = json.loads(re.search(r'id="data">(.*?)</script>', page).group(1))
        assert drive["pillars"] == pillars
        assert drive["times"][-1] == pytest.approx(rows_of_drive[-1][0])
    with pytest.raises(HuskyError, match="nothing is recorded"):
        recording_page([], "husky")


# ---------------------------------------------------------------------------- what does not end the page


def action_results(monkeypatch, *works):
    """What the page is told of calls, in order."""
    told: queue.Queue = queue.Queue()
    monkeypatch.setattr(actions.rospy, "logwarn", lambda _: None)
    monkeypatch.setattr(actions, "notify", lambda _client, _title, text, good: told.put((text, good)))
    queued = actions.Actions()
    for work in works:
        queued.do(work, object(), "a button")
    return [told.get(timeout=20.0) for _ in works]


def test_an_unexpected_error_of_one_button_leaves_the_others_alive(monkeypatch):
    def fails():
        raise KeyError("gone")

    assert action_results(monkeypatch, fails, lambda: "done") == [("KeyError: 'gone'", False), ("done", True)]


def test_a_service_that_hangs_is_given_up_with_a_sentence(monkeypatch):
    release = threading.Event()
    monkeypatch.setattr(actions, "CALL_TIMEOUT", 0.2)
    monkeypatch.setattr(actions.rospy, "ServiceProxy", lambda *_: lambda *_: release.wait(20.0))
    results = action_results(monkeypatch, lambda: actions.call("/reset", None), lambda: "done")
    assert results == [("/reset has not answered for 0.2 s; it may still do it", False), ("done", True)]
    release.set()


def test_an_item_that_cannot_be_shown_is_left_out_with_one_warning(monkeypatch):
    warnings = []
    monkeypatch.setattr(drawing.rospy, "logwarn", warnings.append)
    for _ in range(3):
        with drawing.left_out("/markers"):
            drawing.rgb((float("nan"), 0.0, 0.0, 1.0))
    assert warnings == ["/markers is not shown: ValueError: cannot convert float NaN to integer"]


def test_a_topic_of_two_uses_stays_open_for_the_one_that_is_shown(monkeypatch):
    subscriber = Mock()
    monkeypatch.setattr(topics.rospy, "Subscriber", lambda *_, **__: subscriber)
    listener = topics.Topics({"truth": "/odom", "odometry": "/odom"})
    listener.listen("truth", object, True)
    listener.listen("odometry", object, False)
    assert not subscriber.unregister.called


@pytest.mark.parametrize(
    ("status", "level", "words"),
    [
        (RobotStatus(is_locked=True, activity="driving"), "error", "emergency stop: no command is obeyed"),
        (RobotStatus(is_locked=True, has_listener=False, is_silent=True), "error", state_bar.UNHEARD),
        (RobotStatus(is_locked=True, is_silent=True), "error", state_bar.UNCERTAIN),
        (RobotStatus(is_locked=True, is_silent=True, is_paused=True), "error", state_bar.LOCKED),
        (RobotStatus(is_paused=True, activity="driving"), "warn", "PAUSED"),
        (RobotStatus(activity="<driving>"), "ok", "&lt;driving&gt;"),
        (RobotStatus(activity="arrived"), "ok", "at the pillar"),
        (RobotStatus(is_silent=True), "error", "no news from the robot"),
        (RobotStatus(is_master_gone=True, is_locked=True), "error", state_bar.MASTER_GONE),
        (RobotStatus(moving="unit_cylinder", activity="arrived"), "busy", "being moved: unit_cylinder"),
        (RobotStatus(is_by_hand=True, activity="driving", fault="no pillar"), "busy", "driven by hand"),
        (RobotStatus(driver="/drive", activity="stopped"), "ok", "/drive drives the robot"),
        (RobotStatus(activity="driving", level=1, fault="scans come late"), "warn", "scans come late"),
        (RobotStatus(activity="stopped"), "", "standing still until Start is pressed"),
        (RobotStatus(), "", "no node drives the robot"),
    ],
)
def test_the_state_bar_says_first_what_keeps_the_robot_from_driving(status, level, words):
    html = state_html(status, Figures(1.0, 0.0, 0.0))
    assert f'husky-state {level}"' in html
    assert f"<b>{words}</b>" in html
    assert ("to go" in html) == (status.activity != "arrived"), "at the pillar nothing is"


def test_the_state_bar_says_what_has_stopped_the_controller_as_text():
    assert log_of(line("hit: stopped", "warn"), line("started")).warning.text == "hit: stopped"
    assert "<div>&lt;hit&gt;</div>" in state_html(RobotStatus(activity="stopped", reason="<hit>"), Figures())


def test_a_later_warning_takes_no_reason_away():
    stop, hit, slow = StopReason(), Line(4, 1.1, "/controller", "hit"), Line(4, 9.0, "/simulator", "slow")
    reasons = []
    for activity, time, warning in (
        ("driving", 1.0, None), ("stopped", 1.2, hit), ("stopped", 9.2, slow), ("driving", 12.0, slow),
        ("stopped", 14.0, slow), ("stopped", None, slow),
    ):  # fmt: skip
        stop.update(activity, time, warning)
        reasons.append(stop.text)
    assert reasons == ["", "hit", "hit", "", "", ""]


def test_a_drag_ends_when_its_page_is_closed(monkeypatch):
    monkeypatch.setattr(Drag, "on_event", lambda drag, _: drag._show(IDENTITY))
    shape, node = Mock(), Mock(position=(0.0, 0.0, 0.0), wxyz=(1.0, 0.0, 0.0, 0.0))
    box = Mock(node=node, shapes=[shape], is_movable=True)
    objects = Mock(shown={("t", "box"): box}, dragged={})
    moving = Moving()
    mouse = Mouse(Mock(robot_shapes=[]), objects, None, moving, {7: SimpleNamespace(tool=MOVE)})
    mouse.bind()
    (on_drag,) = shape.on_drag.return_value.call_args.args
    asyncio.run(on_drag(Mock(phase="start", client=Mock(client_id=7))))
    assert objects.dragged
    mouse.release(8)
    assert objects.dragged, "another page"
    assert moving.text(0.0, inf) == "box"
    mouse.release(7)
    assert not objects.dragged
    assert moving.text(0.0, inf) == ""


def test_what_a_page_has_moved_is_told_until_the_controller_can_have_answered():
    moving = Moving()
    with moving("box"):
        assert moving.text(5.0, inf) == "box"
    now = monotonic()
    assert [moving.text(time, now) for time in (5.02, 5.1, 5.13)] == ["box", "box", ""]
    with moving("box"):
        pass
    assert moving.text(5.0, now) == "box"
    assert [moving.text(time, now) for time in (0.0, 0.08, 0.1)] == ["box", "box", ""], "time begins again"
