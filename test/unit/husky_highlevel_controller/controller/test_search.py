"""The search's legs and turns, what counts as near, and which way is free."""

from dataclasses import replace
from math import atan2, cos, hypot, pi, radians, sin

import numpy as np
import pytest

from husky_evaluation.scenarios import SICK, scan_of
from husky_highlevel_controller.controller.control import ControlConfig, target_at
from husky_highlevel_controller.controller.search import Search, free_bearing, is_free, near_points, search_on
from husky_highlevel_controller.datatypes import STOP, Pose, Pose2D, Twist2D
from husky_highlevel_controller.robot import load_robot

OUTLINE = load_robot().footprint
HALF_LENGTH, HALF_WIDTH = OUTLINE.half_length, OUTLINE.half_width
CONFIG = ControlConfig()
NOTHING = np.empty((0, 2))
LOOK_AHEAD = 1.0  # [m], free way wanted ahead of the hull
INCREMENT = 2.0 * SICK.angle_max / (SICK.beams - 1)  # [rad]


def point(x, y=0.0):
    return np.array([[x, y]])


def legs(config=CONFIG, count=5, rate=0.5):
    """(turn before it [rad], length [m]) of the first legs in free space, by 0.1 rad and 0.05 m at a time."""
    search, pose, found = Search(), Pose2D(), []
    turned = before = driven = 0.0
    for _ in range(1000):
        search, twist = search_on(search, pose, NOTHING, OUTLINE, config)
        assert twist in (STOP, Twist2D(0.0, rate), Twist2D(0.5, 0.0))
        if twist.angular > 0.0:
            if driven > 0.0:
                found.append((before, driven))
                if len(found) == count:
                    break
                driven, turned = 0.0, 0.0
            pose = pose._replace(yaw=pose.yaw + 0.1)
            turned += 0.1
        elif twist.linear > 0.0:
            before = turned
            pose = pose._replace(x=pose.x + 0.05)
            driven += 0.05
    return found


def test_it_looks_all_round_and_then_drives_a_square_that_widens_every_second_leg_by_its_parameter():
    turns, lengths = zip(*legs())
    assert lengths == pytest.approx((1.5, 1.5, 3.0, 3.0, 4.5), abs=0.06)
    assert turns[0] == pytest.approx(2.0 * pi, abs=0.11)
    # all round, and a quarter on to the next side
    assert turns[1:] == pytest.approx([2.5 * pi] * 4, abs=0.11)
    config = replace(CONFIG, search_radius_step=0.5, search_rate=0.3)
    lengths = [length for _, length in legs(config, 3, rate=0.3)]
    assert lengths == pytest.approx([0.5, 0.5, 1.0], abs=0.06)


@pytest.mark.parametrize(("clearance", "goes_on"), [(LOOK_AHEAD - 0.02, False), (LOOK_AHEAD + 0.02, True)])
def test_a_leg_ends_a_metre_before_what_stands_ahead_with_a_quarter_turn(clearance, goes_on):
    leg = Search(leg=1, to_turn=0.0, to_drive=5.0)
    search, twist = search_on(leg, Pose2D(), point(HALF_LENGTH + clearance), OUTLINE, CONFIG)
    assert (twist != STOP) is goes_on
    assert search.to_drive == (5.0 if goes_on else 0.0)
    assert search.to_turn == (0.0 if goes_on else pytest.approx(pi / 2.0))


def scan_with(readings):
    """All beams without a return but those of {beam: range}."""
    ranges = np.full(SICK.beams, np.inf)
    ranges[list(readings)] = list(readings.values())
    return scan_of(ranges)


AWAY = Pose((5.0, 0.0, 0.0))  # a lidar far from the robot's own body


def ranges_near(readings, laser=AWAY):
    points = near_points(scan_with(readings), laser, None, OUTLINE)
    return sorted(round(hypot(x - laser.position[0], y), 3) for x, y in points.tolist())


@pytest.mark.parametrize(
    ("readings", "near"),
    [
        ({300: 1.95, 301: 1.95, 400: 2.05, 401: 2.05, 500: 0.5, 501: 0.5}, [0.5, 0.5, 1.95, 1.95]),
        ({300: 1.0}, []),
        ({300: 1.0, 302: 1.0}, [1.0, 1.0]),  # one beam between them may be missing
        ({300: 1.0, 303: 1.0}, []),
        ({300: 1.0, 301: 1.19}, [1.0, 1.19]),
        ({300: 1.0, 301: 1.21}, []),  # another body
        ({300: 1.0, 301: 1.0, 302: 1.5, 400: 0.5}, [1.0, 1.0]),
    ],
)
def test_near_is_within_two_metres_of_the_lidar_and_no_speckle(readings, near):
    assert ranges_near(readings) == near


AHEAD = [(SICK.beams - 1) // 2, (SICK.beams + 1) // 2]  # the two middle beams


PILLAR = target_at((6.5, 0.0), 0.2, AWAY, OUTLINE)


@pytest.mark.parametrize(
    ("distance", "laser", "target", "kept"),
    [
        # a centimetre around its outline is the robot itself
        (HALF_LENGTH + 0.007, Pose(), None, 0),
        (HALF_LENGTH + 0.015, Pose(), None, 2),
        # 15 cm around the pillar are not in the way to it
        (1.5 - 0.2 - 0.12, AWAY, PILLAR, 0),
        (1.5 - 0.2 - 0.18, AWAY, PILLAR, 2),
        (1.5 - 0.2 - 0.12, AWAY, None, 2),
    ],
)
def test_neither_the_robot_itself_nor_its_pillar_is_in_the_way(distance, laser, target, kept):
    assert len(near_points(scan_with(dict.fromkeys(AHEAD, distance)), laser, target, OUTLINE)) == kept


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("beside", "free"), [(0.14, False), (0.16, True)])
def test_a_free_way_is_15_cm_wider_than_the_robot_on_each_side(beside, free, side):
    assert is_free(point(0.8, side * (HALF_WIDTH + beside)), 0.0, LOOK_AHEAD, OUTLINE) is free
    assert is_free(point(-0.8, side * (HALF_WIDTH + beside)), 0.0, LOOK_AHEAD, OUTLINE)


def test_a_free_way_is_as_long_as_asked_and_counts_from_the_hull():
    assert not is_free(point(HALF_LENGTH + 0.48), 0.0, 0.5, OUTLINE)
    assert is_free(point(HALF_LENGTH + 0.52), 0.0, 0.5, OUTLINE)
    assert is_free(point(0.0, HALF_LENGTH + 0.48), 0.0, 0.5, OUTLINE)
    assert not is_free(point(0.0, HALF_LENGTH + 0.48), pi / 2.0, 0.5, OUTLINE)
    assert is_free(NOTHING, 0.0, 100.0, OUTLINE)


def ring(gap_at, radius=1.4):
    """Points all round but towards `gap_at` [rad], where just one way is free."""
    half = np.arcsin((HALF_WIDTH + 0.16) / radius)
    angles = np.linspace(0.0, 2.0 * pi, 720) + gap_at + half
    angles = angles[(angles - gap_at) < 2.0 * pi - half]
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


@pytest.mark.parametrize(
    ("gap", "wanted", "found"),
    [*[(gap, 0, gap) for gap in (30, -45, 105, -120)], (135, 30, 135), (135, 0, None)],
)
def test_it_finds_the_one_way_that_is_free_in_steps_of_15_degrees_no_farther_round_than_120(
    gap, wanted, found
):
    way = free_bearing(ring(radians(gap)), radians(wanted), LOOK_AHEAD, OUTLINE)
    assert way == (None if found is None else pytest.approx(radians(found)))


def test_the_wanted_way_is_taken_if_it_is_free_however_short_it_is():
    assert free_bearing(point(1.2), 0.0, 0.5, OUTLINE) == 0.0
    assert free_bearing(point(1.2), 0.0, 1.0, OUTLINE) != 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_of_two_equally_near_ways_the_one_that_the_robot_faces_more_is_taken(side):
    wanted = side * 0.6
    post = point(1.2 * cos(wanted), 1.2 * sin(wanted))
    assert abs(free_bearing(post, wanted, LOOK_AHEAD, OUTLINE)) < 0.6
    assert atan2(post[0, 1], post[0, 0]) == pytest.approx(wanted)
