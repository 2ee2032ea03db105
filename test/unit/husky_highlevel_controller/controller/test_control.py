"""The laws of the drive: gains, limits, how far there is to go."""

from dataclasses import replace
from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import UPSIDE_DOWN

from husky_highlevel_controller.controller.control import (
    ControlConfig,
    Target,
    limited,
    remaining_distance,
    steer,
    target_at,
    to_be_touched,
)
from husky_highlevel_controller.robot import load_robot

OUTLINE = load_robot().footprint
HALF_LENGTH, HALF_WIDTH = OUTLINE.half_length, OUTLINE.half_width
CONFIG = ControlConfig()
COURSE = ControlConfig(p_gain_vel=0.1, p_gain_ang=0.4)
TOUCHING = ControlConfig(stop_distance=0.0)
LASER_X = UPSIDE_DOWN.position[0]


def at(x: float, y: float) -> Target:
    """The usual pillar with its centre there, in base_link."""
    return target_at((x, y), 0.2, UPSIDE_DOWN, OUTLINE)


def ahead(distance: float) -> Target:
    """The usual pillar, its surface so far ahead of the lidar."""
    return at(LASER_X + 0.2 + distance, 0.0)


coordinate = st.floats(-30.0, 30.0)


@given(x=coordinate, y=coordinate, gain_vel=st.floats(0.0, 10.0), gain_ang=st.floats(0.0, 10.0))
@settings(max_examples=100)
def test_the_twist_keeps_the_limits_and_never_backs_up(x, y, gain_vel, gain_ang):
    for stop_distance in (0.0, 0.4):
        gains = ControlConfig(p_gain_vel=gain_vel, p_gain_ang=gain_ang, stop_distance=stop_distance)
        config = replace(gains, max_linear=0.7, max_angular=0.9)
        twist = limited(steer(at(x, y), config), config)
        assert 0.0 <= twist.linear <= 0.7
        assert abs(twist.angular) <= 0.9


@pytest.mark.parametrize(
    ("distance", "config", "speed"),
    [
        (2.4, COURSE, 0.2),  # proportional to the distance still to go
        (4.4, COURSE, 0.4),
        (25.0, CONFIG, 1.0),  # the robot's limit
        (25.0, ControlConfig(p_gain_vel=10.0), 1.0),
        (1.0, ControlConfig(p_gain_vel=0.0, stop_distance=0.0), 0.0),
    ],
)
def test_the_speed_is_proportional_to_the_distance_still_to_go_within_the_limit(distance, config, speed):
    assert steer(ahead(distance), config).linear == pytest.approx(speed, abs=1e-12)


def test_the_turning_rate_is_proportional_to_the_bearing_and_a_pillar_abeam_or_behind_is_turned_to_first():
    assert steer(at(5.0, 5.0), COURSE).angular == pytest.approx(0.4 * pi / 4.0)
    for x in (-5.0, 0.0):
        twist = limited(steer(at(x, 5.0), CONFIG), CONFIG)
        assert twist == (pytest.approx(0.0, abs=1e-12), CONFIG.max_angular)


def test_the_way_to_go_ends_at_the_stop_distance_or_where_the_hull_meets_the_pillar_when_that_is_sooner():
    nose = HALF_LENGTH - LASER_X
    assert nose == pytest.approx(0.1567, abs=1e-4)
    beside = at(0.0, HALF_WIDTH + 0.2 + 0.3)
    for target, config, way in (
        (ahead(2.0), CONFIG, 1.6),
        (ahead(2.0), TOUCHING, 2.0 - nose),
        (beside, TOUCHING, 0.3),
    ):
        assert remaining_distance(target, config) == pytest.approx(way)
        assert to_be_touched(target, config) is (config is TOUCHING)


def test_the_last_quarter_metre_to_a_touch_is_slow_but_never_stands():
    speeds = [steer(ahead(0.1567 + 0.01 * step), TOUCHING).linear for step in range(1, 25)]
    assert max(speeds) == pytest.approx(0.1)
    assert steer(ahead(0.1567 + 0.26), TOUCHING).linear > 0.4
    for config in (TOUCHING, ControlConfig(p_gain_vel=0.1, stop_distance=0.0)):
        assert steer(ahead(0.1567), config).linear == pytest.approx(0.04)
