"""Velocity commands on their way to the wheels: limits, geometry, timeout, nonsense refused."""

from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.datatypes import STOP, Twist2D
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.diff_drive import (
    CommandError,
    Drive,
    limit,
    twist_of_wheels,
    wheel_speeds,
)

CONFIG = load_robot().drive
DT = 0.01  # [s]
LAW = settings(derandomize=True, deadline=None, max_examples=80)

anything = st.builds(Twist2D, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
allowed = st.builds(Twist2D, st.floats(-1.0, 1.0), st.floats(-2.0, 2.0))
steps = st.floats(0.0, 1.0)


def assert_within_limits(twist, previous, dt):
    assert abs(twist.linear) <= 1.0
    assert abs(twist.angular) <= 2.0
    assert abs(twist.linear - previous.linear) <= 3.0 * dt + 1e-12
    assert abs(twist.angular - previous.angular) <= 6.0 * dt + 1e-12


@LAW
@given(anything, allowed, steps)
def test_speed_and_acceleration_keep_their_limits_limited_twice_and_mirrored(target, previous, dt):
    once = limit(target, previous, dt, CONFIG)
    assert_within_limits(once, previous, dt)
    assert limit(once, previous, dt, CONFIG) == once
    opposite, before = (Twist2D(-twist.linear, -twist.angular) for twist in (target, previous))
    assert limit(opposite, before, dt, CONFIG) == (-once.linear, -once.angular)


@LAW
@given(anything)
def test_wheel_odometry_of_the_wheel_speeds_of_a_twist_gives_that_twist_back(twist):
    assert twist_of_wheels(*wheel_speeds(twist, CONFIG), CONFIG) == pytest.approx(twist, abs=1e-9)


def test_wheels_turn_alike_straight_on_and_apart_over_the_widened_track_in_a_turn():
    assert wheel_speeds(Twist2D(1.0, 0.0), CONFIG) == pytest.approx((1.0 / 0.1651,) * 2)
    # 1.875 x 0.5708 m between the wheels of the Noetic Husky
    assert wheel_speeds(Twist2D(0.0, 1.0), CONFIG) == pytest.approx((-3.24122, 3.24122), abs=1e-5)


def run(drive, start, duration):
    """Update every DT from `start` for `duration`; the outputs."""
    first, count = round(start / DT), round(duration / DT)
    return [drive.update((first + i) * DT, DT) for i in range(1, count + 1)]


def commanded(twist, now=0.0):
    drive = Drive(CONFIG)
    drive.command(twist, now)
    return drive


def test_it_stands_still_before_the_first_command_and_after_a_reset():
    assert run(Drive(CONFIG), 0.0, 1.0) == [STOP] * 100
    drive = commanded(Twist2D(1.0, 1.0))
    run(drive, 0.0, 0.2)
    drive.reset()
    assert drive.output == STOP
    assert run(drive, 0.0, 0.1) == [STOP] * 10


def test_it_speeds_up_within_the_limit_and_then_holds_the_command():
    outputs = run(commanded(Twist2D(0.3, 0.6)), 0.0, 0.25)
    assert [it.linear for it in outputs[:10]] == pytest.approx([0.03 * i for i in range(1, 11)])
    assert [it.angular for it in outputs[:10]] == pytest.approx([0.06 * i for i in range(1, 11)])
    assert set(outputs[10:]) == {Twist2D(0.3, 0.6)}


def test_a_command_holds_for_a_quarter_second_and_then_brakes_within_the_limit():
    drive = commanded(Twist2D(0.6, 0.0))
    assert run(drive, 0.0, 0.25)[-1] == Twist2D(0.6, 0.0)
    braking = [it.linear for it in run(drive, 0.25, 0.3)]
    assert braking[:20] == pytest.approx([0.6 - 0.03 * i for i in range(1, 21)], abs=1e-9)
    assert braking[20:] == [0.0] * 10


def test_a_repeated_command_stays_in_force_and_one_after_a_timeout_counts_again():
    drive = Drive(CONFIG)
    for i in range(10):
        drive.command(Twist2D(0.5, 0.0), i * 0.2)
        last = run(drive, i * 0.2, 0.2)[-1]
    assert last == Twist2D(0.5, 0.0)
    assert run(drive, 2.0, 2.0)[-1] == STOP
    drive.command(Twist2D(-0.2, 1.0), 4.0)
    assert run(drive, 4.0, 0.2)[-1] == Twist2D(-0.2, 1.0)


@pytest.mark.parametrize(
    "nonsense", [Twist2D(nan, 0.0), Twist2D(0.0, nan), Twist2D(inf, 0.0), Twist2D(0.0, -inf)]
)
def test_a_command_that_is_no_number_is_refused_and_the_previous_stays_in_force_no_longer_than_it_would(
    nonsense,
):
    drive = commanded(Twist2D(0.3, 0.6))
    run(drive, 0.0, 0.2)
    with pytest.raises(CommandError, match=r"linear\.x = .*(nan|inf)|angular\.z = .*(nan|inf)"):
        drive.command(nonsense, 0.2)
    assert run(drive, 0.2, 0.05)[-1] == Twist2D(0.3, 0.6)
    assert run(drive, 0.25, 0.15)[-1] == STOP
