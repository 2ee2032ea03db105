"""Evaluation of the controller: one command, one table, the same figures for the same seed.

In: counts and a seed. Out: a table on standard output; on a terminal, progress on standard error.
Must not know: ROS.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import partial
from math import cos, hypot, inf, nan, pi, sin
from multiprocessing import get_context
from typing import Callable, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from tqdm import tqdm

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig, find_pillars
from husky_highlevel_controller.evaluation.rollout import Trace, husky, rollout
from husky_highlevel_controller.evaluation.scenarios import (
    PILLAR_RADIUS,
    Scenario,
    bare_scene,
    course_scenario,
    pillar_scene,
    random_starts,
)
from husky_highlevel_controller.footprint import HALF_LENGTH
from husky_highlevel_controller.simulator.diff_drive import DriveConfig
from husky_highlevel_controller.simulator.profile import GROUNDS, PROFILES, RobotProfile
from husky_highlevel_controller.simulator.simulation import SimulatorConfig

SAME_PILLAR = 0.2  # [m], a pillar found this near to the true one is that one
MANY_BEAMS = 8  # from here on one scan distinguishes an object from a pillar
ALIGNED = (
    0.005  # [rad], within this the robot faces the pillar; a swing beyond it to the other side is a crossing
)

DRIVE_SECONDS, SEARCH_SECONDS = 180.0, 600.0  # [s] of simulated time after which a run ends

COURSE_GAINS = ControlConfig(p_gain_vel=0.1, p_gain_ang=0.4)
TOUCHING = ControlConfig(stop_distance=0.0)
ROBOT_GAINS = ControlConfig(p_gain_vel=0.6, p_gain_ang=1.0)  # config/robot.yaml's, at the default limits
ROBOT_DETECTOR = PillarConfig(range_noise=0.012)


# ---------------------------------------------------------------------------- single scans


def center_error(number: int, seed: int, clutter: bool) -> float:
    """How far from a random pillar the nearest one found is [m]; inf where none is the same."""
    scene = pillar_scene(number, seed, clutter=clutter)
    assert scene.pillar is not None
    x, y, _ = scene.pillar
    error = min((hypot(p.x - x, p.y - y) for p in find_pillars(scene.scan, PillarConfig())), default=inf)
    return error if error < SAME_PILLAR else inf


def false_pillars(number: int, seed: int) -> int:
    """How many pillars of many beams are found in a random scene without one."""
    found = find_pillars(bare_scene(number, seed).scan, PillarConfig())
    return sum(pillar.beams >= MANY_BEAMS for pillar in found)


# ---------------------------------------------------------------------------- whole runs


@dataclass(frozen=True)
class DriveResult:
    """What counts of one run."""

    name: str
    arrived_at: float  # [s]; inf if it did not
    bound: float  # [s], no robot with these limits could be there earlier, even if it faced the pillar
    final_error: float  # [m], true distance from the lidar to the pillar, less the one asked for
    gap: float  # [m], true, from the hull's front to the pillar, in the end
    pushed: float  # [m], how far the pillar was moved
    touched: Tuple[str, ...]
    crossings: int  # of zero by the true bearing, after the first alignment

    @property
    def ratio(self) -> float:
        """Time to arrival over the bound."""
        return self.arrived_at / self.bound

    @property
    def good(self) -> bool:
        """It stands where it should, and touched nothing."""
        return self.arrived_at < inf and not self.touched and abs(self.final_error) <= 0.02


def run(
    control: ControlConfig,
    scenario: Scenario,
    simulator: Optional[SimulatorConfig] = None,
    detector: Optional[PillarConfig] = None,
) -> DriveResult:
    """Drive a scenario and judge it."""
    settle = 3.0 if control.stop_distance == 0.0 else 1.0
    # a real Husky may have to search first
    seconds = SEARCH_SECONDS if simulator and simulator.real else DRIVE_SECONDS
    trace = rollout(scenario, control, detector, simulator, settle=settle, seconds=seconds)
    distance = _lidar_to_pillar(trace, -1)
    first_x, first_y = trace.pillars[0]
    last_x, last_y = trace.pillars[-1]
    lidar_x = husky().fixed_poses[husky().laser_frame].position[0]
    return DriveResult(
        name=scenario.name,
        arrived_at=inf if trace.arrived_at is None else trace.arrived_at,
        bound=time_bound(trace, control, lidar_x),
        final_error=distance - control.stop_distance,
        gap=distance - (HALF_LENGTH - lidar_x),
        pushed=hypot(last_x - first_x, last_y - first_y),
        touched=trace.touched,
        crossings=crossings(trace),
    )


def _lidar_to_pillar(trace: Trace, row: int) -> float:
    """True distance from the lidar to the pillar's surface [m]."""
    x, y, yaw = trace.poses[row]
    lidar_x, lidar_y, _ = husky().fixed_poses[husky().laser_frame].position
    x, y = x + cos(yaw) * lidar_x - sin(yaw) * lidar_y, y + sin(yaw) * lidar_x + cos(yaw) * lidar_y
    return hypot(trace.pillars[row, 0] - x, trace.pillars[row, 1] - y) - PILLAR_RADIUS


def time_bound(trace: Trace, control: ControlConfig, lidar_x: float) -> float:
    """Shortest time to the stop point, straight, at the drive's limits of speed and acceleration [s]."""
    (x, y, _), (pillar_x, pillar_y) = trace.poses[0], trace.pillars[0]
    stop = max(control.stop_distance, HALF_LENGTH - lidar_x)
    length = max(hypot(pillar_x - x, pillar_y - y) - PILLAR_RADIUS - stop - lidar_x, 0.0)
    speed, acceleration = DriveConfig.max_linear, DriveConfig.max_linear_acceleration
    if length < speed**2 / acceleration:  # never at full speed
        return 2.0 * float(np.sqrt(length / acceleration))
    return length / speed + speed / acceleration


def crossings(trace: Trace) -> int:
    """How often the true bearing swings to the other side after it was first aligned, up to the arrival."""
    until = inf if trace.arrived_at is None else trace.arrived_at
    dx, dy = (trace.pillars - trace.poses[:, :2]).T
    bearings = (np.arctan2(dy, dx) - trace.poses[:, 2] + pi) % (2.0 * pi) - pi
    bearings = bearings[trace.times <= until]
    aligned = np.flatnonzero(np.abs(bearings) < ALIGNED)
    if not len(aligned):
        return 0
    after = bearings[aligned[0] :]
    sides = np.sign(np.append(after[0], after[np.abs(after) >= ALIGNED]))
    return int((np.diff(sides) != 0.0).sum())


# ---------------------------------------------------------------------------- the table


class Figure(NamedTuple):
    """One row of the table."""

    name: str
    value: float
    unit: str = ""
    least: float = -inf
    most: float = inf

    @property
    def met(self) -> bool:
        """Whether it is where it is wanted; nan is not."""
        return self.least <= self.value <= self.most or (self.least, self.most) == (-inf, inf)

    def __str__(self) -> str:
        bounds = [f">= {self.least:g}"] * (self.least > -inf) + [f"<= {self.most:g}"] * (self.most < inf)
        wanted = " ".join(bounds)
        verdict = ("ok" if self.met else "MISSED") if wanted else ""
        return f"  {self.name:<66}{self.value:>9.3f} {self.unit:<5}{wanted:<12} {verdict}".rstrip()


def extraction_figures(
    title: str, errors: Sequence[float], least: float = -inf, most: float = inf
) -> List[Figure]:
    """Of the centre errors [m] in scenes with a pillar; inf is one not found."""
    found = [error for error in errors if error < inf]
    p95 = float(np.quantile(found, 0.95)) if found else nan
    return [
        Figure(f"{title}: found", 100.0 * len(found) / len(errors), "%", least=least),
        Figure(f"{title}: centre error, 95 % within", 100.0 * p95, "cm", most=most),
    ]


def start_figures(runs: Sequence[DriveResult]) -> List[Figure]:
    """Of the runs from random starts."""
    good = sum(run.good for run in runs)
    ratios, lost = [run.ratio for run in runs], [run.arrived_at - run.bound for run in runs]
    return [
        Figure("arrived, within 2 cm, without a touch", 100.0 * good / len(runs), "%", least=100.0),
        Figure("touched something", sum(bool(run.touched) for run in runs), "runs", most=0.0),
        Figure(
            "largest final distance error", 100.0 * max(abs(run.final_error) for run in runs), "cm", most=2.0
        ),
        Figure("time to arrival over the bound, median", float(np.median(ratios))),
        Figure("time to arrival over the bound, largest", max(ratios)),
        Figure("time to arrival beyond the bound, median", float(np.median(lost)), "s"),
        Figure("time to arrival beyond the bound, largest", max(lost), "s"),
        Figure("zero crossings of the bearing, largest", max(run.crossings for run in runs), "", most=2.0),
    ]


def course_figures(run: DriveResult, ratio: float = inf) -> List[Figure]:
    """Of one run from the course's start."""
    return [
        Figure("arrived, within 2 cm, without a touch", 100.0 * run.good, "%", least=100.0),
        Figure("time to arrival", run.arrived_at, "s"),
        Figure("time to arrival over the bound", run.ratio, "", most=ratio),
        Figure("final distance error", 100.0 * run.final_error, "cm", -2.0, 2.0),
        Figure("zero crossings of the bearing", run.crossings, "", most=2.0),
    ]


def touch_figures(run: DriveResult) -> List[Figure]:
    """Of one run from the course's start with stop_distance 0."""
    return [
        Figure(
            "touched the pillar, and nothing else", float(run.touched == ("unit_cylinder",)), "", least=1.0
        ),
        Figure("time to arrival", run.arrived_at, "s"),
        Figure("gap in the end", 100.0 * run.gap, "cm", most=0.5),
        Figure("pillar pushed by", 100.0 * run.pushed, "cm", most=2.0),
    ]


def evaluate_robot(seed: int, starts: int, jobs: int, ground: str) -> List[Tuple[str, List[Figure]]]:
    """The runs on a real Husky's profile, in sections with a title.

    Its beams cannot surely see a pillar of 0.4 m at 20 m, so the controller searches until they do, and the
    time to arrival has no bound. Its wheels are late by 0.3 s, so the default gain drives 0.1 m past the stop
    distance, and that of robot.launch does not. Single scans are not among these figures.
    """
    simulator = SimulatorConfig(real=RobotProfile().on(ground))
    drive = partial(run, scenario=course_scenario(seed), simulator=simulator, detector=ROBOT_DETECTOR)
    standard, slow = work(drive, [ControlConfig(), ROBOT_GAINS], jobs, "course runs")
    start = partial(run, ROBOT_GAINS, simulator=simulator, detector=ROBOT_DETECTOR)
    runs = work(start, random_starts(starts, seed), jobs, "random starts")
    late = [
        Figure(
            "arrived, without a touch",
            100.0 * (standard.arrived_at < inf and not standard.touched),
            "%",
            100.0,
        ),
        Figure("time to arrival", standard.arrived_at, "s"),
        Figure("final distance error", 100.0 * standard.final_error, "cm"),
    ]
    return [
        (f"Profile robot, {ground} ground: course start, default gains", late),
        ("Course start, gains of robot.launch", course_figures(slow)),
        (f"{starts} random starts, 2-25 m away, gains of robot.launch", start_figures(runs)),
    ]


def evaluate(seed: int, scenes: int, starts: int, jobs: int) -> List[Tuple[str, List[Figure]]]:
    """All figures on Gazebo's profile, in sections with a title.

    Args:
        seed: of everything random.
        scenes: single scans of each kind.
        starts: random starts.
        jobs: processes; the figures do not depend on it.
    """
    numbers = range(scenes)
    alone = work(partial(center_error, seed=seed, clutter=False), numbers, jobs, "pillars alone")
    among = work(partial(center_error, seed=seed, clutter=True), numbers, jobs, "pillars in company")
    false = work(partial(false_pillars, seed=seed), numbers, jobs, "scenes without")
    course = course_scenario(seed)
    controls = [ControlConfig(), COURSE_GAINS, TOUCHING]
    standard, gains, touch = work(partial(run, scenario=course), controls, jobs, "course runs")
    runs = work(partial(run, ControlConfig()), random_starts(starts, seed), jobs, "random starts")
    false_share = 100.0 * float(np.mean([count > 0 for count in false]))
    return [
        (
            f"Pillar extraction, {scenes} random scans of each kind, noise 1 mm",
            [
                *extraction_figures("pillar alone, 3 beams or more", alone, 99.5, 2.0),
                *extraction_figures("pillar in company, 3 beams or more", among, 99.5, 2.0),
                Figure("scans without a pillar that show one of 8 beams or more", false_share, "%", most=0.1),
            ],
        ),
        ("Course start, default gains", course_figures(standard, 1.15)),
        ("Course start, the course's gains 0.1 and 0.4", course_figures(gains)),
        ("Course start, stop_distance 0", touch_figures(touch)),
        (f"{starts} random starts, 2-25 m away, default gains", start_figures(runs)),
    ]


def work(task: Callable, items: Iterable, jobs: int, title: str) -> list:
    """The task's result for each item, in order, by several processes; on a terminal with a progress bar."""
    items = list(items)
    with get_context("fork").Pool(jobs) as pool:
        results = pool.imap(task, items, chunksize=max(1, min(50, len(items) // (4 * jobs))))
        return list(tqdm(results, title, total=len(items), disable=None))


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Print the table; exit with 1 if a figure is not where it is wanted."""
    parser = argparse.ArgumentParser(prog="evaluate", description="Measure the controller, without ROS.")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default 0)")
    parser.add_argument(
        "--scenes", type=_positive, default=2000, help="single scans of each kind (default 2000)"
    )
    parser.add_argument("--starts", type=_positive, default=200, help="random starts (default 200)")
    parser.add_argument("--jobs", type=_positive, default=2, help="processes (default 2)")
    parser.add_argument("--profile", choices=PROFILES, default="gazebo", help="whose sensors and drive")
    parser.add_argument("--ground", choices=GROUNDS, default="hard", help="with --profile robot")
    options = parser.parse_args(arguments)
    if options.profile == "robot":
        sections = evaluate_robot(options.seed, options.starts, options.jobs, options.ground)
    else:
        sections = evaluate(options.seed, options.scenes, options.starts, options.jobs)
    print(f"seed {options.seed}")
    for title, figures in sections:
        print(f"\n{title}")
        for figure in figures:
            print(figure)
    if not all(figure.met for _, figures in sections for figure in figures):
        raise SystemExit(1)


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return number
