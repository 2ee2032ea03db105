"""Commands of a scan that has its answer are dropped; who sends more than once again and again is told."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from geometry_msgs.msg import Twist

from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros.simulator import commands


@pytest.fixture
def warnings(monkeypatch):
    warnings = []
    monkeypatch.setattr(commands.rospy, "Subscriber", lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(commands.rospy, "Publisher", lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(commands.rospy, "logwarn_throttle", lambda _, text: warnings.append(text))
    monkeypatch.setattr(commands.rospy, "get_time", lambda: 0.0)
    return warnings


def received(is_dropped, *senders):
    """Commands after one of each sender."""
    lockstep = SimpleNamespace(drops=lambda _: is_dropped, command_arrived=str)
    received = commands.Commands(load_robot().topics, lockstep, lockstep)
    for sender in senders:
        msg = Twist()
        msg._connection_header = {"callerid": sender}
        received._on_twist("cmd_vel", msg)
    return received


def test_the_stop_of_a_controller_that_ends_in_lockstep_is_no_warning(warnings):
    received(True, "/walker")
    assert warnings == []
    assert received(True, "/walker", "/walker").take(0.0) == []
    (warning,) = warnings
    assert "/walker sends several commands for one scan" in warning


def test_two_that_command_on_one_topic_are_named(warnings):
    received(False, "/walker", "/walker")
    assert warnings == []
    received(False, "/walker", "/runner")
    (warning,) = warnings
    assert warning.startswith("/cmd_vel: both /walker and /runner send commands")
