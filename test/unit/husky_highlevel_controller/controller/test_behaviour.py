"""What the robot does about the pillar: whole drives in flat worlds, and single decisions."""

from dataclasses import replace
from itertools import groupby
from math import atan2, cos, hypot, inf, isnan, nan, pi, sin

import numpy as np
import pytest
from scenes import UPRIGHT, UPSIDE_DOWN, Toy, box, look

from husky_evaluation.scenarios import SICK, scan_of
from husky_highlevel_controller.controller.behaviour import ControllerState, Observation, State, decide
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.datatypes import STOP, Pose, Pose2D
from husky_highlevel_controller.geometry import (
    inverse,
    pose_from_2d,
    quat_from_rpy,
    transform_point,
    wrap_angle,
)
from husky_highlevel_controller.robot import load_robot

OUTLINE = load_robot().footprint
HALF_LENGTH, HALF_WIDTH = OUTLINE.half_length, OUTLINE.half_width
PILLAR = (20.0, 5.0, 0.2)
COURSE = {"p_gain_vel": 0.1, "p_gain_ang": 0.4}


def states(steps):
    return [state for state, _ in groupby(step.output.state for step in steps)]


def reasons(steps):
    return [reason for reason, _ in groupby(step.output.reason for step in steps)]


def bearing(step, x, y):
    return wrap_angle(atan2(y - step.pose.y, x - step.pose.x) - step.pose.yaw)


def lidar_to(pose, x, y):
    """From the lidar to the usual pillar's surface."""
    return hypot(x - pose.x - 0.337 * cos(pose.yaw), y - pose.y - 0.337 * sin(pose.yaw)) - 0.2


def arrival(steps):
    return next(step.time for step in steps if step.output.state is State.ARRIVED)


def first_output(scan, mount=UPSIDE_DOWN, **how):
    """What the first scan of all is answered by."""
    observation = Observation(scan, mount, Pose2D(), **how)
    return decide(ControllerState(), observation, True, ControlConfig(), PillarConfig())[1]


def with_scans(toy, change):
    """The toy, with other scans."""
    clean = toy.scan
    toy.scan = lambda: change(clean())
    return toy


# ---------------------------------------------------------------------------- driving and arriving


@pytest.mark.parametrize("gains", [{}, COURSE], ids=["defaults", "the course's gains"])
@pytest.mark.parametrize(
    ("x", "y", "yaw"), [(7.0, 2.0, 0.0), (3.0, -1.0, 0.0), (-1.0, 4.0, 0.0), (6.0, 6.0, 3.0)]
)
def test_every_drive_ends_at_the_stop_distance_without_a_swing_and_stays_there(x, y, yaw, gains):
    toy = Toy([(x, y, 0.2)], pose=Pose2D(yaw=yaw), seed=1, period=0.1 if gains else 0.05, **gains)
    steps = toy.drive(90.0 if gains else 15.0)
    assert steps[-1].output.state is State.ARRIVED
    assert steps[-1].output.twist == STOP
    assert abs(steps[-1].output.distance_error) < 0.02
    assert states(steps).count(State.ARRIVED) == 1
    assert lidar_to(toy.pose, x, y) == pytest.approx(0.4, abs=0.02)
    assert min(lidar_to(step.pose, x, y) for step in steps) >= 0.395
    assert not any(step.output.moved for step in steps), "it only drove"
    bearings = [bearing(step, x, y) for step in steps]
    signs = [one > 0.0 for one in bearings if abs(one) > 1e-3]
    assert sum(a != b for a, b in zip(signs, signs[1:])) <= 2
    assert abs(bearings[-1]) < 0.05


def test_the_bearing_does_not_swing_when_commands_come_a_tenth_of_a_second_late():
    toy = Toy([(5.0, 4.0, 0.2)])
    toy.queue = [STOP] * 5
    bearings = [bearing(step, 5.0, 4.0) for step in toy.drive(6.0)]
    assert min(bearings) > -0.02, "it hardly overshoots"
    assert abs(bearings[-1]) < 0.01


@pytest.mark.parametrize("mount", [UPSIDE_DOWN, UPRIGHT], ids=["upside down", "upright"])
@pytest.mark.parametrize("y", [5.0, -5.0])
def test_it_turns_to_the_pillar_whichever_way_up_the_lidar_is(y, mount):
    output = Toy([(10.0, y, 0.2)], laser_in_base=mount).step().output
    assert output.twist.angular * y > 0.0
    assert output.target_in_base == pytest.approx((10.0, y), abs=0.01)
    assert (output.pillar.y * y > 0.0) is (mount is UPRIGHT)
    assert output.distance_error == pytest.approx(hypot(10.0 - mount.position[0], y) - 0.6, abs=0.01)
    assert output.bearing_error == pytest.approx(atan2(y, 10.0), abs=0.01)


def test_a_tilted_lidar_s_pillar_is_where_its_beams_end():
    output = first_output(look([(5.0, 1.0, 0.2)]), Pose((0.3, 0.0, 0.3), quat_from_rpy(0.0, 0.2, 0.0)))
    assert output.target_in_base == pytest.approx((0.3 + 5.0 * cos(0.2), 1.0), abs=0.01)


def test_arrival_is_measured_to_the_surface_and_not_along_an_axis():
    # the lidar is 5 m from a pillar abeam, whose x is 0, so the robot has not arrived
    toy = Toy([(0.337, 5.0, 0.2)])
    step = toy.step()
    assert step.output.state is State.DRIVING
    assert step.output.twist.angular > 0.0
    # the centre is 0.55 m ahead, the surface 0.35 m
    assert Toy([(0.337 + 0.55, 0.0, 0.2)]).step().output.state is State.ARRIVED
    assert Toy([(0.337 + 0.75, 0.0, 0.2)]).step().output.state is State.DRIVING


def test_it_stays_arrived_while_it_is_told_to_stand_still_at_the_pillar():
    toy = Toy([(3.0, 0.0, 0.2)])
    assert not any(step.output.at_pillar for step in toy.drive(1.0))
    assert toy.drive(5.0)[-1].output.at_pillar
    for toy.enabled in (False, True):
        assert all(step.output.at_pillar for step in toy.drive(1.0))
    toy.enabled = False
    toy.circles = [(3.5, 0.0, 0.2)]
    assert not toy.drive(2.0)[-1].output.at_pillar, "the pillar is gone from there"
    toy.circles = [(3.0, 0.0, 0.2)]
    assert not toy.drive(2.0)[-1].output.at_pillar, "it has not driven there"


@pytest.mark.parametrize(("gap", "state"), [(0.0025, State.ARRIVED), (0.004, State.DRIVING)])
def test_a_gap_of_3_mm_to_what_is_touched_is_noise(gap, state):
    """Held there, it presses for a fifth of a second and has arrived."""
    toy, steps = Toy([(2.0, 0.0, 0.2)], stop_distance=0.0), []
    place = Pose2D(2.0 - 0.2 - HALF_LENGTH - gap)
    for _ in range(20):
        toy.pose, toy.twist = place, STOP
        steps.append(toy.step())
    assert steps[-1].output.state is state
    if state is State.ARRIVED:
        assert "touching" in steps[-1].output.reason
        assert steps[-1].output.twist == STOP
        assert arrival(steps) == pytest.approx(0.22, abs=0.03)
        assert {step.output.twist.linear for step in steps if step.time < 0.19} == {0.04}


# ---------------------------------------------------------------------------- remembering


def test_a_pillar_that_leaves_the_view_is_remembered_and_found_again():
    toy = Toy([(4.0, 1.0, 0.2)])
    toy.drive(0.2)
    toy.pose = Pose2D(toy.pose.x, toy.pose.y, pi)  # odometry knows of the turn
    steps = toy.drive(15.0)
    assert steps[0].output.state is State.DRIVING
    assert steps[0].output.pillar is None
    assert "out of view" in steps[0].output.reason
    assert steps[0].output.estimate.x == pytest.approx(4.0, abs=0.01)
    assert steps[-1].output.state is State.ARRIVED


def test_a_pillar_that_is_hidden_for_a_while_is_driven_to_all_the_same():
    toy = Toy([(14.0, 1.0, 0.2)], period=0.05)
    toy.drive(1.0)
    toy.segments = [(8.0, -3.0, 8.0, 3.0)]
    hidden = toy.drive(3.0)
    assert {step.output.state for step in hidden} == {State.DRIVING}
    assert "hidden" in hidden[-1].output.reason
    assert hidden[-1].output.bearing_error == pytest.approx(bearing(hidden[-1], 14.0, 1.0), abs=0.02)
    assert hidden[-1].output.twist.linear > 0.5
    toy.segments = []
    assert toy.drive(15.0)[-1].output.state is State.ARRIVED


def test_it_does_not_follow_legs_that_walk_and_drives_to_what_stands():
    toy, driven = Toy([(5.0, -1.5, 0.2)]), []
    for _ in range(30):  # 0.6 m/s for 6 s
        driven += toy.drive(0.2)
        x, y, radius = toy.circles[0]
        toy.circles = [(x, y + 0.12, radius)]
    assert driven[-1].output.state is State.WAITING
    assert "moves away" in driven[-1].output.reason
    assert hypot(toy.pose.x, toy.pose.y) < 1.0
    assert toy.drive(12.0)[-1].output.state is State.ARRIVED


def test_another_world_and_the_first_again_from_the_start_forgets_places_that_looked_empty():
    toy = Toy([PILLAR])
    toy.drive(14.0)
    pillars, toy.circles = toy.circles, []  # as in a world without a pillar
    assert states(toy.drive(1.0))[-1] is State.SEARCHING
    toy.circles, toy.pose = pillars, Pose2D()  # too far off for as many beams as it had when it was given up
    assert states(toy.drive(1.0)) == [State.DRIVING]


def test_at_the_stop_point_without_seeing_the_pillar_it_turns_to_where_it_was():
    toy = Toy([(1.187, 0.0, 0.2)], pose=Pose2D(yaw=0.1))
    toy.step()
    toy.circles, toy.pose = [], Pose2D(0.26, 0.0, 0.1)
    output = toy.step().output
    assert (output.state, output.reason) == (State.DRIVING, "turning to the last position of the pillar")
    assert output.twist.linear == 0.0
    assert output.twist.angular == pytest.approx(-0.2, abs=0.01)


def test_an_arrived_robot_stays_when_somebody_stands_before_the_pillar():
    toy = Toy([(2.0, 0.0, 0.2)], period=0.05)
    toy.drive(5.0)
    toy.segments = [(toy.pose.x + 0.6, -0.5, toy.pose.x + 0.6, 0.5)]
    steps = toy.drive(10.0)
    assert {(step.output.state, step.output.twist) for step in steps} == {(State.ARRIVED, STOP)}


def test_time_that_jumps_back_makes_it_forget_the_old_odom():
    toy = Toy([(6.0, 1.0, 0.2)])
    toy.drive(1.0)
    toy.circles, toy.time = [(6.0, -1.0, 0.2)], 0.0
    output = toy.step().output
    assert (output.estimate.x, output.estimate.y) == pytest.approx((6.0, -1.0), abs=0.02)
    assert toy.controller_state.started_at == 0.0


# ---------------------------------------------------------------------------- searching


def test_a_pillar_never_seen_is_searched_with_a_turn_and_ever_farther_out_and_nothing_is_touched():
    centre = Pose2D(0.5, 0.2, 0.3)
    toy = Toy([], box(*centre, 5.0, 5.0) + box(1.8, 1.2, 0.5, 0.4, 0.4), period=0.1)
    steps = toy.drive(120.0)
    assert states(steps) == [State.SEARCHING]
    turning, driving = reasons(steps)[:2]
    assert "turning to look around" in turning
    assert "driving a widening search" in driving
    out = [hypot(step.pose.x, step.pose.y) for step in steps]
    assert max(out[: len(out) // 4]) < max(out) - 0.2
    corners = [(a * HALF_LENGTH, b * HALF_WIDTH, 0.0) for a in (-1, 1) for b in (-1, 0, 1)]
    to_room = inverse(pose_from_2d(centre))
    for step in steps:
        for corner in corners:
            place = transform_point(pose_from_2d(step.pose), corner)
            assert max(map(abs, transform_point(to_room, place))) < 2.5
            assert hypot(place[0] - 1.8, place[1] - 1.2) > 0.2


def test_with_search_off_it_stands_still_until_it_sees_a_pillar():
    toy = Toy([], search=False)
    steps = toy.drive(2.0)
    assert {(step.output.state, step.output.twist) for step in steps} == {(State.WAITING, STOP)}
    assert "it has no valid range" in steps[0].output.reason
    assert "set ~search to true" in steps[0].output.reason
    toy.circles = [(6.0, 0.0, 0.2)]
    assert toy.drive(2.0)[-1].output.twist.linear == 1.0
    pillars, toy.circles = toy.circles, []
    assert toy.step().output.twist == STOP
    toy.circles = pillars
    assert toy.drive(7.0)[-1].output.state is State.ARRIVED


@pytest.mark.parametrize(("shift", "mount"), [(0.0, UPRIGHT), (0.25, UPSIDE_DOWN), (-0.25, UPRIGHT)])
def test_it_drives_round_what_stands_in_the_way(shift, mount):
    toy = Toy([(9.0, 0.0, 0.2)], box(4.0, shift, 0.0, 0.5, 0.5), laser_in_base=mount, seed=5, period=0.05)
    steps = toy.drive(40.0)
    assert any("obstacle" in reason for reason in reasons(steps))
    assert steps[-1].output.state is State.ARRIVED
    for step in steps:
        x, y, _ = transform_point(inverse(pose_from_2d(step.pose)), (4.0, shift, 0.0))
        assert abs(x) > HALF_LENGTH + 0.2 or abs(y) > HALF_WIDTH + 0.2


def test_a_pillar_close_to_a_wall_is_reached_straight():
    toy = Toy([(6.0, 0.0, 0.2)], ((6.3, -5.0, 6.3, 5.0), (3.0, 1.2, 9.0, 1.2)), seed=5, period=0.05)
    assert reasons(toy.drive(12.0)) == ["driving to the pillar", "arrived: at the stop distance"]


# ---------------------------------------------------------------------------- what it does not know


def test_told_to_stand_still_it_does_so_at_once_and_goes_on_when_told():
    toy = Toy([(6.0, 0.0, 0.2)])
    toy.drive(2.0)
    toy.enabled = False
    stopped = toy.drive(2.0)
    assert {(step.output.state, step.output.twist) for step in stopped} == {(State.STOPPED, STOP)}
    assert stopped[-1].output.pillar is not None
    assert toy.controller_state.started_at is None
    toy.enabled, started = True, toy.time
    assert toy.drive(8.0)[-1].output.state is State.ARRIVED
    assert toy.controller_state.started_at == started


def test_without_the_lidar_s_place_it_waits():
    toy = Toy([(6.0, 0.0, 0.2)], laser_in_base=None)
    output = toy.step().output
    assert (output.state, output.twist) == (State.WAITING, STOP)
    assert "no transform from 'front_laser' to 'base_link'" in output.reason
    assert output.pillar is not None
    assert isnan(output.distance_error)


@pytest.mark.parametrize(("ahead", "drives"), [(0.5, True), (0.6, False), (3600.0, False)])
def test_scans_more_than_half_a_second_ahead_of_odometry_make_it_stand(ahead, drives):
    output = first_output(look([(6.0, 0.0, 0.2)]), ahead_of_odometry=ahead)
    assert (output.twist != STOP, output.state is State.DRIVING) == (drives, drives)
    assert drives or "ahead of odometry" in output.reason


def test_without_odometry_it_drives_to_what_it_sees_and_waits_where_it_sees_none():
    toy = Toy([(6.0, 0.0, 0.2)])
    toy.knows_odom = False
    assert toy.drive(9.0)[-1].output.state is State.ARRIVED
    toy.circles = []
    output = toy.step().output
    assert (output.state, output.twist) == (State.WAITING, STOP)
    assert "no transform to odom" in output.reason


def test_where_odometry_is_lost_on_the_way_it_stands_until_it_is_back():
    toy = Toy([(6.0, 0.0, 0.2)])
    assert toy.drive(2.0)[-1].output.twist.linear > 0.5
    toy.knows_odom = False
    first, *later = toy.drive(3.0)
    assert first.output.state is State.DRIVING, "one scan without odometry does not count as lost odometry"
    stopped = [step for step in later if step.time > first.time + 0.6]
    assert {(step.output.state, step.output.twist) for step in stopped} == {(State.WAITING, STOP)}
    assert "no transform from odom to base_link any more" in stopped[-1].output.reason
    toy.knows_odom = True
    assert toy.drive(9.0)[-1].output.state is State.ARRIVED


@pytest.mark.parametrize("miss", [inf, nan, 0.0])
def test_a_lidar_that_goes_blind_in_a_room_turns_once_and_then_stands_until_it_sees_again(miss):
    is_blind = [False]

    def seen(scan):
        return replace(scan, ranges=np.full(len(scan.ranges), miss)) if is_blind[0] else scan

    walls = box(4.0, 0.0, 0.0, 14.0, 8.0)
    toy = with_scans(Toy([(8.0, 0.5, 0.2)], walls, period=0.1), seen)
    assert toy.drive(2.0)[-1].output.state is State.DRIVING
    is_blind[0] = True
    steps = toy.drive(40.0)
    x, y, _ = steps[10].pose
    assert all(hypot(step.pose.x - x, step.pose.y - y) < 0.05 for step in steps[10:]), "it drives nowhere"
    assert sum(step.output.state is State.SEARCHING for step in steps) < 150, "one turn"
    assert (steps[-1].output.state, steps[-1].output.twist) == (State.WAITING, STOP)
    assert "no beam returns anything, although many did before" in steps[-1].output.reason
    is_blind[0] = False
    assert toy.drive(40.0)[-1].output.state is State.ARRIVED


@pytest.mark.parametrize("count", [0, 1, 720])
@pytest.mark.parametrize("nothing", [inf, -inf, nan, 0.0])
def test_a_scan_of_nothing_never_drives_it_anywhere(nothing, count):
    # the smallest of no ranges at index 0 would be a pillar at -135 degrees
    output = first_output(replace(scan_of(np.full(count, 5.0)), ranges=np.full(count, nothing)))
    assert output.pillar is None
    assert output.twist.linear == 0.0
    # beams that meet nothing are a reason to look around; a covered lidar is not
    blind = count == 0 or nothing == -inf
    assert output.state is (State.WAITING if blind else State.SEARCHING)
    assert (output.twist == STOP) is blind


# ---------------------------------------------------------------------------- every driver's kind of miss

MISSES = {"rep_117": inf, "lms1xx": 0.0, "nan": nan, "range_max": SICK.range_max}


@pytest.mark.parametrize("range_min", [0.0, SICK.range_min])
@pytest.mark.parametrize("miss", MISSES.values(), ids=MISSES)
def test_whatever_the_driver_calls_a_miss_it_gives_up_an_empty_place_searches_and_arrives(miss, range_min):
    """A miss of 0 m is not an obstacle, either."""

    def missing(scan):
        return replace(scan, range_min=range_min, ranges=np.where(scan.ranges == inf, miss, scan.ranges))

    toy = with_scans(Toy([(8.0, 0.5, 0.2)], period=0.1), missing)
    steps = toy.drive(3.0)
    toy.circles = [(-4.0, 1.0, 0.2)]
    steps += toy.drive(30.0)
    assert states(steps) == [State.DRIVING, State.SEARCHING, State.DRIVING, State.ARRIVED]
    assert lidar_to(toy.pose, -4.0, 1.0) == pytest.approx(0.41, abs=0.02)


# ---------------------------------------------------------------------------- limits, and what a drive is


@pytest.mark.parametrize(
    ("pillars", "walls", "reason"),
    [
        ([], (), "turning to look around"),
        ([(6.0, 6.0, 0.2)], (), "driving to the pillar"),
        # walls on all sides, nearer than it could pass
        ([(3.0, 0.0, 0.2)], box(0.0, 0.0, 0.0, 2.4, 2.4), "turning to find a free way"),
    ],
)
def test_max_angular_limits_every_command(pillars, walls, reason):
    toy = Toy(pillars, max_angular=0.1, search_rate=2.0)
    toy.drive(0.2)
    toy.segments = list(walls)
    steps = toy.drive(2.0)
    assert any(reason in step.output.reason for step in steps)
    assert max(abs(step.output.twist.angular) for step in steps) == pytest.approx(0.1)


def test_the_time_of_a_drive_begins_where_the_robot_leaves_the_pillar_or_is_put_elsewhere():
    toy = Toy([(3.0, 0.0, 0.2)], period=0.05)
    toy.drive(8.0)
    assert toy.controller_state.state is State.ARRIVED
    assert toy.controller_state.started_at == 0.0
    toy.pose = Pose2D(-1.0, 0.5, 0.0)  # as a 2D Pose Estimate or ~reset puts it
    at = toy.time
    steps = toy.drive(10.0)
    assert [step.time for step in steps if step.output.moved] == [at]
    assert toy.controller_state.state is State.ARRIVED
    assert toy.controller_state.started_at == pytest.approx(at)
    toy.circles, leaving = [(5.0, 0.0, 0.2)], toy.time
    toy.drive(10.0)
    assert toy.controller_state.state is State.ARRIVED
    assert leaving <= toy.controller_state.started_at < leaving + 1.5


@pytest.mark.parametrize(
    ("seconds", "metres", "moved"),
    [(0.02, 0.25, False), (0.02, 0.45, True), (0.5, 1.2, False), (0.5, 1.4, True)],
)
def test_a_robot_farther_off_than_30_cm_and_2_m_a_second_was_put_there(seconds, metres, moved):
    toy = Toy([(6.0, 0.0, 0.2)])
    toy.step()
    toy.pose, toy.time = Pose2D(toy.pose.x + metres), seconds
    assert toy.step().output.moved is moved


def test_a_robot_whose_simulator_was_started_again_was_put_there():
    toy = Toy([(6.0, 0.0, 0.2)])
    toy.drive(3.0)
    toy.pose, toy.time = Pose2D(), 0.0
    first, *others = toy.drive(1.0)
    assert first.output.moved
    assert not any(step.output.moved for step in others)


@pytest.mark.parametrize(("shift", "state"), [(0.08, State.ARRIVED), (0.13, State.DRIVING)])
def test_an_arrived_robot_drives_again_when_the_pillar_is_10_cm_farther_off(shift, state):
    toy = Toy([(1.2, 0.0, 0.2)], period=0.05)
    assert toy.drive(3.0)[-1].output.state is State.ARRIVED
    toy.circles = [(1.2 + shift, 0.0, 0.2)]
    assert toy.step().output.state is state


def test_it_drives_on_to_the_one_it_has_chosen_when_another_is_nearer():
    toy = Toy([(20.0, 1.5, 0.2)], seed=3, period=0.05)
    toy.drive(1.0)
    toy.circles.append((8.0, 6.0, 0.2))
    assert all(hypot(*step.output.target_in_base) > 15.0 for step in toy.drive(1.0))
