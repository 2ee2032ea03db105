"""The real lidar: misses of 0, whole millimetres, wide beams, a sweep that takes time."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import Box, Cylinder, Pose, RobotState
from husky_highlevel_controller.simulator.sensors.lms1xx import Lms1xx, Lms1xxConfig
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene

CONFIG = Lms1xxConfig()
EXACT = replace(CONFIG, noise=0.0)
STILL, DRIVING = (RobotState(Pose(), (speed, 0.0, 0.0), (0.0, 0.0, 0.0)) for speed in (0.0, 1.0))
WALL = (Box((0.1, 60.0, 2.0)), Pose((5.05, 0.0, 0.0)))  # its face is 5 m ahead
MIDDLE = 270  # the beam straight ahead


def sample(*shapes, config=EXACT, state=STILL, seed=0):
    lidar = Lms1xx(config, partial(cast_rays, make_scene(shapes)), "laser", Pose(), 0.02)
    lidar.reset(np.random.default_rng(seed))
    return lidar.sample(state, 10.0)


def pillar(x, y=0.0, radius=0.2):
    return Cylinder(radius, 2.0), Pose((x, y, 0.0))


def test_nothing_reads_zero_with_no_intensity():
    scan = sample(config=CONFIG)
    assert len(scan.ranges) == 541
    assert not scan.ranges.any()
    assert not scan.intensities.any()


def test_its_message_is_the_drivers():
    scan = sample(WALL)
    assert (scan.range_min, scan.range_max, scan.scan_time) == (0.01, 20.0, 0.02)
    assert scan.angle_increment == pytest.approx(np.radians(0.5), rel=1e-4)
    assert scan.time_increment == pytest.approx(0.5 / 360 / 50, rel=1e-3)
    assert scan.stamp == pytest.approx(10.0 - 540 * scan.time_increment), "the first beam's moment"


def test_ranges_are_whole_millimetres_with_the_data_sheets_noise():
    ahead = slice(MIDDLE - 40, MIDDLE + 41)
    noisy = np.array([sample(WALL, config=CONFIG, seed=seed).ranges[ahead] for seed in range(30)])
    assert np.abs(noisy * 1000 - np.round(noisy * 1000)).max() < 1e-6
    assert (noisy - sample(WALL).ranges[ahead]).std() == pytest.approx(0.012, rel=0.05)


def test_a_wide_beam_mixes_what_is_near_and_far_at_an_edge():
    ranges = sample(pillar(4.8), WALL).ranges
    between = (ranges > 4.7) & (ranges < 4.95)
    assert between.any(), "some read neither the pillar, 4.60 to 4.68 m, nor the wall, 5 m"
    assert ranges[MIDDLE] == pytest.approx(4.6, abs=0.01)


def test_far_apart_the_near_echo_counts_and_a_weak_one_does_not_hide_what_is_behind():
    assert sample(pillar(3.0, radius=0.02), WALL).ranges[MIDDLE] == pytest.approx(3.0, abs=0.03)
    post = pillar(15.0, radius=0.01)
    behind = Box((0.1, 60.0, 2.0)), Pose((17.05, 0.0, 0.0))
    assert sample(post, behind).ranges[MIDDLE] == pytest.approx(17.0, abs=0.05)


@pytest.mark.parametrize(
    ("radius", "distance", "seen"),
    [
        (0.01, 2.0, True),
        (0.01, 15.0, False),
        (0.2, 15.0, True),
        (0.2, 20.3, False),  # its surface is 20.1 m away, as at the course's start
    ],
)
def test_thin_things_are_unseen_far_away_and_everything_beyond_20_m(radius, distance, seen):
    assert sample(pillar(distance, radius=radius)).ranges.any() == seen


@pytest.mark.parametrize(("remission", "reading"), [(0.1, 0.0), (0.2, 19.0)])
def test_a_dark_wall_is_seen_up_to_18_m_and_a_grey_one_further(remission, reading):
    wall = Box((0.1, 60.0, 2.0)), Pose((19.05, 0.0, 0.0))
    ranges = sample(wall, config=replace(EXACT, remission=remission)).ranges
    assert ranges[MIDDLE] == pytest.approx(reading, abs=0.02 * reading / 19.0)


def test_a_sweep_of_a_driving_robot_is_measured_from_where_it_was():
    ahead = sample(WALL, state=DRIVING).ranges[MIDDLE] - sample(WALL).ranges[MIDDLE]
    assert ahead == pytest.approx(270 * CONFIG.time_increment * 1.0, abs=0.002), "7.5 mm further back"


@pytest.mark.parametrize("turning", [2.0, -2.0])
def test_a_sweep_of_a_turning_robot_is_sheared(turning):
    spinning = RobotState(Pose(), (0.0, 0.0, 0.0), (0.0, 0.0, turning))
    scan, still = sample(pillar(5.0), state=spinning), sample(pillar(5.0))

    def bearing(scan):
        (hit,) = scan.ranges.nonzero()
        return scan.bearings[hit].mean()

    # when the beam that looks ahead was measured, 7.5 ms before the end, the robot had not turned so far
    shift = turning * 270 * CONFIG.time_increment
    assert bearing(scan) - bearing(still) == pytest.approx(shift, abs=0.006)


@pytest.mark.parametrize("beams", [2, 3, 4])
def test_a_lidar_of_few_beams_measures_from_a_driving_robot(beams):
    assert len(sample(WALL, config=replace(EXACT, beams=beams), state=DRIVING).ranges) == beams
