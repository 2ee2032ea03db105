"""Tracking of one pillar from scan to scan: when it is given up, how certain it is, which one matches."""

from dataclasses import replace

import numpy as np
import pytest

from husky_evaluation.scenarios import SICK, scan_of
from husky_highlevel_controller.controller.pillar_detection import Pillar
from husky_highlevel_controller.controller.tracking import (
    Anchor,
    Estimate,
    Track,
    Visibility,
    aged,
    follow,
    look_at,
)
from husky_highlevel_controller.datatypes import Pose

INCREMENT = 2.0 * SICK.angle_max / (SICK.beams - 1)  # [rad]
LASER = Pose((0.0, 0.0, 0.0))  # in odom


def scan_at(stamp, ranges=np.inf):
    """A scan that reads the same at every beam, or what is given for each."""
    return replace(scan_of(np.broadcast_to(ranges, SICK.beams)), stamp=stamp)


def pillar(x, y=0.0, beams=20):
    return Pillar(x, y, 0.2, beams, 0.001)


def seen(track, stamp, *pillars):
    return follow(track, list(pillars), scan_at(stamp), LASER)


def known(x, y=0.0, deviation=0.0, beams=20):
    """A confirmed track that showed its pillar at 0 s."""
    estimate = Estimate(x, y, 0.2, deviation, 0.0)
    return Track(estimate, beams=beams, anchor=Anchor(estimate, (0.0, 0.0)), confirmed=True)


def given_up(track, period=0.02, ranges=np.inf, seconds=30.0, start=0.0):
    """How long scans of this kind were seen before the place was given up [s]; None if it never was."""
    for step in range(1, round(seconds / period) + 1):
        track, _, _ = follow(track, [], scan_at(start + step * period, ranges), LASER)
        if track.estimate is None:
            return step * period
    return None


def test_an_empty_place_is_given_up_after_half_a_second():
    assert given_up(known(4.0)) == pytest.approx(0.52, abs=0.03)


def test_a_second_in_which_the_pillar_is_seen_makes_up_for_two_in_which_it_is_not():
    track = known(4.0)
    for step in range(1, 21):
        track, _, _ = seen(track, 0.02 * step)
    for step in range(21, 26):
        track, _, _ = seen(track, 0.02 * step, pillar(4.0))
    # 0.4 s less twice 0.1 s: 0.2 s of the half second are used up
    assert given_up(track, start=0.5) == pytest.approx(0.32, abs=0.03)


def test_a_long_gap_between_scans_counts_as_a_tenth_of_a_second():
    assert given_up(known(4.0), period=1.0) == pytest.approx(6.0)


@pytest.mark.parametrize(("distance", "after"), [(1.8, 5.0), (2.3, None)])
def test_only_a_place_within_two_metres_is_given_up_for_being_hidden(distance, after):
    seconds = given_up(known(distance), ranges=0.5, seconds=12.0)
    assert seconds == (None if after is None else pytest.approx(after, abs=0.1))


@pytest.mark.parametrize(
    ("before", "x", "beams", "believed"),
    [
        (20, 4.0, 7, False),
        (20, 4.0, 8, True),
        (3, 4.0, 3, False),
        (3, 4.0, 4, True),  # from nearer by
        (3, 4.4, 3, False),  # the same place
        (3, 4.6, 3, True),  # another place
    ],
)
def test_a_place_given_up_is_believed_again_from_nearer_by_or_from_eight_beams_on(before, x, beams, believed):
    track = known(4.0, beams=before)
    for step in range(1, 40):
        track, _, _ = seen(track, 0.02 * step)
    assert track.estimate is None
    assert (seen(track, 1.0, pillar(x, beams=beams))[1] is not None) is believed


@pytest.mark.parametrize(("others", "remembered"), [(7, True), (8, False)])
def test_eight_places_given_up_are_remembered(others, remembered):
    track, now = Track(), 0.0
    for place in range(others + 1):
        track, sighting, _ = seen(track, now + 0.02, pillar(4.0, 2.0 * (place - 4), beams=5))
        assert sighting is not None
        for _ in range(7):  # until it is given up
            now += 0.1
            track, _, _ = seen(track, now)
        assert track.estimate is None
    first = seen(track, now + 0.02, pillar(4.0, -8.0, beams=5))[1]
    assert (first is None) is remembered


@pytest.mark.parametrize(
    ("distance", "deviation", "same", "another"),
    [
        (2.0, 0.0, 0.50, 0.62),  # 0.5 m, and 3 % of the distance
        (20.0, 0.0, 1.05, 1.15),
        (2.0, 0.2, 1.10, 1.22),  # and three standard deviations
        (2.0, 1.0, 1.40, 1.52),  # but no more than 0.9 m for them
    ],
)
def test_how_far_off_a_pillar_is_taken_for_the_followed_one(distance, deviation, same, another):
    for off, matches in ((same, True), (another, False)):
        track, sighting, _ = seen(known(distance, deviation=deviation), 0.0, pillar(distance, off))
        assert (sighting is not None) is matches
        assert track.estimate.seen_at == 0.0


def test_of_two_that_might_be_it_the_nearer_to_the_old_place_is():
    _, sighting, _ = seen(known(4.0), 0.02, pillar(4.0, 0.3), pillar(4.0, -0.2))
    assert sighting.pillar.y == -0.2


def watch(speed, seconds, track=None, start=0.0, others=(), laser_speed=0.0):
    """Tracks while a pillar 3 m ahead moves sideways, 50 scans a second."""
    track, tracks = track or Track(), []
    for step in range(round(50 * seconds)):
        stamp = start + 0.02 * step
        laser, now = Pose((laser_speed * stamp, 0.0, 0.0)), scan_at(stamp)
        sightings = [pillar(3.0 - laser_speed * stamp, -1.0 + speed * stamp), *others]
        track, _, _ = follow(track, sightings, now, laser)
        tracks.append(track)
    return tracks


@pytest.mark.parametrize(("laser_speed", "scans"), [(0.0, 100), (0.5, 30)])
def test_an_estimate_is_confirmed_when_it_stood_for_2_s_or_was_seen_from_places_0_3_m_apart(
    laser_speed, scans
):
    confirmed = [track.confirmed for track in watch(0.0, 3.0, laser_speed=laser_speed)]
    assert confirmed.index(True) == pytest.approx(scans, abs=1)


@pytest.mark.parametrize("laser_speed", [0.0, 0.2])
@pytest.mark.parametrize("speed", [0.3, 0.5, 1.5])
def test_what_walks_is_dropped_and_never_confirmed(speed, laser_speed):
    tracks = watch(speed, 4.0, laser_speed=laser_speed)
    assert not any(track.confirmed for track in tracks)
    assert [track.doubtful for track in tracks].index(True) < 50 * (0.35 / speed + 0.2)
    assert tracks[-1].doubtful


def test_a_confirmed_pillar_that_begins_to_walk_is_dropped_and_one_that_drifts_with_odometry_is_kept():
    stood = watch(0.0, 3.0)[-1]
    assert any(track.doubtful for track in watch(0.5, 1.0, stood._replace(updated_at=0.0)))
    assert watch(0.05, 10.0)[-1].confirmed


def test_after_one_that_walked_a_pillar_elsewhere_comes_first():
    tracks = watch(0.5, 4.0, others=[pillar(6.0, 2.5)])
    assert tracks[0].estimate.x == pytest.approx(3.0), "the nearer one"
    assert tracks[-1].estimate.x == pytest.approx(6.0)
    assert tracks[-1].confirmed


def test_what_was_seen_for_a_moment_is_dropped_when_something_hides_it_and_believed_when_it_shows_again():
    track = watch(0.0, 0.5)[-1]
    for step in range(25, 60):
        track, _, _ = follow(track, [], scan_at(0.02 * step, ranges=0.5), LASER)
    assert track.estimate is None
    assert seen(track, 2.0, pillar(3.0, -1.0, beams=3))[1] is not None


@pytest.mark.parametrize("distance", [1.0, 3.0, 20.0])
def test_a_place_seen_once_is_as_sure_as_the_spacing_of_the_beams(distance):
    """5 mm, and a quarter of the distance from beam to beam."""
    track, _, _ = seen(Track(), 0.0, pillar(distance))
    assert track.estimate.deviation == pytest.approx(0.005 + 0.25 * INCREMENT * distance, rel=0.01)


def test_a_place_grows_uncertain_by_2_cm_in_a_second_and_by_4_cm_in_four():
    estimate = known(4.0).estimate
    assert aged(estimate, 1.0).deviation == pytest.approx(0.02)
    assert aged(estimate, 4.0).deviation == pytest.approx(0.04)
    assert aged(estimate, -1.0).deviation == 0.0


def test_two_equally_sure_looks_are_averaged():
    track, _, _ = seen(Track(), 0.0, pillar(4.0))
    once = track.estimate.deviation
    track, _, _ = seen(track, 0.0, Pillar(4.02, 0.04, 0.21, 25, 0.001))
    assert (track.estimate.x, track.estimate.y) == pytest.approx((4.01, 0.02), abs=1e-3)
    assert track.estimate.radius == pytest.approx(0.205, abs=1e-3)
    assert track.estimate.deviation == pytest.approx(once / 2.0**0.5, rel=0.02)
    assert track.beams == 25


@pytest.mark.parametrize(
    ("distance", "deviation", "expected"),
    [
        (2.2, 0.0, 2.0 - 0.05 - 0.22),  # 5 cm, and a tenth of the distance
        (5.2, 0.0, 5.0 - 0.3),  # but 0.3 m at most
        (2.2, 0.1, 2.0 - 0.05 - 0.22 - 0.2),  # and twice the standard deviation
    ],
)
def test_nearer_than_this_a_return_hides_the_place_and_beyond_it_the_place_is_empty(
    distance, deviation, expected
):
    estimate = known(distance, deviation=deviation).estimate
    for ranges, verdict in (
        (expected - 0.01, Visibility.HIDDEN),
        (expected + 0.01, Visibility.EMPTY),
        (np.inf, Visibility.EMPTY),
    ):
        assert look_at(estimate, scan_at(0.0, ranges), LASER) is verdict


@pytest.mark.parametrize("y", [0.0, 1.5, -1.5])
@pytest.mark.parametrize(("free", "verdict"), [(11, Visibility.HIDDEN), (15, Visibility.EMPTY)])
def test_most_of_the_beams_that_a_pillar_would_surely_meet_decide(y, free, verdict):
    """At 2.2 m they are 25: those within 0.9 of its radius."""
    x = (2.2**2 - y**2) ** 0.5
    ranges = np.full(SICK.beams, 0.5)
    middle = (np.arctan2(y, x) + SICK.angle_max) / INCREMENT
    first = round(middle - (free - 1) / 2)
    ranges[first : first + free] = np.inf
    assert look_at(known(x, y).estimate, scan_at(0.0, ranges), LASER) is verdict


@pytest.mark.parametrize(("x", "y"), [(-4.0, 0.0), (31.0, 0.0), (4.0 * np.cos(2.35), 4.0 * np.sin(2.35))])
def test_behind_beyond_the_range_and_at_the_edge_nothing_can_be_said(x, y):
    assert look_at(known(x, y).estimate, scan_at(0.0), LASER) is Visibility.OUT_OF_VIEW


@pytest.mark.parametrize("distance", [0.0, 0.1, 0.19])
def test_a_place_at_the_lidar_itself_is_no_error(distance):
    assert look_at(known(distance).estimate, scan_at(0.0, 0.5), LASER) is not Visibility.SEEN


@pytest.mark.parametrize("y", [1.0, -1.0])
def test_a_lidar_that_counts_from_0_to_360_degrees_sees_the_place_too(y):
    ranges = np.full(720, np.inf)
    all_round = replace(scan_at(0.0), angle_min=0.0, angle_max=2.0 * np.pi, ranges=ranges)
    assert look_at(known(3.0, y).estimate, all_round, LASER) is Visibility.EMPTY
