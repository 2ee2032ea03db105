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
    scans: int = 500  # number of scans to answer in each run; with fewer, p99 is a few outliers
    most_objects: int = 1000
    most_beams: int = 10000


SHORT = Effort(repeats=1, simulated=2.0, real=2.0, scans=50, most_objects=10, most_beams=720)


@dataclass(frozen=True)
class Row:
    """Medians of one figure and of its baseline."""

    what: str
    unit: str
    ours: float
    yardstick: float
    against: str  # name of the baseline
    ratio: float  # median of the runs' own ratios, ours to the baseline
    goal: str = ""
    near: Optional[float] = None  # fraction of the goal, which is reached at 1.0
    limit: str = ""  # cause that keeps it from the goal
    runs: List[Tuple[float, float]] = field(
        default_factory=list
    )  # values (ours, baseline), in the order measured
    more_is_better: bool = False  # True for a speed


def compare(
    what: str, unit: str, runs: Sequence[Tuple[float, float]], against: str, more_is_better: bool = False
) -> Row:
    """A row of values that were measured by turns: (ours, baseline) of each run."""
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
    """The row with a goal, the fraction of its minimum or maximum that `value` reaches, and the limit."""
    near = value / minimum if minimum else maximum / value
    return replace(row, goal=goal, near=near, limit=limit)
