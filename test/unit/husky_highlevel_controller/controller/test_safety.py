"""When the robot is stopped: before it touches, after it has, once, and not for nothing."""

from dataclasses import replace
from math import atan2, cos, hypot, inf, sin

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scenes import UPRIGHT, UPSIDE_DOWN, box, look

from husky_evaluation.scenarios import SICK, scan_of
from husky_highlevel_controller.controller.safety import (
    Latch,
    ProximityConfig,
    advance_latch,
    is_moving,
    too_close,
)
from husky_highlevel_controller.datatypes import STOP, Pose, Pose2D, Twist2D
from husky_highlevel_controller.geometry import advance, compose, inverse, pose_from_2d, transform_point
from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.diff_drive import Drive
from husky_highlevel_controller.simulator.simulator_config import simulator_config

CONFIG, HUSKY = ProximityConfig(), load_robot()
HULL = (0.9874 / 2, 0.5709 / 2)  # [m], half lengths and widths, husky_description 0.6.10
WHEELS = (0.5120 / 2 + 0.1651, (0.5708 + 0.1143) / 2)
NOSE, SIDE = 0.4937, 0.34255  # [m], half the Husky's length and width


def wall_ahead(clearance):
    return [(NOSE + clearance, -5.0, NOSE + clearance, 5.0)]


def verdict(posts=(), walls=(), linear=0.0, angular=0.0, laser=UPSIDE_DOWN, config=CONFIG, lidar=SICK):
    scan = look(posts, walls, lidar, laser=laser)
    return too_close(scan, laser, Twist2D(linear, angular), config, HUSKY)


# ---------------------------------------------------------------------------- too close


@pytest.mark.parametrize(
    ("speed", "change", "needed"),
    [
        # margin, reaction, braking at 3 m/s^2
        *[(speed, {}, 0.1 + 0.2 * speed + speed**2 / 6.0) for speed in (0.05, 0.3, 0.6, 1.0)],
        (1.0, {"margin": 0.5}, 0.5 + 0.2 + 1.0 / 6.0),
        (1.0, {"reaction_time": 1.0}, 0.1 + 1.0 + 1.0 / 6.0),
        (1.0, {"braking": 0.5}, 0.1 + 0.2 + 1.0),
    ],
)
def test_the_faster_the_farther_by_margin_reaction_and_braking(speed, change, needed):
    config = replace(CONFIG, **change)
    assert verdict(walls=wall_ahead(needed - 0.01), linear=speed, config=config) is not None
    assert verdict(walls=wall_ahead(needed + 0.01), linear=speed, config=config) is None


@pytest.mark.parametrize(
    ("clearance", "linear", "angular", "told"),
    [
        (0.02, 0.0, 0.0, None),
        (0.02, 0.01, 0.01, None),  # odometry has noise
        (0.02, -0.5, 0.0, None),  # it backs off
        (0.05, 0.03, 0.0, 0.05),  # it creeps
    ],
)
def test_who_stands_or_backs_off_is_not_too_close_however_near_it_is(clearance, linear, angular, told):
    found = verdict(walls=wall_ahead(clearance), linear=linear, angular=angular)
    assert found == (told if told is None else pytest.approx(told, abs=0.005))


@pytest.mark.parametrize(
    ("linear", "angular", "moving"),
    [(0.019, 0.0, False), (0.021, 0.0, True), (0.0, 0.049, False), (0.0, 0.051, True)],
)
def test_slower_than_2_cm_a_second_and_3_degrees_a_second_is_the_noise_of_standing(linear, angular, moving):
    for side in (1.0, -1.0):
        assert is_moving(Twist2D(side * linear, side * angular)) is moving


def after_turn(turn):
    """A post that the hull's front corner would pass at half the margin after so much turning [rad]."""
    distance, bearing = hypot(*HULL) + 0.09, atan2(HULL[1], HULL[0]) + turn
    return distance * cos(bearing), distance * sin(bearing), 0.04


BESIDE = box(2.5, SIDE + 0.2, 0.0, 4.0, 0.1)
AT_CORNER = (hypot(NOSE, SIDE) * cos(0.9), hypot(NOSE, SIDE) * sin(0.9), 0.04)
AHEAD_LEFT = (0.75, 0.52, 0.05)
WAYS = {
    "passed at a distance": (BESIDE, 1.0, 0.0, False),
    "turned towards": (BESIDE, 1.0, 1.0, True),
    "turned away from": (BESIDE, 1.0, -1.0, False),
    "in the curve": (AHEAD_LEFT, 0.9, 0.9, True),
    "beside the straight way": (AHEAD_LEFT, 0.9, 0.0, False),
    "outside of the curve": (AHEAD_LEFT, 0.9, -0.9, False),
    "where a corner swings to": (AT_CORNER, 0.0, 1.0, True),
    "where a corner swings from": (AT_CORNER, 0.0, -1.0, False),
    # at 2 rad/s it turns 0.4 rad while it reacts and 0.33 rad while it brakes at 6 rad/s^2: 0.73 rad in all
    "where a turn can be braked no more": (after_turn(0.95), 0.0, 2.0, True),
    "where a turn can still be braked": (after_turn(1.10), 0.0, 2.0, False),
}


@pytest.mark.parametrize("laser", [UPSIDE_DOWN, UPRIGHT], ids=["upside down", "upright"])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["left", "right"])
@pytest.mark.parametrize(("body", "linear", "angular", "is_close"), WAYS.values(), ids=WAYS)
def test_what_is_in_the_way_of_a_curve(body, linear, angular, is_close, side, laser):
    if body is BESIDE:
        posts, walls = [], [(x1, side * y1, x2, side * y2) for x1, y1, x2, y2 in body]
    else:
        posts, walls = [(body[0], side * body[1], body[2])], []
    found = verdict(posts, walls, linear=linear, angular=side * angular, laser=laser)
    assert (found is not None) is is_close


def test_backwards_counts_what_a_lidar_that_looks_there_sees():
    behind = [(-NOSE - 0.15, -2.0, -NOSE - 0.15, 2.0)]
    all_round = replace(SICK, angle_max=3.14159)
    assert verdict(walls=behind, linear=-0.5, lidar=all_round) == pytest.approx(0.15, abs=0.005)
    assert verdict(walls=behind, linear=0.5, lidar=all_round) is None


def test_what_is_too_near_to_measure_is_near():
    at_the_nose = Pose((NOSE - 0.05, 0.0, 0.2))
    scan = scan_of(np.where(np.abs(np.linspace(-2.35619, 2.35619, 720)) < 0.1, 0.0, inf))
    assert too_close(scan, at_the_nose, Twist2D(0.3, 0.0), CONFIG, HUSKY) == pytest.approx(0.05, abs=0.01)


ITSELF = [inf] * 300 + [0.155 * 0.99] * 120 + [inf] * 300  # straight ahead of the lidar: within the outline


@pytest.mark.parametrize("ranges", [ITSELF, [], [inf] * 720, [np.nan] * 720])
def test_where_nothing_but_the_robot_itself_is_measured_nothing_is_near(ranges):
    assert too_close(scan_of(ranges), UPSIDE_DOWN, Twist2D(1.0, 0.5), CONFIG, HUSKY) is None


@pytest.mark.parametrize("miss", [inf, 0.0, np.nan, 30.0])
@pytest.mark.parametrize("range_min", [0.0, 0.1])
def test_a_miss_of_any_driver_is_no_obstacle_and_hides_none(miss, range_min):
    seen = look([], wall_ahead(0.2), laser=UPSIDE_DOWN)
    seen = replace(seen, range_min=range_min, ranges=np.where(np.isinf(seen.ranges), miss, seen.ranges))
    assert too_close(seen, UPSIDE_DOWN, Twist2D(1.0, 0.0), CONFIG, HUSKY) == pytest.approx(0.2, abs=0.01)
    nothing = replace(seen, ranges=np.full(720, miss))
    assert too_close(nothing, UPRIGHT, Twist2D(1.0, 1.0), CONFIG, HUSKY) is None


def test_a_robot_with_weaker_brakes_is_stopped_earlier():
    smb = load_robot("smb")  # 2.0 m/s^2
    upright = Pose((smb.lidar_mount.x, 0.0, smb.lidar_mount.z))
    way = 1.1 * CONFIG.reaction_time + 1.1**2 / (2.0 * 2.0) + CONFIG.margin
    for clearance, reason in ((way - 0.02, True), (way + 0.02, False)):
        x = smb.footprint.half_length + clearance
        scan = look([], [(x, -5.0, x, 5.0)], simulator_config("smb").lidar, laser=upright)
        assert (too_close(scan, upright, Twist2D(1.1, 0.0), CONFIG, smb) is not None) == reason


@pytest.mark.parametrize("speed", [inf, -inf, np.nan])
def test_a_velocity_that_is_no_number_is_a_reason_to_stop(speed):
    assert is_moving(Twist2D(speed, 0.0))
    assert is_moving(Twist2D(0.0, speed))
    assert verdict(linear=speed) is not None
    assert verdict(angular=speed) is not None


# ---------------------------------------------------------------------------- driving


def drive(twist, post, start=STOP, seconds=20.0):
    """Drive until told to stop, which takes effect 0.1 s after the scan; the poses and the verdicts.

    The robot does as its drive tells it, at once and exactly.
    """
    vehicle, pose, poses, verdicts = Drive(load_robot().drive), Pose2D(), [], []
    vehicle.output = start
    stop_at = inf
    for step in range(round(seconds / 0.02)):
        now = 0.02 * step
        scan = look([post], laser=compose(pose_from_2d(pose), UPSIDE_DOWN))
        clearance = too_close(scan, UPSIDE_DOWN, vehicle.output, CONFIG, HUSKY)
        if clearance is not None:
            verdicts.append(clearance)
            stop_at = min(stop_at, now + 0.1)
        vehicle.command(STOP if now >= stop_at else twist, now)
        pose = advance(pose, vehicle.update(now, 0.02), 0.02)
        poses.append(pose)
        if stop_at < now and not is_moving(vehicle.output):
            break
    return poses, verdicts


# backwards it would drive into what its lidar does not see
twists = st.builds(Twist2D, st.floats(0.0, 1.0), st.floats(-2.0, 2.0))
on_outline = st.tuples(
    st.sampled_from([HULL, WHEELS]), st.floats(-1.0, 1.0), st.booleans(), st.floats(0.0, 1.0)
)


def outline_gap(pose, x, y, radius):
    """Between the robot's hull or wheels and a post [m]."""
    x, y, _ = transform_point(inverse(pose_from_2d(pose)), (x, y, 0.0))
    return min(hypot(max(abs(x) - a, 0.0), max(abs(y) - b, 0.0)) for a, b in (HULL, WHEELS)) - radius


@settings(
    derandomize=True, deadline=None, max_examples=30, suppress_health_check=[HealthCheck.filter_too_much]
)
@given(twists, on_outline, st.floats(0.6, 1.2), st.floats(0.05, 0.2))
def test_whichever_way_it_drives_it_stops_before_it_touches_a_post_in_its_way(twist, corner, ahead, radius):
    """The post stands where a point of the outline's front will be in `ahead` s."""
    assume(is_moving(twist))
    (length, width), side, at_front, along = corner
    point = (length, side * width) if at_front else (along * length, width if side > 0.0 else -width)
    x, y, _ = transform_point(pose_from_2d(advance(Pose2D(), twist, ahead)), (*point, 0.0))
    # it starts clear of it, and what it sees at first it still sees when it gets there
    assume(outline_gap(Pose2D(), x, y, radius) > CONFIG.margin)
    assume(abs(atan2(y, x - 0.337)) < 1.8)
    assume(verdict([(x, y, radius)], **twist._asdict()) is None)
    poses, verdicts = drive(twist, (x, y, radius), start=twist, seconds=ahead + 0.4)
    assert verdicts
    assert min(outline_gap(pose, x, y, radius) for pose in poses) > 0.08


# ---------------------------------------------------------------------------- latch


def run(story):
    """Times at which a stop is called for, in a story of (seconds, danger, moving)."""
    calls, now, latch = [], 0.0, Latch()
    for seconds, danger, moving in story:
        for _ in range(round(seconds / 0.02)):
            latch, stop = advance_latch(latch, danger, moving, now)
            if stop:
                calls.append(round(now, 2))
            now += 0.02
    return calls


STOPPED = [(0.2, True, True), (5.0, False, False)]


@pytest.mark.parametrize(
    ("story", "calls"),
    [
        ([(1.0, False, True), (0.4, True, True), (60.0, True, False)], [1.0]),  # one danger is one call
        ([(5.0, False, True), (5.0, False, False)], []),
        # started again it is on guard again, at once if it is started into the danger
        ([*STOPPED, (1.0, False, True), (0.2, True, True)], [0.0, 6.2]),
        ([*STOPPED, (0.2, True, True)], [0.0, 5.2]),
        # also at once after it stood, and soon while it still brakes
        ([(0.2, True, True), (0.2, False, False), (0.2, True, True)], [0.0, 0.4]),
        ([(0.2, True, True), (2.0, False, True), (0.2, True, True)], [0.0, 2.2]),
        # a crash while it stands after the stop
        ([(0.02, True, True), (1.0, False, False), (0.02, True, False)], [0.0]),
    ],
)
def test_when_a_stop_is_called_for(story, calls):
    assert run(story) == calls


def test_a_robot_that_another_program_drives_on_is_stopped_once_a_second():
    calls = run([(3.5, True, True)])
    assert len(calls) == 4
    assert np.diff(calls) == pytest.approx(1.0, abs=0.03)


def test_when_time_starts_again_so_does_the_guard():
    assert advance_latch(Latch(tripped_at=100.0, stood=True), True, False, 0.5) == (Latch(0.5), True)
