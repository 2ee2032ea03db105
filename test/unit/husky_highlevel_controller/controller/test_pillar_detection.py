"""The pillar in a scan: found, measured, and not mistaken for something else."""

from dataclasses import replace
from math import cos, hypot, inf, nan, pi, sin
from typing import Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import box, look

from husky_evaluation.scenarios import SICK, bare_scene, pillar_scene, scan_of
from husky_highlevel_controller.controller import pillar_detection
from husky_highlevel_controller.controller.circle_fit import fit_circle
from husky_highlevel_controller.controller.pillar_detection import PillarConfig, find_pillars
from husky_highlevel_controller.datatypes import Scan

CONFIG = PillarConfig()


def at(distance: float, bearing: float) -> Tuple[float, float, float]:
    """The usual pillar, as a circle."""
    return distance * cos(bearing), distance * sin(bearing), 0.2


def only(scan: Scan, config: PillarConfig = CONFIG):
    pillars = find_pillars(scan, config)
    assert len(pillars) == 1, pillars
    return pillars[0]


# ---------------------------------------------------------------------------- found and measured


def test_the_pillar_of_the_exercise_as_the_real_simulator_scans_it():
    # Gazebo 11 with husky 0.6.10, single-pillar world, robot at the origin: three beams of 720
    ranges = np.full(720, inf)
    ranges[321:324] = 20.1020, 20.0986, 20.2421
    pillar = only(scan_of(ranges))
    assert hypot(pillar.x, pillar.y) == pytest.approx(20.289, abs=0.005)
    assert pillar.bearing == pytest.approx(-0.249, abs=0.0005)
    assert pillar.beams == 3


def test_the_distance_is_to_the_near_surface_the_place_is_the_centre_and_pillars_come_nearest_first():
    found = find_pillars(look([at(9.0, -1.0), at(3.0, 0.5), at(6.0, 2.0)]), CONFIG)
    assert [pillar.distance for pillar in found] == pytest.approx([2.8, 5.8, 8.8], abs=0.0005)
    assert [hypot(pillar.x, pillar.y) for pillar in found] == pytest.approx([3.0, 6.0, 9.0], abs=0.0005)
    assert [pillar.radius for pillar in found] == pytest.approx([0.2] * 3, abs=0.0005)


@pytest.mark.parametrize(
    ("noise", "clutter", "least_found", "error_p95"),
    [
        (0.001, False, 0.995, 0.02),
        (0.001, True, 0.99, 0.02),
        (0.01, False, 0.99, 0.04),
        (0.03, False, 0.95, 0.1),
    ],
)
def test_reach(noise, clutter, least_found, error_p95):
    errors = []
    for number in range(300):
        scene = pillar_scene(number, 5, clutter, replace(SICK, noise=noise))
        x, y, _ = scene.pillar
        errors.append(min((hypot(p.x - x, p.y - y) for p in find_pillars(scene.scan, CONFIG)), default=inf))
    found = [error for error in errors if error < 0.2]
    assert len(found) >= least_found * len(errors)
    assert np.quantile(found, 0.95) <= error_p95


@pytest.mark.parametrize(
    ("lidar", "distance"),
    [
        (replace(SICK, beams=180), 4.0),
        (replace(SICK, beams=541), 15.0),
        (replace(SICK, beams=5000, range_max=80.0), 40.0),
        (replace(SICK, beams=5000), 0.5),
        (replace(SICK, beams=360, angle_max=pi), 6.0),
        (replace(SICK, beams=720, range_max=20.0), 12.0),
    ],
)
def test_any_lidar_will_do(lidar, distance):
    rng = np.random.default_rng(1)
    for bearing in np.linspace(-2.2, 2.2, 23):
        x, y, _ = at(distance, bearing)
        pillar = only(look([(x, y, 0.2)], lidar=lidar, rng=rng))
        assert hypot(pillar.x - x, pillar.y - y) < 0.02


def test_another_radius_is_looked_for_when_asked():
    config = PillarConfig(pillar_radius=1.0)
    scan = look([(10.0, 2.0, 1.0), (5.0, -2.0, 0.2)], rng=np.random.default_rng(3))
    assert only(scan, config).radius == pytest.approx(1.0, abs=0.02)
    assert only(scan).radius == pytest.approx(0.2, abs=0.02)


def backwards(scan: Scan) -> Scan:
    """The same scan by a lidar that turns the other way."""
    return replace(scan, angle_min=scan.angle_max, angle_max=scan.angle_min, ranges=scan.ranges[::-1])


@given(distance=st.floats(0.7, 18.0), bearing=st.floats(-2.0, 2.0))
@settings(derandomize=True, max_examples=40, deadline=None)
def test_a_mirrored_scene_has_mirrored_pillars_and_a_lidar_that_turns_the_other_way_the_same(
    distance, bearing
):
    scan = look([at(distance, bearing)], rng=np.random.default_rng(7))
    one = only(scan)
    for other, side in ((only(scan_of(scan.ranges[::-1])), -1.0), (only(backwards(scan)), 1.0)):
        assert (other.x, other.y) == (pytest.approx(one.x, abs=1e-6), pytest.approx(side * one.y, abs=1e-6))


# ---------------------------------------------------------------------------- in company


@pytest.mark.parametrize("hidden", [0.25, 0.4, 0.55])
def test_a_partly_hidden_pillar_is_measured_by_what_shows(hidden):
    edge = -0.2 + 0.4 * hidden  # of a box, behind which this share of its width is
    screen = box(3.0, edge * 0.6 - 0.5, 0.0, 0.1, 1.0)
    assert 5 <= (look([(5.0, 0.0, 0.2)], screen).ranges < look([], screen).ranges).sum() <= 9  # of 12
    scan = look([(5.0, 0.0, 0.2)], screen, rng=np.random.default_rng(2))
    for pillar in (only(scan), only(backwards(scan))):
        assert hypot(pillar.x - 5.0, pillar.y) < 0.03


THIN_POST = (1.5 * cos(0.21), 1.5 * sin(0.21), 0.02)
WALLS = ((2.0, -9.0, 2.0, -1.0), (-3.0, 3.0, 9.0, 3.0))
FURNITURE = box(3.0, 2.0, 0.4, 0.4, 0.4) + box(4.0, -2.0, 1.1, 0.5, 0.3) + box(2.0, 3.0, 0.0, 1.0, 0.4)
COMPANY = {
    "cut by the edge of view": (at(4.0, SICK.angle_max - 0.01), (), ()),
    "a thin post in front": (at(3.0, 0.2), (THIN_POST,), ()),
    "returns of a wall are nearer": (at(6.0, 0.1), (), WALLS),
    **{
        f"in a furnished room turned by {yaw}": (
            at(5.0, 0.0),
            ((2.0, -2.0, 0.05),),
            FURNITURE + box(0.0, 0.0, yaw, 16.0, 16.0),
        )
        for yaw in np.linspace(0.0, 1.5, 7).tolist()
    },
}


@pytest.mark.parametrize(("pillar", "posts", "walls"), COMPANY.values(), ids=COMPANY)
def test_a_pillar_in_company_is_the_only_one(pillar, posts, walls):
    found = only(look([pillar, *posts], walls, rng=np.random.default_rng(2)))
    assert hypot(found.x - pillar[0], found.y - pillar[1]) < 0.03


def test_speckle_dropouts_and_the_own_body_hardly_ever_hide_it():
    rng, seen = np.random.default_rng(4), 0
    for _ in range(100):
        ranges = look([at(5.0, 0.4)], rng=rng).ranges.copy()
        ranges[rng.choice(720, 6)] = rng.uniform(0.2, 29.0, 6)
        ranges[rng.choice(720, 20)] = nan
        ranges[rng.choice(720, 3)] = -inf
        ranges[[0, 1, 2, 3, 717, 718, 719]] = 0.155
        seen += any(abs(p.distance - 4.8) < 0.05 for p in find_pillars(scan_of(ranges), CONFIG))
    assert seen >= 97


# ---------------------------------------------------------------------------- nothing there


SEEN = look([at(5.0, 0.0)]).ranges
NOTHING = [
    # an index of the smallest range would be 0 here: a pillar at -135 degrees
    *[(-2.35619, 2.35619, np.full(720, nothing)) for nothing in (inf, -inf, nan, 0.0, -1.0, 99.0)],
    *[(-edge, edge, np.full(count, 5.0)) for count in range(4) for edge in (0.0, 0.001)],
    *[(first, last, SEEN) for first in (0.0, nan) for last in (nan, inf, 7e-5)],
    (inf, inf, SEEN),
]


@pytest.mark.parametrize(("first", "last", "ranges"), NOTHING)
def test_a_scan_of_nothing_of_hardly_any_beams_or_of_no_direction_shows_nothing(first, last, ranges):
    assert find_pillars(Scan(0.0, "laser", first, last, 0.1, 30.0, ranges), CONFIG) == []


DEPTHS = [inf, -inf, nan, -1.0, -0.25, -0.1, 0.0, 1e-9, 0.1, 0.155, 1.0, 3.0, 3.01, 3.1, 20.0, 30.0, 1e6]


@given(
    depths=st.lists(st.sampled_from(DEPTHS), max_size=60),
    limits=st.tuples(st.sampled_from([-inf, -2.0, 0.0, 0.1]), st.sampled_from([30.0, 1e9, inf, nan])),
    span=st.sampled_from([4.7, -4.7, 1e-3, 20.0]),
)
@settings(derandomize=True, max_examples=300, deadline=None)
def test_garbage_never_raises_and_never_makes_numbers_that_are_none(depths, limits, span):
    scan = Scan(0.0, "laser", -span / 2.0, span / 2.0, *limits, np.array(depths, dtype=float))
    with np.errstate(invalid="ignore"):
        pillars = find_pillars(scan, CONFIG)
    for pillar in pillars:
        assert np.isfinite([pillar.x, pillar.y, pillar.radius, pillar.residual]).all()
        assert abs(pillar.radius - CONFIG.pillar_radius) <= CONFIG.radius_tolerance


def hedge(beams: int, *seed: int) -> Scan:
    """A scan of rough leaves 3 m away all around."""
    rough = 3.0 + np.random.default_rng(seed).normal(0.0, 0.3, beams)
    return scan_of(rough, replace(SICK, beams=beams))


@pytest.fixture
def fits(monkeypatch):
    """The segments that got an exact fit."""
    fitted = []

    def fit(segment, *args):
        fitted.append(segment)
        return fit_circle(segment, *args)

    monkeypatch.setattr(pillar_detection, "fit_circle", fit)
    return fitted


@pytest.mark.parametrize(("beams", "most"), [(720, 12), (16384, pillar_detection.MAX_FITS)])
def test_a_hedge_causes_few_exact_fits(beams, most, fits):
    for seed in range(3):
        find_pillars(hedge(beams, 6, seed), CONFIG)
        assert len(fits) <= most  # of 140 and of 3000 segments
        fits.clear()


def test_of_too_many_round_bodies_the_nearest_are_fitted(fits):
    lidar = replace(SICK, beams=16384)
    bearings = np.linspace(-2.3, 2.3, 3 * pillar_detection.MAX_FITS)
    columns = [at(14.0 + bearing, bearing) for bearing in bearings]
    found = find_pillars(look(columns, lidar=lidar, rng=np.random.default_rng(1)), CONFIG)
    assert len(found) == len(fits) == pillar_detection.MAX_FITS
    assert found[-1].distance < 14.0 + bearings[pillar_detection.MAX_FITS]


def test_the_screen_of_clutter_rejects_no_pillar(monkeypatch):
    scans = []
    for number in range(15):
        rng = np.random.default_rng([7, number])
        ranges = pillar_scene(number, 7, 0.01).scan.ranges
        leaves = rng.uniform(0.6, 12.0) + rng.normal(0.0, 0.3, 720)
        scans.append(scan_of(np.where(rng.random(720) < 0.4, np.minimum(leaves, ranges), ranges)))
        steps = np.repeat(rng.uniform(0.6, 12.0, 180), 4) + rng.normal(0.0, 0.01, 720)
        scans.append(scan_of(steps))
    monkeypatch.setattr(pillar_detection, "MAX_FITS", 720)
    screened = [find_pillars(scan, CONFIG) for scan in scans]
    monkeypatch.setattr(pillar_detection, "may_be_pillars", lambda scan, segments, limits: segments)
    assert screened == [find_pillars(scan, CONFIG) for scan in scans]
    assert sum(map(len, screened)) > 15


@pytest.mark.parametrize("radius", [0.03, 0.05, 0.1, 0.13, 0.28, 0.3, 0.5])
def test_a_column_of_another_radius_is_no_pillar(radius):
    rng = np.random.default_rng(6)
    for distance in np.linspace(radius + 0.4, 1.2 + 18.0 * radius, 40):
        scan = look([(distance, 0.1, radius)], rng=rng)
        if scan.valid.sum() >= 8:
            assert find_pillars(scan, CONFIG) == [], distance


def test_a_niche_as_round_as_a_pillar_is_none():
    bow = np.linspace(-1.4, 1.4, 30)
    x, y = 3.0 + 0.2 * np.cos(bow), 0.2 * np.sin(bow)
    niche = tuple(zip(x[:-1], y[:-1], x[1:], y[1:]))
    assert find_pillars(look([], niche, rng=np.random.default_rng(1)), CONFIG) == []


def test_a_rough_thing_is_refused_by_a_strict_residual():
    scan = look([at(3.0, 0.0)], noise=0.02, rng=np.random.default_rng(1))
    assert only(scan).distance == pytest.approx(2.8, abs=0.03)
    assert find_pillars(scan, PillarConfig(max_residual=0.01)) == []


def test_boxes_walls_corners_posts_speckle_and_hedges_are_no_pillars_of_many_beams():
    scans = [bare_scene(number, seed=8).scan for number in range(400)]
    scans += [hedge(720, 5, number) for number in range(60)]
    found = [pillar for scan in scans for pillar in find_pillars(scan, CONFIG)]
    assert not [pillar for pillar in found if pillar.beams >= 8]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_near_wall_far_to_the_side_makes_no_far_pillar_doubtful(side):
    """Only what hides part of its silhouette does."""
    wall = ((-1.0, side * 1.5, 3.0, side * 1.5),)
    for distance in (12.0, 24.0, 28.0):
        (found,) = find_pillars(look([(distance, 0.0, 0.2)], wall), CONFIG)
        assert hypot(found.x - distance, found.y) < 0.05
