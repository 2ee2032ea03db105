"""Tuning: parameters for which an objective over random starts is smallest, checked on new starts.

In: ranges of parameters, an objective. Out: a YAML file for controller.launch, and its result on new starts.

Optuna proposes whole batches and gets their results in order, so the same seed finds the same values with any
number of workers. The results are kept, so the same command resumes an interrupted tuning.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, fields
from itertools import product
from math import ceil, floor, inf, isfinite
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence

import numpy as np

from husky_evaluation.metrics import GOOD, MEANING_OF_BOUND, Drive, DriveResult, run_scene, time_limit
from husky_evaluation.plots import draw_costs
from husky_evaluation.scenarios import Scenario, random_starts
from husky_evaluation.setup import (
    METADATA,
    Setup,
    add_drive_options,
    parameter_values,
    setup_of,
    tuned_to_yaml,
    unit_of,
)
from husky_evaluation.statistics import paired_row
from husky_evaluation.tasks.command import (
    add_old_name,
    exit_codes,
    is_typed_by_one_command,
    name_as_typed,
    positive,
    refuse_doubled_name,
)
from husky_evaluation.tasks.store import RESULTS
from husky_evaluation.tasks.workers import Workers
from husky_highlevel_controller.config import ConfigError, from_plain, number
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.drawing.templates import write_page
from husky_highlevel_controller.result import PARAMETERS, Result, Table, every_row

# Number of setups that Optuna proposes at once. The proposals depend on this number, so the number of
# processes must not change it.
BATCH = 8
# number of digits to which proposed values are rounded, so that tuned.yaml has exactly the values that were
# tried
DIGITS = 4
HEADER = ("defaults", "found", "found - defaults")


@dataclass(frozen=True)
class Objective:
    """Cost of one run [s]: its time minus the shortest possible time (the bound), and penalties."""

    failure: float = number(
        0.0, 1e6, "cost of a run that does not arrive, added to its time limit [s]", default=60.0
    )
    touch: float = number(0.0, 1e6, "cost of a touch [s]", default=30.0)
    overshoot: float = number(0.0, 1e6, "cost of each metre beyond the stop distance [s/m]", default=100.0)
    crossing: float = number(0.0, 1e6, "cost of each swing across the pillar's direction [s]", default=1.0)

    def cost(self, drive: DriveResult, limit: float) -> float:
        """Return the cost of one run [s], which is small for a fast run without mistakes.

        A run that does not arrive lasts until the time `limit` [s]. With the penalty `failure`, it costs more
        than the slowest arrival.
        """
        time = drive.arrived_at if drive.arrived_at < inf else limit + self.failure
        touch = self.touch if drive.touched else 0.0
        return time - drive.bound + touch + self.overshoot * drive.overshoot + self.crossing * drive.crossings

    @property
    def formula(self) -> str:
        """Return the formula of the objective as text."""
        return (
            f"mean over the starts of: time, or time limit + {self.failure:g} without arrival, beyond the "
            f"bound [s] + {self.touch:g} for a touch + {self.overshoot:g} x overshoot [m] "
            f"+ {self.crossing:g} x swings"
        )


class Range(NamedTuple):
    """Range in which a parameter is searched, in the unit of the parameter."""

    name: str  # name of the parameter
    low: float
    high: float


class Tuned(NamedTuple):
    """Result of tuning."""

    values: Dict[str, float]  # the best values that were found, by the names of the parameters
    trials: List[Dict[str, Any]]  # rows, one for each setup that was tried


def parse_range(text: str, base: Setup) -> Range:
    """Return a range from NAME=LOW:HIGH, or from NAME alone for the whole allowed range.

    The range of a parameter of whole numbers begins and ends with a whole number.

    Raises:
        ConfigError: the text has neither form, or names no parameter of the controller, or a limit is not
            allowed, or fewer than two values are in the range.
    """
    name, equals, limits = text.partition("=")  # `equals` is empty if the text contains no "="
    values = controller_values(base)
    # a bool would pass isinstance(..., int), but it is not a number here, so the exact type is compared
    numeric = sorted(key for key, value in values.items() if type(value) in (int, float))
    if name not in numeric:
        raise ConfigError(f"{name} is not a numeric controller parameter; there are: {', '.join(numeric)}")
    allowed = f"{METADATA[name]['min']}:{METADATA[name]['max']}"
    try:
        low, high = map(float, (limits if equals else allowed).split(":"))
        if not (isfinite(low) and isfinite(high)):
            raise ValueError
    except ValueError:
        raise ConfigError(f"{name} = '{limits}' is not LOW:HIGH, such as {allowed}") from None
    kind = type(values[name])  # int or float
    for limit in (low, high):
        base.with_values({name: kind(limit)})  # raises an error if the limit is not allowed
    if not low < high:
        raise ConfigError(f"{name} = {limits}: {low:g} is not below {high:g}")
    if kind is int:
        # smallest and largest whole number in the range, because the user may have given 1.5:3.5
        low, high = ceil(low), floor(high)
        if not low < high:
            raise ConfigError(f"{name} = {limits}: the range has fewer than two whole numbers")
    return Range(name, low, high)


def controller_values(setup: Setup) -> Dict[str, Any]:
    """Return the parameters of the controller of a setup by name, without those of the simulator."""
    values = parameter_values(setup)
    names = [item.name for item in (*fields(setup.control), *fields(setup.detector))]
    return {name: values[name] for name in names}


def parse_weights(assignments: Sequence[str]) -> Objective:
    """Return the objective with some weights changed by NAME=NUMBER.

    Raises:
        ConfigError: a name is not a weight, or a value is not a number.
    """
    weights: Dict[str, Any] = {}
    for assignment in assignments:
        name, _, text = assignment.partition("=")
        try:
            weights[name] = float(text)
        except ValueError:  # `from_plain` below reports that the text is not a number
            weights[name] = text
    return from_plain(Objective, weights, "--weights ")


def tune(
    ranges: Sequence[Range],
    base: Setup,
    scenes: Sequence[Scenario],
    objective: Objective,
    trials: int,
    seed: int,
    workers: Workers,
    drive: Drive = run_scene,
) -> Tuned:
    """Try setups, `base` first, and return the one with the smallest cost.

    Args:
        ranges: parameters to change, with their ranges.
        base: setup with the other parameters.
        scenes: scenarios that each setup drives; its cost is their mean.
        objective: cost of a run.
        trials: number of setups.
        seed: random seed of the proposals.
        workers: processes that drive.
        drive: function that drives a setup in a scenario.

    Raises:
        HuskyError: Optuna is not installed.
    """
    optuna = _require_optuna()
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    defaults, limit = parameter_values(base), time_limit(base)
    # Optuna tries the values of `base` first; a value outside of its range is moved to the limit of the range
    study.enqueue_trial({name: min(max(defaults[name], low), high) for name, low, high in ranges})
    rows: List[Dict[str, Any]] = []  # one row for each setup that was tried: its values and its cost
    while len(rows) < trials:
        optuna_trials = [study.ask() for _ in range(min(BATCH, trials - len(rows)))]
        proposals = [_propose(trial, ranges, defaults) for trial in optuna_trials]
        setups = [base.with_values(values) for values in proposals]
        # every setup drives every scenario; all results of the first setup come first, then those of the next
        # setup
        results = workers.map(drive, product(setups, scenes), f"setups from {len(rows) + 1}")
        costs = [objective.cost(result, limit) for result in results]
        mean_costs = np.reshape(costs, (len(setups), len(scenes))).mean(axis=1).tolist()
        for trial, values, mean in zip(optuna_trials, proposals, mean_costs):
            study.tell(trial, mean)  # Optuna needs the costs so far for its next proposals
            rows.append({**values, "objective": mean})
    best = min(rows, key=lambda row: row["objective"])
    return Tuned({key: value for key, value in best.items() if key != "objective"}, rows)


def _propose(trial: Any, ranges: Sequence[Range], defaults: Mapping[str, Any]) -> Dict[str, float]:
    """Return the values that Optuna proposes for a trial, by name, with DIGITS digits.

    A parameter whose default is a whole number gets whole numbers. Other values above 0 are searched on a
    logarithmic scale.
    """
    values: Dict[str, float] = {}
    for name, low, high in ranges:
        if type(defaults[name]) is int:
            values[name] = trial.suggest_int(name, int(low), int(high))
        else:
            proposed = trial.suggest_float(name, low, high, log=low > 0.0)
            # rounding may leave the range, so the rounded value is limited to the range
            values[name] = min(max(float(f"{proposed:.{DIGITS}g}"), low), high)
    return values


def _require_optuna() -> Any:
    """Return the module Optuna, which is optional.

    Raises:
        HuskyError: Optuna is not installed.
    """
    try:
        import optuna
    except ImportError as error:
        raise HuskyError(
            f"tune needs Optuna ({error}). Run pip install -r requirements/cluster.txt; if you use ./dev, "
            "write ./dev run before it. See docs/evaluation.md"
        ) from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)  # otherwise Optuna prints a line for each trial
    return optuna


class Check(NamedTuple):
    """Comparison of the found values with the defaults, from fresh starts."""

    table: Table  # metrics of both, and their differences
    is_better: bool  # true if the mean objective of the found values is smaller than that of the defaults


def check(
    base: Setup,
    tuned: Setup,
    scenes: Sequence[Scenario],
    objective: Objective,
    workers: Workers,
    drive: Drive = run_scene,
) -> Check:
    """Compare the metrics of both setups from the same fresh starts."""
    # results of `base` in all scenarios, then results of `tuned` in all scenarios
    results = workers.map(drive, product([base, tuned], scenes), "fresh starts")
    sides = (results[: len(scenes)], results[len(scenes) :])
    # each of the following has the values of `base` first, then the values of `tuned`
    shares = [100.0 * float(np.mean([result.good for result in side])) for side in sides]
    times = np.array([[result.arrived_at for result in side] for side in sides])
    # true for scenarios in which the robot arrives with both setups; a missing arrival has the time inf,
    # which would make the mean infinite
    both_arrive = np.isfinite(times).all(axis=0)
    limit = time_limit(base)
    costs = [[objective.cost(result, limit) for result in side] for side in sides]
    rows = [
        (f"{GOOD} [%]", *shares, ""),
        paired_row("time to arrival, mean [s]", times[:, both_arrive], "s"),
        paired_row("objective [s]", costs, "s"),
    ]
    table = Table(f"Both on {len(scenes)} fresh starts", ("", *HEADER), rows)
    return Check(table, is_better=bool(np.mean(costs[1]) < np.mean(costs[0])))


def result_of_tuning(
    tuned: Tuned, base: Setup, objective: Objective, fresh: Check, tried: str, source: str
) -> Result:
    """Return the result: parameters, metrics of both setups on fresh starts, and all tried setups.

    Args:
        tuned: result of `tune`.
        base: setup with the defaults.
        objective: cost of a run.
        fresh: result of `check`.
        tried: text such as "of 64 setups on 10 starts, seed 0, profile gazebo".
        source: hash of the results, and the machines that computed them.
    """
    defaults, best = parameter_values(base), min(row["objective"] for row in tuned.trials)
    values = [(f"{name} {unit_of(name)}", defaults[name], value) for name, value in tuned.values.items()]
    header = ("", *HEADER[:2])  # a parameter has no column for the difference
    tables = [
        Table("Parameters", header, values, number_format=PARAMETERS),
        fresh.table,
        every_row("Every setup", tuned.trials),
    ]
    # MEANING_OF_BOUND explains the word "bound", which is a part of the formula
    lead = f"{best:.3f} s is the smallest objective {tried}: {objective.formula}. {MEANING_OF_BOUND}"
    verdict = ""
    if all(value == defaults[name] for name, value in tuned.values.items()):
        verdict = f"nothing better than the defaults was found in {len(tuned.trials)} setups"
    elif not fresh.is_better:
        verdict = "on the fresh starts, the found values are not better than the defaults"
    return Result("Parameters found by tune", lead, tables, verdict, source=source)


def launch_arguments(profile: str, ground: str, robot: str) -> List[str]:
    """Return the arguments with which controller.launch simulates this profile, ground and robot.

    An argument is left out if it has the default of controller.launch.
    """
    arguments = []
    if profile != "gazebo":
        arguments.append(f"profile:={profile}")
    if ground != "hard":
        arguments.append(f"ground:={ground}")
    if robot != "husky":
        arguments.append(f"robot:={robot}")
    return arguments


def write_tuned(
    result: Result,
    tuned: Tuned,
    tried: str,
    out: Path,
    others: Optional[Mapping[str, Any]] = None,
    arguments: Sequence[str] = (),
) -> None:
    """Write parameters, trials and page into a folder, and print the result.

    Args:
        result: result of `result_of_tuning`.
        tuned: result of `tune`.
        tried: text such as "of 64 setups on 10 starts, seed 0, profile gazebo".
        out: folder for the files.
        others: parameters that were not tuned, but differ from those that controller.launch uses; they are
            written, too, because all setups drove with them.
        arguments: result of `launch_arguments`.
    """
    file = out / "tuned.yaml"
    file.write_text(tuned_to_yaml({**(others or {}), **tuned.values}, f"Found by tune {tried}."))
    every_row("Every setup", tuned.trials).write(out / "trials")
    page = write_page(result, out, {"setups": draw_costs([row["objective"] for row in tuned.trials])})
    print(f"{result}\n\nparameters: {file}\npage: {page}")
    if not is_typed_by_one_command():  # a user of the pip package may not have roslaunch
        words = " ".join([*arguments, f"parameters:={file.resolve()}"])
        print(f"roslaunch husky_highlevel_controller controller.launch {words}")


def tune_options(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog=name_as_typed("tune"),
        description="Find parameters of the controller, and check them on fresh random starts.",
    )
    parser.add_argument(
        "ranges",
        nargs="+",
        metavar="NAME=LOW:HIGH",
        help="parameter and the range to search; NAME without a range searches all allowed values",
    )
    setups = parser.add_argument(
        "--setups", type=positive, default=64, help="number of sets of values to try (default: 64)"
    )
    add_old_name(parser, "--trials", setups)
    parser.add_argument(
        "--fresh",
        type=positive,
        default=200,
        help="number of new random starts for the final comparison with the default values (default: 200)",
    )
    parser.add_argument(
        "--weights", nargs="+", default=[], metavar="NAME=NUMBER",
        help="weights (failure, touch, overshoot, crossing) of the objective, which is the "
        f"{Objective().formula}",
    )  # fmt: skip
    add_drive_options(parser, "tune", starts=10)
    return parser.parse_args(arguments)


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command `tune`: search for parameters, check them on fresh starts, and write them to a file."""
    options = tune_options(arguments)
    with exit_codes(name_as_typed("tune")):
        base = setup_of(options.profile, options.ground, options.robot)
        objective = parse_weights(options.weights)
        ranges = [parse_range(text, base) for text in options.ranges]
        refuse_doubled_name([each.name for each in ranges], "give one range")
        _require_optuna()  # called now, so that a missing Optuna causes an error before the first run
        seed = options.seed
        # the check needs starts that the tuning has not seen, so the fresh starts have another seed
        starts, fresh = random_starts(options.starts, seed), random_starts(options.fresh, seed + 1)
        with Workers(options.jobs, options.cluster, options.out / RESULTS) as workers:
            tuned = tune(ranges, base, starts, objective, options.setups, seed, workers)
            figures = check(base, base.with_values(tuned.values), fresh, objective, workers)
            tried = f"of {options.setups} setups on {options.starts} starts"
            tried += f", seed {seed}, profile {options.profile}"
            computed_by = workers.summary
        result = result_of_tuning(tuned, base, objective, figures, tried, computed_by)
        # Without a file, controller.launch uses the parameters of Gazebo's profile. Parameters of `base` that
        # differ from them, as for the real Husky, are also written to the file.
        launched = controller_values(setup_of(robot=options.robot))
        others = {name: value for name, value in controller_values(base).items() if value != launched[name]}
        arguments = launch_arguments(options.profile, options.ground, options.robot)
        write_tuned(result, tuned, tried, options.out, others, arguments)
        print(computed_by, file=sys.stderr)
