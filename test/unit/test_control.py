"""The drive to the pillar: laws, limits, phases, and whole drives of a kinematic robot."""

from __future__ import annotations

from dataclasses import asdict, fields
from math import cos, hypot, inf, nan, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.control import (
    ControlConfig,
    Phase,
    Target,
    advance,
    steer,
    target_from_pillar,
)
from husky_highlevel_controller.datatypes import STOP, HuskyError, Pillar, Pose, Pose2D, Twist2D
from husky_highlevel_controller.geometry import advance as move
from husky_highlevel_controller.geometry import quat_from_rpy

CONFIG = ControlConfig()
COURSE = ControlConfig(p_gain_vel=0.1, p_gain_ang=0.4)
LASER_X = 0.337  # [m], of the lidar in base_link (Husky URDF, husky_description 0.6.10)
UPSIDE_DOWN = Pose((LASER_X, 0.0, 0.30795), quat_from_rpy(pi, 0.0, 0.0))


def ahead(distance: float) -> Target:
    return Target(LASER_X + 0.2 + distance, 0.0, distance)


def see(pose: Pose2D, pillar_x: float, pillar_y: float) -> Target:
    dx, dy = pillar_x - pose.x, pillar_y - pose.y
    x, y = cos(pose.yaw) * dx + sin(pose.yaw) * dy, cos(pose.yaw) * dy - sin(pose.yaw) * dx
    return Target(x, y, hypot(x - LASER_X, y) - 0.2)


def drive(pillar_x: float, pillar_y: float, config: ControlConfig, seconds: float):
    """A unicycle with the Husky's limits, 50 scans a second, commands obeyed 0.04 s after their scan."""
    pose, twist, phase, period = Pose2D(), STOP, Phase.WAITING, 0.02
    queue, history = [STOP, STOP], []
    for _ in range(round(seconds / period)):
        target = see(pose, pillar_x, pillar_y)
        history.append((phase, target, twist))
        phase, wanted = advance(phase, target, config)
        queue.append(wanted)
        wanted = queue.pop(0)
        dv, dw = 3.0 * period, 6.0 * period
        linear = min(max(wanted.linear, twist.linear - dv), twist.linear + dv)
        twist = Twist2D(linear, min(max(wanted.angular, twist.angular - dw), twist.angular + dw))
        pose = move(pose, twist, period)
    return history


def arrival_time(history) -> float:
    return next(i for i, (phase, _, _) in enumerate(history) if phase is Phase.ARRIVED) * 0.02


# ---------------------------------------------------------------------------- whole drives


@pytest.mark.parametrize(("x", "y"), [(20.0, 5.0), (20.0, 0.0), (12.0, -12.0), (16.0, -8.0)])
def test_default_gains_come_close_to_what_the_robot_can_do(x, y):
    history = drive(x, y, CONFIG, 40.0)
    to_go = history[0][1].distance - CONFIG.stop_distance
    # the two ramps between standing and 1.0 m/s, at 3.0 m/s^2, cost a third of a second
    assert arrival_time(history) <= 1.1 * (to_go / 1.0 + 1.0 / 3.0)


@pytest.mark.parametrize("config", [CONFIG, COURSE])
@pytest.mark.parametrize(("x", "y"), [(20.0, 5.0), (3.0, -1.0), (-1.0, 4.0)])
def test_every_drive_ends_at_the_stop_distance_and_stays_there(config, x, y):
    history = drive(x, y, config, 40.0 if config is CONFIG else 130.0)
    phase, target, twist = history[-1]
    assert phase is Phase.ARRIVED
    assert twist == STOP
    assert target.distance == pytest.approx(config.stop_distance, abs=0.015)
    assert min(target.distance for _, target, _ in history) >= config.stop_distance - 0.002


@pytest.mark.parametrize("config", [CONFIG, COURSE])
@pytest.mark.parametrize(("x", "y"), [(20.0, 5.0), (20.0, -5.0), (6.0, 6.0), (-1.0, 4.0)])
def test_the_bearing_does_not_swing(config, x, y):
    bearings = [target.bearing for _, target, _ in drive(x, y, config, 60.0)]
    signs = [b > 0.0 for b in bearings if abs(b) > 1e-4]
    assert sum(a != b for a, b in zip(signs, signs[1:])) <= 2
    assert abs(bearings[-1]) < 0.05


# ---------------------------------------------------------------------------- the laws


@given(
    x=st.floats(-30.0, 30.0),
    y=st.floats(-30.0, 30.0),
    distance=st.floats(0.0, 30.0),
    gain_vel=st.floats(0.0, 10.0),
    gain_ang=st.floats(0.0, 10.0),
)
@settings(derandomize=True)
def test_the_twist_keeps_the_limits_and_never_backs_up(x, y, distance, gain_vel, gain_ang):
    config = ControlConfig(p_gain_vel=gain_vel, p_gain_ang=gain_ang)
    twist = steer(Target(x, y, distance), config)
    assert 0.0 <= twist.linear <= config.max_linear
    assert abs(twist.angular) <= config.max_angular


@given(x=st.floats(-30.0, 30.0), y=st.floats(0.01, 30.0), distance=st.floats(0.5, 30.0))
@settings(derandomize=True)
def test_a_mirrored_pillar_is_driven_to_in_mirror_image(x, y, distance):
    left, right = steer(Target(x, y, distance), CONFIG), steer(Target(x, -y, distance), CONFIG)
    assert left.linear == right.linear
    assert left.angular == -right.angular
    assert left.angular > 0.0


def test_the_speed_is_proportional_to_the_distance_still_to_go():
    assert steer(ahead(2.4), COURSE).linear == pytest.approx(0.2)
    assert steer(ahead(4.4), COURSE).linear == pytest.approx(0.4)


def test_the_turning_rate_is_proportional_to_the_bearing_in_base_link():
    assert steer(Target(5.0, 5.0, 6.0), COURSE).angular == pytest.approx(0.4 * pi / 4.0)


def test_a_pillar_to_the_side_or_behind_is_turned_to_before_driving():
    for x in (-5.0, 0.0):
        twist = steer(Target(x, 5.0, 5.0), CONFIG)
        assert twist.linear == pytest.approx(0.0, abs=1e-12)
        assert twist.angular == CONFIG.max_angular


# ---------------------------------------------------------------------------- phases


def test_without_a_pillar_it_waits_standing_still():
    for phase in Phase:
        assert advance(phase, None, CONFIG) == (Phase.WAITING, STOP)


@pytest.mark.parametrize("bad", [nan, inf])
def test_a_target_that_is_not_a_number_never_becomes_a_command(bad):
    for target in (Target(bad, 0.0, 1.0), Target(1.0, bad, 1.0), Target(1.0, 0.0, bad)):
        assert advance(Phase.DRIVING, target, CONFIG) == (Phase.WAITING, STOP)


def test_a_pillar_abeam_is_not_reached():
    phase, twist = advance(Phase.DRIVING, Target(0.0, 5.0, 4.8), CONFIG)
    assert phase is Phase.DRIVING
    assert twist.angular > 0.0


def test_arrival_is_measured_to_the_surface():
    # the centre is 0.55 m away, the surface of a pillar of 0.2 m radius only 0.35 m
    assert advance(Phase.DRIVING, ahead(0.35), CONFIG) == (Phase.ARRIVED, STOP)
    assert advance(Phase.DRIVING, ahead(0.55), CONFIG)[0] is Phase.DRIVING


def test_arrived_within_the_tolerance_from_either_side():
    for distance in (0.0, 0.2, CONFIG.stop_distance, CONFIG.stop_distance + CONFIG.arrival_tolerance - 1e-9):
        for phase in Phase:
            assert advance(phase, ahead(distance), CONFIG) == (Phase.ARRIVED, STOP)
    assert advance(Phase.WAITING, ahead(0.4 + 0.02), CONFIG)[0] is Phase.DRIVING


def test_once_arrived_only_a_pillar_that_moved_well_away_is_followed():
    assert advance(Phase.ARRIVED, ahead(0.499), CONFIG) == (Phase.ARRIVED, STOP)
    phase, twist = advance(Phase.ARRIVED, ahead(0.501), CONFIG)
    assert phase is Phase.DRIVING
    assert twist.linear > 0.0


# ---------------------------------------------------------------------------- from the scan to the target


def test_the_upside_down_lidar_sees_a_pillar_at_the_left_on_its_right():
    pillar = Pillar(x=19.663, y=-5.0, radius=0.2, beams=3, residual=0.0)
    target = target_from_pillar(pillar, UPSIDE_DOWN)
    assert (target.x, target.y) == (pytest.approx(20.0), pytest.approx(5.0))
    assert target.distance == pytest.approx(20.0888, abs=1e-3)
    assert steer(target, CONFIG).angular > 0.0


def test_the_same_pillar_through_an_upright_lidar_is_at_the_same_place():
    upright = Pose(UPSIDE_DOWN.position)
    below = target_from_pillar(Pillar(4.0, -1.0, 0.2, 10, 0.0), UPSIDE_DOWN)
    above = target_from_pillar(Pillar(4.0, 1.0, 0.2, 10, 0.0), upright)
    assert (below.x, below.y, below.distance) == pytest.approx((above.x, above.y, above.distance))


@pytest.mark.parametrize("gain", ["p_gain_vel", "p_gain_ang"])
@pytest.mark.parametrize("bad", [-0.1, nan, inf])
def test_a_gain_that_cannot_work_is_refused_by_name(gain, bad):
    values = {**asdict(CONFIG), gain: bad}
    with pytest.raises(HuskyError, match=f"~{gain} = {bad}"):
        read_config(values, "~", ControlConfig)


def test_every_setting_declares_a_range_that_holds_its_default():
    for setting in fields(ControlConfig):
        assert 0.0 <= setting.metadata["min"] <= setting.default <= setting.metadata["max"], setting.name
        assert setting.metadata["help"]
