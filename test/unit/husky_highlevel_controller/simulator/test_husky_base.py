"""The real drive: one limit for both sides, a control loop of 10 Hz, wheels that take time."""

from itertools import count

import pytest

from husky_highlevel_controller.datatypes import Twist2D, WheelState
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.husky_base import (
    HuskyBase,
    HuskyBaseConfig,
    scale_to_limit,
)

DT, DRIVE = 1 / 200, load_robot().drive


def treads(twist, seconds):
    """Speeds of the (left, right) treads [m/s], a physics step each."""
    base = HuskyBase(DRIVE, HuskyBaseConfig(), DT)
    rows = []
    for step in range(round(seconds / DT)):
        base.command(twist, step * DT)
        _, speeds = base.turn(step * DT, DT)
        rows.append([speed * DRIVE.wheel_radius for speed in speeds])
    return rows


@pytest.mark.parametrize(
    ("speeds", "scaled"),
    [
        ((0.4, 1.6), (0.25, 1.0)),
        ((-2.0, 1.0), (-1.0, 0.5)),
        ((0.5, -1.0), (0.5, -1.0)),
        ((0.0, 0.0), (0.0, 0.0)),
    ],
)
def test_both_sides_are_scaled_alike(speeds, scaled):
    assert scale_to_limit(*speeds, 1.0) == pytest.approx(scaled)


def test_a_step_takes_0_7_s_from_10_to_90_percent_at_2_m_s2():
    speeds = [left for left, _ in treads(Twist2D(1.0, 0.0), 4.0)]
    rise = next(i for i in count() if speeds[i] > 0.9) - next(i for i in count() if speeds[i] > 0.1)
    assert rise * DT == pytest.approx(0.7, abs=0.05)
    peak = max(b - a for a, b in zip(speeds, speeds[1:])) / DT
    assert peak == pytest.approx(2.0, abs=0.3)


def test_a_command_waits_for_the_control_loop():
    base = HuskyBase(DRIVE, HuskyBaseConfig(), DT)
    base.turn(0.0, DT)
    base.command(Twist2D(1.0, 0.0), 0.0)
    started = next(step for step in range(1, 100) if base.turn(step * DT, DT)[1][0] > 0.0)
    assert started * DT == pytest.approx(0.1)


def test_encoders_measure_whole_centimetres_a_second():
    wheels = WheelState(("a", "b"), (0.0, 0.0), (0.5 / 0.1651, 0.4968 / 0.1651), (3.0, 4.0))
    told = HuskyBase(DRIVE, HuskyBaseConfig(), DT).encoded(wheels)
    assert [speed * 0.1651 for speed in told.speeds] == pytest.approx([0.5, 0.5])
    assert told.efforts == (0.0, 0.0)
