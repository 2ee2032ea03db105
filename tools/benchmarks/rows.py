"""Rows of the benchmark's table: one figure, its baseline, their ratio, and the goal."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from statistics import median
from typing import List, Optional, Sequence, Tuple

import numpy as np


@dataclass(frozen=True)
class Effort:
    """Length of a measurement."""

    repeats: int = 5
    simulated: float = 20.0  # [s] simulated time of the fast runs
    real: float = 10.0  # [s] duration of the run at real time
    # number of scans to answer in each run; with fewer scans, a few outliers would decide the 99 % quantile
    scans: int = 500
    most_objects: int = 1000
    most_beams: int = 10000


SHORT = Effort(repeats=1, simulated=2.0, real=2.0, scans=50, most_objects=10, most_beams=720)


@dataclass(frozen=True)
class Row:
    """Medians of one figure and of its baseline."""

    what: str
    unit: str
    ours: float  # median of this package
    yardstick: float  # median of the baseline
    against: str  # name of the baseline
    ratio: float  # median of the runs' own ratios, ours to the baseline
    goal: str = ""
    near: Optional[float] = None  # reached fraction of the goal, 1.0 or more at the goal; None without a goal
    limit: str = ""  # cause that keeps the figure from the goal
    # values (ours, baseline), in the order measured
    runs: List[Tuple[float, float]] = field(default_factory=list)
    more_is_better: bool = False  # True for a speed


def compare(
    what: str, unit: str, runs: Sequence[Tuple[float, float]], against: str, more_is_better: bool = False
) -> Row:
    """Return the row of a figure; `runs` has values (ours, baseline) that were measured by turns."""
    ours, baselines = zip(*runs)
    ratio = median(a / b for a, b in runs)
    return Row(
        what,
        unit,
        median(ours),
        median(baselines),
        against,
        ratio,
        runs=list(runs),
        more_is_better=more_is_better,
    )


def reaching(
    row: Row, goal: str, value: float, minimum: float = 0.0, maximum: float = np.inf, limit: str = ""
) -> Row:
    """Return the row with a goal, and with the fraction of the goal that `value` reaches.

    Args:
        row: row of a figure.
        goal: text of the goal.
        value: value that should reach the goal.
        minimum: goal, if more is better.
        maximum: goal, if less is better.
        limit: cause that keeps the figure from the goal.
    """
    near = value / minimum if minimum else maximum / value  # 1 or more if the goal is reached
    return replace(row, goal=goal, near=near, limit=limit)
