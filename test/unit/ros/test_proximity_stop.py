"""proximity_stop says that it cannot judge, but not while the robot's nodes are still starting."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

import rospy

from husky_highlevel_controller.ros.safety.proximity_stop import ProximityStopNode


@pytest.fixture
def node(monkeypatch):
    """One without a master, that collects its warnings."""
    node = ProximityStopNode.__new__(ProximityStopNode)
    node._blind_since, node.said = None, []
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda _, sentence: node.said.append(sentence))
    return node


def test_a_second_without_odometry_is_the_start_and_more_is_a_warning(node):
    for stamp in (10.0, 10.5, 10.95):
        node._warn_if_it_lasts(stamp, "no fresh odometry")
    assert node.said == []
    node._warn_if_it_lasts(11.05, "no fresh odometry")
    assert node.said == ["no fresh odometry"]


def test_a_simulation_that_begins_again_may_start_again(node):
    node._warn_if_it_lasts(100.0, "no fresh odometry")
    node._warn_if_it_lasts(0.0, "no fresh odometry")
    node._warn_if_it_lasts(0.9, "no fresh odometry")
    assert node.said == []
    node._warn_if_it_lasts(1.1, "no fresh odometry")
    assert len(node.said) == 1
