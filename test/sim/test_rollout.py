"""The controller drives the simulated Husky: what the course asks for, and random starts."""

from dataclasses import replace
from math import cos, dist, hypot, sin

import numpy as np
import pytest

from husky_evaluation import evaluate, metrics
from husky_evaluation.evaluate import COURSE_GAINS, TOUCHING
from husky_evaluation.rollout import rollout
from husky_evaluation.scenarios import course_scenario, random_starts
from husky_evaluation.setup import Setup
from husky_highlevel_controller.controller.behaviour import State
from husky_highlevel_controller.datatypes import Body, Cylinder, Geometry, Pose, Pose2D

COURSE = course_scenario()
NEAR = replace(COURSE, start=Pose2D(15.0, 4.0, 0.0))  # five metres before the pillar


def from_lidar(trace, row=-1):
    """True distance from the lidar to the pillar's surface."""
    (x, y, yaw), (pillar_x, pillar_y) = trace.poses[row], trace.pillars[row]
    return hypot(pillar_x - x - 0.337 * cos(yaw), pillar_y - y - 0.337 * sin(yaw)) - 0.2


RANDOM = random_starts(4, seed=3)
DRIVES = [
    pytest.param(Setup(), COURSE, id="the course's start"),
    pytest.param(Setup(COURSE_GAINS), NEAR, id="the course's gains"),
    *[pytest.param(Setup(), start, id=start.name) for start in RANDOM[:2]],
    *[pytest.param(Setup(), start, id=start.name, marks=pytest.mark.slow) for start in RANDOM[2:]],
]


@pytest.mark.parametrize(("setup", "scenario"), DRIVES)
def test_it_arrives_without_a_touch_or_a_swing(setup, scenario):
    result = metrics.run_scenario(setup, scenario)
    assert result.good, result
    assert result.crossings <= 2
    assert scenario is not COURSE or result.ratio <= 1.15, "nearly as fast as it could"


@pytest.mark.parametrize(
    "gains", [{}, pytest.param({"p_gain_vel": 0.1, "p_gain_ang": 0.4}, marks=pytest.mark.slow)]
)
def test_stop_distance_zero_hits_the_pillar_gently_and_stops(gains):
    setup = Setup(replace(TOUCHING, **gains))
    trace = metrics.drive_scenario(setup, NEAR)
    ((touched_at, name),) = trace.touches
    assert name == "unit_cylinder"
    assert trace.arrived_at == pytest.approx(touched_at, abs=0.3)
    at_touch = trace.times.searchsorted(touched_at)
    assert dist(trace.poses[at_touch, :2], trace.poses[at_touch - 1, :2]) / 0.02 < 0.11
    result = metrics.judge_trace(trace, NEAR, setup)
    assert result.gap < 0.005
    assert result.pushed < 0.02, "touched, not run over"


def test_a_trace_tells_what_happened():
    trace = rollout(NEAR)
    rows = len(trace.times)
    assert np.diff(trace.times) == pytest.approx(0.02)
    assert (trace.poses.shape, trace.twists.shape, trace.estimates.shape) == ((rows, 3), (rows, 2), (rows, 2))
    assert trace.poses[0] == pytest.approx((15.0, 4.0, 0.0), abs=0.01)
    # odom starts where the robot does; what the robot remembers is where the pillar is
    assert trace.estimates[-1] == pytest.approx((5.0, 1.0), abs=0.05)
    assert trace.nearest[-1] == pytest.approx(from_lidar(trace), abs=0.01)
    assert trace.distance_errors[-1] == pytest.approx(from_lidar(trace) - 0.4, abs=0.005)
    assert [trace.states[0], trace.states[-1]] == [State.DRIVING, State.ARRIVED]
    assert [event.split(":")[0] for _, event in trace.events] == ["driving", "arrived"]
    assert trace.events[-1][0] == trace.arrived_at
    assert trace.times[-1] == pytest.approx(trace.arrived_at + 1.0, abs=0.021)
    with pytest.raises(ValueError, match="read-only"):
        trace.poses[0, 0] = 1.0


def test_a_thing_in_the_way_that_is_touched_is_named():
    # too low for the lidar
    step = Body("step", Pose((17.0, 4.4, 0.1)), (Geometry(Cylinder(0.5, 0.2)),), ())
    world = replace(COURSE.world, bodies=(*COURSE.world.bodies, step))
    assert "step" in rollout(replace(NEAR, world=world), seconds=4.0).touched


def test_random_starts_are_as_far_away_as_they_should_be_and_face_anywhere():
    scenarios = random_starts(300, seed=1)
    distances = [hypot(20.0 - one.start.x, 5.0 - one.start.y) for one in scenarios]
    assert 2.0 <= min(distances) < 3.0
    assert 24.0 < max(distances) <= 25.0
    assert np.ptp([one.start.yaw for one in scenarios]) > 6.0
    assert random_starts(2, seed=1) == scenarios[:2]
    assert random_starts(2, seed=2) != scenarios[:2]


def test_a_turn_past_a_pillar_not_yet_seen_is_no_swing():
    trace = rollout(NEAR, seconds=1.0)
    rows = len(trace.times)
    yaw = np.arctan2(*(trace.pillars - trace.poses[:, :2]).T[::-1]) + 0.1 * np.sin(np.arange(rows))
    swinging = replace(trace, poses=np.column_stack([trace.poses[:, :2], yaw]))
    assert metrics.crossings(swinging) > 10
    unseen = np.where(np.arange(rows) < rows - 2, np.nan, 0.0)
    assert metrics.crossings(replace(swinging, bearing_errors=unseen)) <= 1


def test_a_robot_that_faces_the_pillar_exactly_at_first_does_not_swing():
    trace = rollout(NEAR, seconds=1.0)
    away = 0.2 * (np.arange(len(trace.times)) > 0)  # [rad] from the second scan on, it looks to the left
    yaw = np.arctan2(*(trace.pillars - trace.poses[:, :2]).T[::-1]) + away
    turned = replace(trace, poses=np.column_stack([trace.poses[:, :2], yaw]), bearing_errors=0.0 * yaw)
    assert metrics.crossings(turned) == 0


def test_the_figures_do_not_depend_on_the_number_of_processes_and_a_missed_one_ends_with_1(
    capfd, monkeypatch, tmp_path
):
    monkeypatch.setattr(evaluate, "course_scenario", lambda seed: replace(NEAR, seed=seed))
    tables, replays = [], tmp_path / "replays"
    replays.mkdir()
    (replays / "start_1_earlier.html").touch()
    for words in (["--jobs", "1"], ["--jobs", "2", "--replays", str(replays)]):
        with pytest.raises(SystemExit, match="1"):  # over so short a way the ramps weigh too much
            evaluate.main(["--seed", "2", "--scans", "10", "--starts", "1", *words])
        captured = capfd.readouterr()
        tables.append(captured.out)
        assert "starts" not in captured.err, "progress is for a terminal"
    assert tables[0] == tables[1]
    page = (replays / "index.html").read_text()
    assert "All 4 replays" in page
    assert "earlier" not in page, "a replay of another evaluation"
    missed = [line for line in tables[0].splitlines() if "MISSED" in line]
    assert [line.split("  ")[0] for line in missed] == ["time to arrival divided by its bound"]
