"""Evaluation of the controller: one command, one table, the same metrics for the same seed.

In: counts and a seed. Out: a table on standard output; on a terminal, progress on standard error.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from itertools import product
from math import inf, nan
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Set, Tuple
from urllib.parse import quote

import numpy as np

from husky_evaluation.metrics import (
    GOOD,
    MEANING_OF_BOUND,
    DriveResult,
    center_error,
    false_pillars,
    run_scene,
    run_with_page,
)
from husky_evaluation.scenarios import Scenario, course_scenario, random_starts
from husky_evaluation.setup import (
    COURSE_GAINS,
    Setup,
    add_profile_options,
    add_seed_option,
    add_starts_option,
    setup_of,
)
from husky_evaluation.tasks.command import (
    add_old_name,
    add_worker_options,
    exit_codes,
    name_as_typed,
    positive,
)
from husky_evaluation.tasks.workers import Workers
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.course import PILLAR_NAME
from husky_highlevel_controller.drawing.templates import write_page
from husky_highlevel_controller.result import Cell, Result, Table
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig

TOUCHING = ControlConfig(stop_distance=0.0)  # control of a robot that drives until it touches the pillar


HEADER = ("figure", "value", "wanted", "verdict")
# row of a table, with the columns of HEADER; the verdict is a `Cell`, whose style is "missed" if the value
# misses its limits
Row = Tuple[Any, ...]


class Replays:
    """Folder of the pages that play the runs, with the names of the pages that were written."""

    def __init__(self, folder: Path) -> None:
        """Make the folder if it does not exist."""
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._names: Set[str] = set()

    def write(self, name: str, page: str) -> None:
        """Write a page to a file of this name."""
        (self.folder / name).write_text(page)
        self._names.add(name)

    def links(self) -> Table:
        """Return a table of the written pages; the folder may have others, of earlier evaluations."""
        links = [[Cell(Path(name).stem.replace("_", " "), "", quote(name))] for name in sorted(self._names)]
        return Table(f"All {len(links)} replays", ("drive",), links, folded=True)


def figure(
    name: str, value: float, unit: str = "", minimum: float = -inf, maximum: float = inf, replay: str = ""
) -> Row:
    """Return the row of a metric in a table, with a verdict if the value has limits.

    Args:
        name: name of the metric.
        value: its value; nan misses every limit.
        unit: unit of the value and the limits; empty if they have none.
        minimum: smallest value that is wanted; -inf for no limit.
        maximum: largest value that is wanted; inf for no limit.
        replay: page to which the value links, with a run of this value or one that misses the limits; empty
            for no link.
    """
    wanted = ""
    if minimum > -inf and maximum < inf:
        wanted = f"{minimum:g} to {maximum:g}"
    elif minimum > -inf:
        wanted = f"at least {minimum:g}"
    elif maximum < inf:
        wanted = f"at most {maximum:g}"
    if not wanted:
        verdict = Cell("")
    elif minimum <= value <= maximum:
        verdict = Cell("ok", style="ok")
    else:
        verdict = Cell("MISSED", style="missed")
    title = f"{name} [{unit}]" if unit else name
    return title, Cell(float(value), link=quote(replay)), wanted, verdict


def extraction_figures(title: str, errors: Sequence[float]) -> List[Row]:
    """Return two figures of the detection in scans with a pillar: how many are found, and how exactly.

    At least 99.5 % of the pillars must be found, and 95 % of the found ones with an error of at most 2 cm.

    Args:
        title: beginning of the name of each figure.
        errors: error of the pillar's centre [m] in each scan; inf if the pillar was not found.
    """
    errors_of_found = [error for error in errors if error < inf]
    found_share = 100.0 * len(errors_of_found) / len(errors)
    # [m] 95 % of the found pillars have at most this error
    error_limit = float(np.quantile(errors_of_found, 0.95)) if errors_of_found else nan
    return [
        figure(f"{title}: found", found_share, "%", minimum=99.5),
        figure(f"{title}: centre error, 95 % within", 100.0 * error_limit, "cm", maximum=2.0),
    ]


def start_figures(runs: Sequence[DriveResult]) -> List[Row]:
    """Return the figures of the runs from random starts.

    The bound of a run is the shortest time to arrival that the robot's speed and acceleration allow.
    """
    # a run is good if the robot arrives, stands at most 2 cm from the stop distance, and touches nothing
    bad = [run for run in runs if not run.good]
    touching = [run for run in runs if run.touched]
    good_share = 100.0 * (len(runs) - len(bad)) / len(runs)
    # for each run: time to arrival divided by the bound, and time to arrival minus the bound [s]
    ratios = [run.ratio for run in runs]
    delays = [run.arrived_at - run.bound for run in runs]
    slowest_by_ratio, slowest_by_delay = runs[int(np.argmax(ratios))], runs[int(np.argmax(delays))]
    farthest = max(runs, key=lambda run: abs(run.final_error))
    most_crossings = max(runs, key=lambda run: run.crossings)
    # each `replay` is the file name of a page that plays this run
    return [
        figure(GOOD, good_share, "%", minimum=100.0, replay=bad[0].replay if bad else ""),
        figure(
            "touched something", len(touching), "runs", maximum=0.0,
            replay=touching[0].replay if touching else "",
        ),
        figure(
            "largest final distance error", 100.0 * abs(farthest.final_error), "cm", maximum=2.0,
            replay=farthest.replay,
        ),
        figure("time to arrival divided by its bound, median", float(np.median(ratios))),
        figure("time to arrival divided by its bound, largest", max(ratios), replay=slowest_by_ratio.replay),
        figure("time to arrival minus its bound, median", float(np.median(delays)), "s"),
        figure("time to arrival minus its bound, largest", max(delays), "s", replay=slowest_by_delay.replay),
        figure(
            "zero crossings of the bearing, largest", most_crossings.crossings, maximum=2.0,
            replay=most_crossings.replay,
        ),
    ]  # fmt: skip


def course_figures(run: DriveResult, max_time_over_bound: float = inf) -> List[Row]:
    """Return the figures of the run from the course's start.

    `max_time_over_bound` is the wanted limit of the time to arrival divided by its bound, which is the
    shortest possible time.
    """
    return [
        figure(GOOD, 100.0 * run.good, "%", minimum=100.0, replay=run.replay),
        figure("time to arrival", run.arrived_at, "s"),
        figure("time to arrival divided by its bound", run.ratio, maximum=max_time_over_bound),
        figure("final distance error", 100.0 * run.final_error, "cm", minimum=-2.0, maximum=2.0),
        figure("zero crossings of the bearing", run.crossings, maximum=2.0),
    ]


def default_gains_figures(run: DriveResult) -> List[Row]:
    """Return the figures of the run from the course's start on a real Husky's profile with the default gains.

    In this profile the wheels react late, so with the default gains the robot drives past the stop distance.
    For this reason, the final distance error has no limit here.
    """
    is_good = run.arrived_at < inf and not run.touched
    return [
        figure("arrived, no touch", 100.0 * is_good, "%", minimum=100.0, replay=run.replay),
        figure("time to arrival", run.arrived_at, "s"),
        figure("final distance error", 100.0 * run.final_error, "cm"),
    ]


def touch_figures(run: DriveResult) -> List[Row]:
    """Return the figures of the run from the course's start with stop_distance 0."""
    is_touched = float(run.touched == (PILLAR_NAME,))
    return [
        figure("touched the pillar, and nothing else", is_touched, minimum=1.0, replay=run.replay),
        figure("time to arrival", run.arrived_at, "s"),
        figure("gap in the end", 100.0 * run.gap, "cm", maximum=0.5),
        figure("pillar pushed by", 100.0 * run.pushed, "cm", maximum=2.0),
    ]


def evaluate_robot(
    seed: int, starts: int, workers: Workers, ground: str, replays: Optional[Replays] = None
) -> Dict[str, List[Row]]:
    """Return the figures of the runs on a real Husky's profile, by title.

    The beams of its lidar may miss the pillar from 20 m away. Then the controller first searches for the
    pillar, so the time to arrival has no limit. Its wheels react 0.3 s late. Because of that, it drives 0.1 m
    past the stop distance with the default gains, but not with the gains of robot.launch. `ground` is the
    ground under the robot.
    """
    setup = setup_of("robot", ground)
    # first the default gains, then the gains of robot.launch
    setups = [replace(setup, control=ControlConfig()), setup]
    default_run, robot_gains_run = drives(setups, [course_scenario(seed)], workers, "course runs", replays)
    runs = drives([setup], random_starts(starts, seed), workers, "random starts", replays)
    return {
        f"Profile robot, {ground} ground: course start, default gains": default_gains_figures(default_run),
        "Course start, gains of robot.launch": course_figures(robot_gains_run),
        f"{starts} random starts, 2-25 m away, gains of robot.launch": start_figures(runs),
    }


def evaluate(
    seed: int,
    scans: int,
    starts: int,
    workers: Workers,
    replays: Optional[Replays] = None,
    robot: str = "husky",
) -> Dict[str, List[Row]]:
    """Return all metrics on Gazebo's profile, by title.

    They come from `scans` single scans of each kind and from `starts` random starts. Pages that play the
    runs go into `replays`.
    """
    setup = setup_of(robot=robot)
    lidar, robot_data = setup.simulator.lidar, setup.simulator.robot
    extraction_rows = evaluate_extraction(seed, scans, lidar, workers)
    # with TOUCHING, the robot drives on until it touches the pillar
    setups = [setup, setup.with_gains(COURSE_GAINS), replace(setup, control=TOUCHING)]
    default_run, course_gains_run, touching_run = drives(
        setups, [course_scenario(seed)], workers, "course runs", replays
    )
    runs = drives([setup], random_starts(starts, seed), workers, "random starts", replays)
    figures = {
        f"Pillar extraction, {scans} random scans of each kind, noise {1000.0 * lidar.noise:g} mm": (
            extraction_rows
        ),
        # the course's gains are small, so only the time with the default gains has a limit
        "Course start, default gains": course_figures(default_run, max_time_over_bound=1.15),
        "Course start, the course's gains 0.1 and 0.4": course_figures(course_gains_run),
    }
    half_length, _ = robot_data.footprint.hull  # [m] x of the front of the body in base_link
    # [m] distance from the lidar to a pillar that touches the front of the robot
    range_at_touch = half_length - robot_data.lidar_mount.x
    # `touching_run` is reported only if the lidar of this robot can see a pillar that touches the robot
    if range_at_touch > lidar.range_min:
        figures["Course start, stop_distance 0"] = touch_figures(touching_run)
    figures[f"{starts} random starts, 2-25 m away, default gains"] = start_figures(runs)
    return figures


def evaluate_extraction(seed: int, scans: int, lidar: LidarConfig, workers: Workers) -> List[Row]:
    """Return the figures of the pillar extraction, from `scans` single scans of each kind.

    The scans show a pillar alone, a pillar among other objects, or other objects without a pillar.
    """
    numbers = range(scans)
    # a process gets 50 scans at once, because one scan takes only a millisecond; if there are few scans, they
    # are sent in about four groups, so that several processes get work
    chunk = min(50, scans // 4 + 1)
    errors = partial(center_error, seed=seed, lidar=lidar)
    errors_alone = workers.map(partial(errors, clutter=False), numbers, "pillars alone", chunk)
    errors_in_company = workers.map(partial(errors, clutter=True), numbers, "pillars in company", chunk)
    count_false = partial(false_pillars, seed=seed, lidar=lidar)
    false_counts = workers.map(count_false, numbers, "scenes without", chunk)
    false_share = 100.0 * float(np.mean([count > 0 for count in false_counts]))
    return [
        *extraction_figures("pillar alone, 3 beams or more", errors_alone),
        *extraction_figures("pillar in company, 3 beams or more", errors_in_company),
        figure("scans without a pillar that show one of 8 beams or more", false_share, "%", maximum=0.1),
    ]


def drives(
    setups: Sequence[Setup],
    scenes: Sequence[Scenario],
    workers: Workers,
    title: str,
    replays: Optional[Replays],
) -> List[DriveResult]:
    """Drive every setup in every scene, and return the results: all of the first setup, then of the next.

    With `replays`, a page that plays the run is written for each run.
    """
    items = list(product(setups, scenes))
    if replays is None:
        return workers.map(run_scene, items, title)
    pages = workers.map(run_with_page, items, title)
    for result, page in pages:
        replays.write(result.replay, page)
    return [result for result, _ in pages]


def result_of_evaluation(figures: Mapping[str, Sequence[Row]], lead: str, source: str) -> Result:
    """Return the result of the command: all figures, and a verdict with the figures that miss their limits.

    Args:
        figures: rows of each table, by its title.
        lead: sentences above the tables.
        source: hash of the results, and the machines that computed them.
    """
    tables = [Table(title, HEADER, rows) for title, rows in figures.items()]
    rows = [row for table in tables for row in table.rows]
    missed = "; ".join(name for name, _, _, cell in rows if cell.style == "missed")
    verdict = f"missed: {missed}" if missed else "every figure is within its limits"
    return Result("Evaluation of the controller", lead, tables, verdict, failed=bool(missed), source=source)


def evaluate_options(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog=name_as_typed("evaluate"), description="Measure the controller, without ROS."
    )
    add_seed_option(parser)
    scans = parser.add_argument(
        "--scans", type=positive, default=2000, help="number of single scans of each kind (default: 2000)"
    )
    add_old_name(parser, "--scenes", scans)
    add_starts_option(parser, 200)
    add_worker_options(parser)
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="FILE",
        help="file for the results; after an interruption, the same command with this file continues",
    )
    add_profile_options(parser)
    parser.add_argument("--replays", type=Path, help="folder for report.json and a page that shows each run")
    return parser.parse_args(arguments)


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command `evaluate`: print all figures, and exit with 1 if one of them misses its limits."""
    options = evaluate_options(arguments)
    with exit_codes(name_as_typed("evaluate")):
        # only a check: it raises an error if profile, ground and robot do not fit together
        setup_of(options.profile, options.ground, options.robot)
        replays = None if options.replays is None else Replays(options.replays)
        with Workers(options.jobs, options.cluster, options.resume) as workers:
            seed, starts = options.seed, options.starts
            if options.profile == "robot":
                figures = evaluate_robot(seed, starts, workers, options.ground, replays)
            else:
                figures = evaluate(seed, options.scans, starts, workers, replays, options.robot)
            result = result_of_evaluation(
                figures, f"seed {seed}, profile {options.profile}. {MEANING_OF_BOUND}", workers.summary
            )
        print(result.source, file=sys.stderr)  # hash of the results, and the machines that computed them
        print(result)
        if replays is not None:
            write_page(replace(result, tables=[*result.tables, replays.links()]), replays.folder)
    if result.failed:
        raise SystemExit(1)
