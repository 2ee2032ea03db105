"""One sweep of the lidar over a circle in closed form: misses, limits, noise, seeds."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.datatypes import Pose, RobotState
from husky_highlevel_controller.simulator.sensors.lidar import Lidar
from husky_highlevel_controller.simulator.simulator_config import simulator_config

SICK = simulator_config().lidar
QUIET = replace(SICK, noise=0.0)
LAW = settings(derandomize=True, deadline=None, max_examples=40)


def make_lidar(cast_rays, config=QUIET, seed=0, pose_in_base=Pose()):  # noqa: B008
    lidar = Lidar(config, cast_rays, "front_laser", pose_in_base)
    lidar.reset(np.random.default_rng(seed))
    return lidar


def robot_at(position=(0.0, 0.0, 0.0)):
    return RobotState(Pose(position), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def ranges_of(distances, config=QUIET, seed=0):
    """What beams read that come back from these distances."""
    config = replace(config, beams=len(distances))
    return (
        make_lidar(lambda *_: np.array(distances, dtype=float), config, seed).sample(robot_at(), 1.5).ranges
    )


def test_beams_are_cast_where_the_scan_says_they_point_and_as_far_as_it_reaches():
    asked = []

    def cast_rays(*args):
        asked.append(args)
        return np.full(len(args[1].bearings), inf)

    lidar = make_lidar(cast_rays, SICK, pose_in_base=Pose((0.5, 0.0, 0.25)))
    scan = lidar.sample(robot_at((1.0, 2.0, 3.0)), 1.5)
    ((pose, beams, max_range),) = asked
    assert (pose, max_range) == (Pose((1.5, 2.0, 3.25)), 30.0)
    assert np.array_equal(beams.bearings, scan.bearings)
    assert np.array_equal(beams.directions, (np.cos(scan.bearings), np.sin(scan.bearings)))
    assert (scan.stamp, scan.frame, len(scan.ranges)) == (1.5, "front_laser", 720)
    assert (scan.angle_min, scan.angle_max) == (-2.35619, 2.35619)
    assert (scan.range_min, scan.range_max) == (0.1, 30.0)
    for array in (scan.ranges, scan.bearings):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.5])
@pytest.mark.parametrize(
    ("distance", "reading"), [(inf, inf), (30.0, inf), (31.0, inf), (0.0, -inf), (0.05, -inf), (0.1, -inf)]
)
def test_a_miss_reads_plus_inf_and_too_close_minus_inf_whatever_the_noise(noise, distance, reading):
    assert set(ranges_of([distance] * 500, replace(SICK, noise=noise))) == {reading}
    hidden = ranges_of([distance] * 500, replace(simulator_config("smb").lidar, noise=noise, range_max=30.0))
    assert set(hidden) == {inf}, "the SMB's does not see what is too near"


@LAW
@given(st.floats(0.1001, 29.999), st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
def test_noise_never_turns_a_hit_into_a_miss_nor_leaves_the_range_limits(distance, noise, seed):
    ranges = ranges_of([distance] * 50, replace(SICK, noise=noise), seed)
    assert ranges.min() >= SICK.range_min
    assert ranges.max() <= SICK.range_max


def test_noise_has_its_standard_deviation_and_no_bias_far_away_as_close_by():
    errors = ranges_of([10.0] * 16384, replace(SICK, noise=0.02)) - 10.0
    assert errors.std() == pytest.approx(0.02, rel=0.03)
    assert abs(errors.mean()) < 0.02 * 4.0 / 128.0  # four standard errors
    near, far = (ranges_of([d] * 720, SICK) - d for d in (1.0, 20.0))
    assert near == pytest.approx(far, abs=1e-12)
    assert len(set(near)) == 720
    assert ranges_of([0.2, 1.0, 29.9]).tolist() == [0.2, 1.0, 29.9], "without noise"


sights = st.lists(st.sampled_from([0.0, 0.5, 5.0, 50.0, inf]), min_size=20, max_size=20)


@LAW
@given(sights, sights)
def test_the_noise_of_a_beam_does_not_depend_on_what_the_other_beams_meet(some, others):
    alike = np.array(some) == np.array(others)
    assert np.array_equal(ranges_of(some, SICK)[alike], ranges_of(others, SICK)[alike])
