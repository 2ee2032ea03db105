"""Commands of a scan that has its answer are dropped; who sends more than once again and again is told."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from geometry_msgs.msg import Twist

from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros.simulator import commands


def test_the_stop_of_a_controller_that_ends_in_lockstep_is_no_warning(monkeypatch):
    warnings = []
    monkeypatch.setattr(commands.rospy, "Subscriber", lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(commands.rospy, "Publisher", lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(commands.rospy, "logwarn_throttle", lambda _, text: warnings.append(text))
    monkeypatch.setattr(commands.rospy, "get_time", lambda: 0.0)
    lockstep = SimpleNamespace(drops=lambda _: True)
    received = commands.Commands(load_robot().topics, lockstep, None)
    msg = Twist()
    msg._connection_header = {"callerid": "/walker"}
    received._on_twist("cmd_vel", msg)
    assert warnings == []
    received._on_twist("cmd_vel", msg)
    assert len(warnings) == 1
    assert "/walker sends several commands for one scan" in warnings[0]
    assert received.take(0.0) == []
