"""The state bar: what keeps the robot from driving comes first."""

from math import inf
from time import monotonic

import pytest

from husky_web import state_bar
from husky_web.log import (
    Line,
)
from husky_web.state_bar import Figures, Moving, RobotStatus, StopReason, state_html


@pytest.mark.parametrize(
    ("status", "level", "words"),
    [
        (
            RobotStatus(is_locked=True, activity="driving"),
            "error",
            "emergency stop: the robot obeys no command",
        ),
        (RobotStatus(is_locked=True, has_listener=False, is_silent=True), "error", state_bar.UNHEARD),
        (RobotStatus(is_locked=True, is_silent=True), "error", state_bar.UNCERTAIN),
        (RobotStatus(is_locked=True, is_silent=True, is_paused=True), "error", state_bar.LOCKED),
        (RobotStatus(is_paused=True, activity="driving"), "warn", "PAUSED"),
        (RobotStatus(activity="<driving>"), "ok", "&lt;driving&gt;"),
        (RobotStatus(activity="arrived"), "ok", "at the pillar"),
        (RobotStatus(is_silent=True), "error", "the robot is not responding"),
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
    assert (">1.00 <small>m<" in html) == (status.activity != "arrived"), "at the pillar nothing is to go"


def test_the_state_bar_says_what_has_stopped_the_controller_as_text():
    assert ">&lt;hit&gt;</div>" in state_html(RobotStatus(activity="stopped", reason="<hit>"), Figures())


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


def test_what_a_page_has_moved_is_told_until_the_controller_can_have_answered():
    moving = Moving()
    with moving("box"):
        assert moving.text(5.0, inf) == "box"
    now = monotonic()
    assert [moving.text(time, now) for time in (5.02, 5.04, 5.06)] == ["box", "box", ""]
    with moving("box"):
        pass
    assert moving.text(5.0, now) == "box"
    assert [moving.text(time, now) for time in (0.0, 0.02, 0.04)] == ["box", "box", ""], "time begins again"
    with moving("box"):
        pass
    ends = [moving.text(5.0, monotonic() + passed) for passed in (0.2, 0.31)]
    assert ends == ["box", ""], "a world that is slow or has no clock"
