"""Statistics of paired runs: the same scenarios, driven twice.

In: differences. Out: means with confidence intervals.
"""

from __future__ import annotations

from math import nan
from typing import Any, NamedTuple, Tuple

import numpy as np
from numpy.typing import ArrayLike

RESAMPLES = 10000  # number of resamplings of the bootstrap
LEVEL = 0.95  # confidence level of an interval


class Interval(NamedTuple):
    """Mean, and the limits between which the mean would be in 95 % of repetitions."""

    mean: float
    low: float
    high: float

    def summary(self, unit: str, factor: float = 1.0) -> str:
        """Return mean and limits as text, multiplied by a factor, such as 100 from m to cm."""
        return f"{factor * self.mean:+.3f} {unit} [{factor * self.low:+.3f}, {factor * self.high:+.3f}]"


def bootstrap(differences: ArrayLike) -> Interval:
    """Return the mean of differences, and an interval in which the true mean probably is.

    The differences are those of pairs of runs, and are finite. The interval is the percentile interval of the
    bootstrap. The numbers are nan if there are no differences. The resampling has a fixed seed, so the same
    differences give the same interval.
    """
    values = np.asarray(differences, dtype=float)
    if not len(values):
        return Interval(nan, nan, nan)
    rng = np.random.default_rng(0)
    # mean of each resampling; a resampling has len(values) random values, and may have a value several times
    means = np.array([values[rng.integers(len(values), size=len(values))].mean() for _ in range(RESAMPLES)])
    low, high = np.quantile(means, [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])
    return Interval(float(values.mean()), float(low), float(high))


def paired_row(title: str, sides: ArrayLike, unit: str, factor: float = 1.0) -> Tuple[Any, ...]:
    """Return a row of a table: title, mean of A, mean of B, and the mean of B - A with its interval.

    Args:
        title: title of the row.
        sides: values of A and of B in the same N scenarios, (2, N).
        unit: unit of the row.
        factor: factor from the unit of the values to this unit, such as 100 from m to cm.
    """
    a, b = np.asarray(sides, dtype=float)
    mean_a = factor * float(a.mean()) if len(a) else nan
    mean_b = factor * float(b.mean()) if len(b) else nan
    return title, mean_a, mean_b, bootstrap(b - a).summary(unit, factor)
