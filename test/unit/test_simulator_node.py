"""The simulator's node: wall time as simulated time."""

import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from husky_highlevel_controller.ros.simulator.node import SimulatorNode
from husky_highlevel_controller.simulator.pacing import Pacer


def test_after_a_pause_without_simulated_time_the_next_step_comes_at_once():
    simulation = SimpleNamespace(stamp=100.0)
    simulation.set_stamp = lambda stamp: setattr(simulation, "stamp", stamp)
    node = object.__new__(SimulatorNode)  # without its topics
    node._paused_topic = SimpleNamespace(publish=lambda _: None)
    node._publishers = SimpleNamespace(uses_simulated_time=False)
    node._start = SimpleNamespace(real_time_factor=1.0)
    node._simulation, node._pacer = simulation, Pacer(1.0, simulation.stamp, time.monotonic())
    node._set_paused(False)  # wall time is far ahead of the stamp
    assert node._pacer.delay(simulation.stamp, time.monotonic()) == 0.0
