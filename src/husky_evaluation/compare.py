"""Comparison of B with A: both drive from the same starts, and the differences are counted start by start.

In: two contestants, scenarios. Out: a table, pictures, an exit code.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from husky_evaluation.contestant import (
    Contestant,
    LaunchKind,
    Outcome,
    contestant,
    drive_scene,
)
from husky_evaluation.plots import draw_pairs
from husky_evaluation.scenarios import Scenario, random_starts
from husky_evaluation.setup import add_drive_options, setup_of
from husky_evaluation.statistics import bootstrap, paired_row
from husky_evaluation.tasks.command import between, exit_codes, name_as_typed
from husky_evaluation.tasks.store import RESULTS
from husky_evaluation.tasks.workers import Workers
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.drawing.plots import draw_paths
from husky_highlevel_controller.drawing.templates import write_page
from husky_highlevel_controller.result import Result, Table


@dataclass(frozen=True)
class Comparison:
    """Results of A and of B in the same scenarios."""

    names: Tuple[str, str]
    a: Tuple[Outcome, ...]
    b: Tuple[Outcome, ...]

    @property
    def pairs(self) -> List[Tuple[Outcome, Outcome]]:
        """Return the pairs of outcomes from starts at which both succeed."""
        return [(a, b) for a, b in zip(self.a, self.b) if a.success and b.success]

    @property
    def failures(self) -> List[Tuple[str, Outcome, Outcome]]:
        """Return the letter of the failing side, the outcome of A, and the outcome of B.

        There is an entry for each start at which only one side fails.
        """
        failures = []
        for a, b in zip(self.a, self.b):
            if a.success and not b.success:
                failures.append(("B", a, b))
            elif b.success and not a.success:
                failures.append(("A", a, b))
        return failures

    def values(self, quantity: str) -> Tuple[List[float], List[float]]:
        """Return a field of the outcomes of A, and of B, from all starts at which both succeed."""
        return [getattr(a, quantity) for a, _ in self.pairs], [getattr(b, quantity) for _, b in self.pairs]

    def worse(self, margin: float) -> str:
        """Return why B is worse than A, because it fails more often or is too slow; empty if it is not worse.

        `margin` is the allowed slowdown of B, as a fraction of A's mean time.

        Raises:
            HuskyError: neither A nor B succeeds from any start, so that nothing can be compared.
        """
        if not any(outcome.success for outcome in (*self.a, *self.b)):
            raise HuskyError("neither A nor B succeeds from any start")
        # letter of the failing side, for each start at which only one side fails
        letters = [letter for letter, _, _ in self.failures]
        only_b_fails, only_a_fails = letters.count("B"), letters.count("A")
        # B is worse if it fails at more starts than A; then the times are not compared
        if only_b_fails > only_a_fails:
            return f"starts at which only B fails: {only_b_fails}, only A: {only_a_fails}"
        if not self.pairs:  # no start at which both succeed, so no times to compare
            return ""
        times_of_a, times_of_b = self.values("arrived_at")
        allowed = margin * float(np.mean(times_of_a))
        # [s] upper limit of the 95 % confidence interval of B's mean slowdown
        slowdown = bootstrap(np.subtract(times_of_b, times_of_a)).high
        if slowdown <= allowed:
            return ""
        return f"it may be {slowdown:.3f} s slower, and {allowed:.3f} s are allowed"

    @property
    def every_scene(self) -> Table:
        """Return a table with a row for each start: its name, three values of A, and the same values of B."""
        header = ["scene", "a_success", "a_arrived_at", "a_nearest", "b_success", "b_arrived_at", "b_nearest"]
        rows = [
            (a.scene, a.success, a.arrived_at, a.nearest, b.success, b.arrived_at, b.nearest)
            for a, b in zip(self.a, self.b)
        ]
        return Table("Every start", header, rows, folded=True)

    def figures(self) -> Table:
        """Return a table of A, B and B - A: fraction of successes, and mean time and distance.

        The means are over the starts at which both succeed.
        """
        rate_of_a = 100.0 * sum(outcome.success for outcome in self.a) / len(self.a)
        rate_of_b = 100.0 * sum(outcome.success for outcome in self.b) / len(self.b)
        rows = [
            ("stands at the pillar, no touch [%]", rate_of_a, rate_of_b, ""),
            paired_row("time to arrival [s]", self.values("arrived_at"), "s"),
            paired_row("nearest approach [cm]", self.values("nearest"), "cm", factor=100.0),
        ]
        title = f"Times and distances from the {len(self.pairs)} starts at which both succeed"
        return Table(title, ("", "A", "B", "B - A, 95 % of the bootstrap"), rows)

    def result(self, margin: float, source: str) -> Result:
        """Return the result: metrics, failures, every start, and the verdict.

        Args:
            margin: part of A's mean time by which B may be slower, without being worse.
            source: sentence with the machines, the versions, and a hash of the runs.
        """
        why = self.worse(margin)  # reason why B is worse; empty if it is not
        tables = [self.figures()]
        rows = [(f"{a.scene}: only {letter} fails", a.summary, b.summary) for letter, a, b in self.failures]
        if rows:
            tables.append(Table("Starts at which only one fails", ("", "A", "B"), rows))
        verdict = f"B is worse than A: {why}" if why else "B is not worse than A"
        lead = f"{len(self.a)} random starts"
        tables.append(self.every_scene)
        title = f"A = {self.names[0]} and B = {self.names[1]} from the same starts"
        return Result(title, lead, tables, verdict, failed=bool(why), source=source)


def compare(a: Contestant, b: Contestant, scenes: Sequence[Scenario], workers: Workers) -> Comparison:
    """Drive every scenario with both contestants, first all with A and then all with B."""
    sides = []
    for letter, competitor in (("A", a), ("B", b)):
        items = [(competitor, scene) for scene in scenes]
        outcomes = workers.map(drive_scene, items, letter, starts_programs=competitor.starts_programs)
        sides.append(tuple(outcomes))
    return Comparison((a.name, b.name), sides[0], sides[1])


def write_comparison(comparison: Comparison, result: Result, out: Path) -> Path:
    """Write table, page, and a picture of each start at which only one fails; return the path of the page."""
    comparison.every_scene.write(out / "compare")
    # an earlier comparison may have left pictures of other starts in this folder
    for old in out.glob("only_*_fails_*.png"):
        old.unlink()
    pictures = {}  # PNG of each picture in the page; the key is its title
    if comparison.pairs:
        times = [(a.arrived_at, b.arrived_at) for a, b in comparison.pairs]
        pictures["time to arrival"] = draw_pairs(times, "time to arrival [s], a dot for each start")
    for letter, a, b in comparison.failures:
        # both paths (N, 2) [m]; the key is the text of the path in the picture's legend
        paths = {f"A: {a.summary}": a.poses[:, :2], f"B: {b.summary}": b.poses[:, :2]}
        name = f"only {letter.lower()} fails {a.scene}"
        pictures[name] = draw_paths(paths, f"{a.scene}: only {letter} fails", a.pillar)
        (out / f"{name.replace(' ', '_')}.png").write_bytes(pictures[name])
    return write_page(result, out, pictures)


def compare_options(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog=name_as_typed("compare"),
        description="Drive from the same random starts with A and with B. "
        "The exit code is 0 if B is not worse than A, 1 if B is worse, and 2 if the comparison failed.",
    )
    kinds = "FILE.yaml, FILE.py:FUNCTION, MODULE:FUNCTION or 'PACKAGE/FILE.launch [name:=value ...]'"
    parser.add_argument("a", metavar="A", help=kinds)
    parser.add_argument("b", metavar="B", help="other controller, in one of the same forms")
    parser.add_argument(
        "--margin", type=between(float, 0.0, 10.0), default=0.05, metavar="FRACTION",
        help="allowed slowdown of B, as a fraction of A's mean time (default: 0.05)",
    )  # fmt: skip
    add_drive_options(parser, "compare", starts=50)
    return parser.parse_args(arguments)


def main(
    arguments: Optional[Sequence[str]] = None,
    launch_kind: Optional[LaunchKind] = None,
    end_programs_on_signals: Callable[[], None] = lambda: None,
) -> None:
    """Run the command `compare`; exit with 1 if B is worse than A.

    Args:
        arguments: words of the command line; None for those of this process.
        launch_kind: function of the grader that makes contestants of launch files; None rejects launch files.
        end_programs_on_signals: function of the grader. After a call of it, a signal such as Ctrl-C also ends
            the programs that a launch file has started.
    """
    options = compare_options(arguments)
    with exit_codes(name_as_typed("compare")):
        # setup of both contestants; the YAML file of a contestant changes some of its parameters
        base = setup_of(options.profile, options.ground, options.robot)
        a = contestant(options.a, base, launch_kind)
        b = contestant(options.b, base, launch_kind)
        has_launch_file = a.starts_programs or b.starts_programs
        if has_launch_file:
            # the grader drives launch files only with the Husky, and only in Gazebo's profile
            if options.profile != "gazebo":
                raise HuskyError(
                    f"--profile {options.profile} does not work with a launch file; use --profile gazebo"
                )
            if options.robot != "husky":
                raise HuskyError(
                    f"--robot {options.robot} does not work with a launch file; use --robot husky"
                )
            end_programs_on_signals()
        options.out.mkdir(parents=True, exist_ok=True)
        # a file keeps results for the next call; results of a launch file are not kept, because its programs
        # may have changed by then
        kept_results = None if has_launch_file else options.out / RESULTS
        with Workers(options.jobs, options.cluster, kept_results) as workers:
            comparison = compare(a, b, random_starts(options.starts, options.seed), workers)
            result = comparison.result(options.margin, workers.summary)
        print(result)
        page = write_comparison(comparison, result, options.out)
        print(f"\n{result.source}\npage and pictures: {page}", file=sys.stderr)
        if result.failed:
            raise SystemExit(1)
