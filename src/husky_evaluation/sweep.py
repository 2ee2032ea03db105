"""Sweep of parameters: runs from the same starts at every point of a grid, as a table and a picture.

In: axes, scenarios. Out: a row for each run, CSV, heat maps.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from husky_evaluation.metrics import GOOD, Drive, DriveResult, run_scene
from husky_evaluation.plots import Marks, Panel, draw_sweep
from husky_evaluation.scenarios import Scenario, random_starts
from husky_evaluation.setup import (
    COURSE_GAINS,
    ROBOT_GAINS,
    Axis,
    Setup,
    add_drive_options,
    help_line,
    numeric_parameters,
    parameter_values,
    parse_axis,
    setup_of,
)
from husky_evaluation.tasks.command import exit_codes, name_as_typed, refuse_doubled_name
from husky_evaluation.tasks.store import RESULTS
from husky_evaluation.tasks.workers import Workers
from husky_highlevel_controller.drawing.templates import write_page
from husky_highlevel_controller.result import PARAMETERS, Result, Table, every_row


@dataclass(frozen=True)
class Sweep:
    """Results of the runs at all points of a grid."""

    axes: Tuple[Axis, ...]
    scenes: Tuple[str, ...]  # names of the scenarios
    drives: Tuple[DriveResult, ...]  # all runs, point by point; at each point, one run for each scenario

    @property
    def points(self) -> List[Tuple[float, ...]]:
        """Return the values of all axes at each point of the grid, in the order of the runs."""
        return list(itertools.product(*(axis.values for axis in self.axes)))

    @property
    def every_drive(self) -> Table:
        """Return a table with a row for each run."""
        names = [axis.name for axis in self.axes]
        rows = []
        drives = iter(self.drives)
        for point in self.points:
            for _ in self.scenes:
                # parameters of the point by name, and metrics of the next run
                rows.append({**dict(zip(names, point)), **row(next(drives))})
        return every_row("Every run", rows)

    def grid(self, quantity: str, combine: Any) -> np.ndarray:
        """Return a metric at each point of the grid, as an array with a dimension for each axis.

        Args:
            quantity: name of a field or property of `DriveResult`.
            combine: function that makes one value of the values of all scenarios at a point, such as np.mean.
        """
        values = np.array([float(getattr(drive, quantity)) for drive in self.drives])
        # `drives` has all runs at the first point, then all runs at the next point; from point to point, the
        # last axis changes fastest
        shape = [*(len(axis.values) for axis in self.axes), len(self.scenes)]
        return np.asarray(combine(values.reshape(shape), axis=-1))

    @property
    def success(self) -> np.ndarray:
        """Return the success at each point of the grid [%]."""
        return np.asarray(100.0 * self.grid("good", np.mean))

    @property
    def times(self) -> np.ndarray:
        """Return the median time to arrival at each point of the grid [s]; nan if most runs do not arrive."""
        times = self.grid("arrived_at", np.median)
        return np.where(times < inf, times, np.nan)

    def panels(self) -> List[Panel]:
        """Return the panels of the picture; each shows one quantity at all points of the grid.

        The colour scale or y axis of a panel has at least the range `min_range`, in the unit of the quantity.
        """
        overshoot = 100.0 * self.grid("overshoot", np.mean)
        nearest = 100.0 * self.grid("nearest", np.min)
        hatched = self.success < 100.0  # hatching marks the points at which not every run succeeds
        return [
            Panel(
                "time to arrival, median [s]", self.times, min_range=2.0, is_logarithmic=True, hatched=hatched
            ),
            Panel(f"success: {GOOD} [%]", self.success, min_range=100.0, digits=0, is_good_high=True),
            Panel("overshoot of the stop distance, mean [cm]", overshoot, min_range=5.0),
            Panel("smallest gap between hull and pillar [cm]", nearest, min_range=5.0, is_good_high=True),
        ]

    def best_points(self, count: int = 3) -> Table:
        """Return at most `count` points with the highest success, and among these with the shortest time."""
        success, times = self.success.ravel(), self.times.ravel()
        # `lexsort` sorts by its last key, and equal values by the key before it; a point without a time comes
        # after the others with the same success
        sortable_times = np.where(np.isnan(times), inf, times)
        best = np.lexsort((sortable_times, -success))[:count]
        header = [*(axis.name for axis in self.axes), "success [%]", "time to arrival, median [s]"]
        rows = [(*self.points[n], float(success[n]), float(times[n])) for n in best]
        return Table("Best points", header, rows, number_format=PARAMETERS)

    @property
    def finding(self) -> str:
        """Return a sentence on the fraction of points at which every run succeeds."""
        good, count = int((self.success == 100.0).sum()), len(self.points)
        if good == count:
            return f"Every run succeeds at each of the {count} points ({GOOD})."
        return f"Every run succeeds at {good} of {count} points ({GOOD})."


def row(drive: DriveResult) -> Dict[str, Any]:
    """Return the row of the table for one run, in seconds and metres."""
    return {
        "scene": drive.name, "success": drive.good, "arrived_at": drive.arrived_at, "bound": drive.bound,
        "final_error": drive.final_error, "overshoot": drive.overshoot, "nearest": drive.nearest,
        "crossings": drive.crossings, "touched": " ".join(drive.touched),
    }  # fmt: skip


def sweep(
    axes: Sequence[Axis],
    scenes: Sequence[Scenario],
    setup: Setup,
    workers: Workers,
    drive: Drive = run_scene,
) -> Sweep:
    """Drive every scenario at every point of the grid, which has each combination of values of the axes.

    Args:
        axes: parameters and their values.
        scenes: scenarios.
        setup: setup with the other parameters.
        workers: processes that drive.
        drive: function that drives a setup in a scenario.
    """
    names = [axis.name for axis in axes]
    points = itertools.product(*(axis.values for axis in axes))
    setups = [setup.with_values(dict(zip(names, point))) for point in points]
    drives = workers.map(drive, itertools.product(setups, scenes), "runs")
    return Sweep(tuple(axes), tuple(scene.name for scene in scenes), tuple(drives))


def marks(axes: Sequence[Axis], profile: str, robot: str) -> Dict[str, List[float]]:
    """Return the points that are marked in a picture of these axes: well-known setups, such as the defaults.

    The key is the text in the legend, and the list has the value of the setup on each axis. A setup outside
    the picture is left out.
    """
    defaults = setup_of(robot=robot)
    setups = {"defaults": defaults, "the course's gains": defaults.with_gains(COURSE_GAINS)}
    if profile == "robot":
        setups["robot.launch's gains"] = defaults.with_gains(ROBOT_GAINS)
    inside: Dict[str, List[float]] = {}
    for name, setup in setups.items():
        parameters = parameter_values(setup)
        values = [float(parameters[axis.name]) for axis in axes]
        is_inside = all(min(axis.values) <= value <= max(axis.values) for axis, value in zip(axes, values))
        # a second name for the same point would hide the first one in the picture
        if is_inside and values not in inside.values():
            inside[name] = values
    return inside


def write_sweep(swept: Sweep, title: str, source: str, marked: Marks, out: Path) -> None:
    """Write table, picture and page into a folder; print the best points and the names of the files.

    Args:
        swept: results of all runs.
        title: title of page and picture.
        source: hash of the results, and the machines that computed them.
        marked: points that are marked in the picture: text in the legend, and value on each axis.
        out: folder for the files.
    """
    # table with a row for each run, as sweep.csv and, if pyarrow is installed, also as sweep.parquet
    files = swept.every_drive.write(out / "sweep")
    pictures, panels = {}, swept.panels()
    (out / "sweep.png").unlink(missing_ok=True)  # an earlier sweep with other axes may have drawn it
    if len(swept.axes) <= 2:  # a grid of more axes cannot be drawn
        pictures = {panel.title: draw_sweep(swept.axes, [panel], marked) for panel in panels}
        (out / "sweep.png").write_bytes(draw_sweep(swept.axes, panels, marked, title))
        files.append(out / "sweep.png")
    # each row of the table has the parameters of a point, and the value of the point in each panel
    header = [axis.name for axis in swept.axes] + [panel.title for panel in panels]
    values_of_panels = [panel.values.ravel() for panel in panels]
    rows = [
        (*point, *(float(values[index]) for values in values_of_panels))
        for index, point in enumerate(swept.points)
    ]
    lead = f"{len(swept.scenes)} random starts at each of {len(swept.points)} points"
    tables = [swept.best_points(), Table("Every point", header, rows, folded=True)]
    result = Result(title, lead, tables, swept.finding, source=source)
    files.append(write_page(result, out, pictures))
    print("\n".join([f"{result}\n", *(f"file: {file}" for file in files), source]))


def sweep_options(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog=name_as_typed("sweep"),
        description="Drive from the same random starts for every value of one or more parameters.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="parameters:\n" + "\n".join(f"  {name} {help_line(name)}" for name in numeric_parameters()),
    )  # fmt: skip
    parser.add_argument(
        "axes", nargs="+", metavar="NAME=FIRST:LAST:COUNT[:log]",
        help="parameter and its values, at equal distances or (:log) ratios; or NAME=VALUE,VALUE,...",
    )  # fmt: skip
    add_drive_options(parser, "sweep", starts=20)
    return parser.parse_args(arguments)


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command `sweep`: drive at all points of the grid, and write the results into a folder."""
    options = sweep_options(arguments)
    with exit_codes(name_as_typed("sweep")):
        axes = [parse_axis(text) for text in options.axes]
        names = [axis.name for axis in axes]
        refuse_doubled_name(names, "give all its values at once")
        scenes = random_starts(options.starts, options.seed)
        with Workers(options.jobs, options.cluster, options.out / RESULTS) as workers:
            result = sweep(axes, scenes, setup_of(options.profile, options.ground, options.robot), workers)
            title = f"{len(result.drives)} runs: {', '.join(names)}, profile {options.profile}"
            marked = marks(axes, options.profile, options.robot)
            write_sweep(result, title, workers.summary, marked, options.out)
