"""Comparison with another checkout: both are measured by turns, and a figure is worse, better or neither."""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from checkouts import OURS, CheckoutError, run_in
from marking import marking

PAIRS = 7  # smallest number of pairs that can be judged
CHANCE = 0.01  # largest probability that an unchanged figure is called worse, or better
Key = Tuple[str, str]  # name of a figure, and its unit


class Reading(NamedTuple):
    """One measured value."""

    value: float
    more_is_better: bool


Readings = Mapping[Key, Reading]


@dataclass(frozen=True)
class Comparison:
    """One figure of two checkouts."""

    what: str
    unit: str
    new: float  # median
    old: float  # median
    ratio: float  # median of the pairs' ratios; above 1 the new checkout is worse
    spread: Tuple[float, float]  # smallest and largest ratio, without outliers
    judged: bool  # False if the pairs are too few
    runs: List[Tuple[float, float]]  # values (new, old), in the order measured

    @property
    def worse(self) -> bool:
        """Return whether the new checkout is worse by more than the spread."""
        return self.judged and self.spread[0] > 1.0

    @property
    def better(self) -> bool:
        """Return whether the new checkout is better by more than the spread."""
        return self.judged and self.spread[1] < 1.0


# ---------------------------------------------------------------------------- arithmetic


def dropped(pairs: int) -> Optional[int]:
    """Return how many ratios the spread leaves out at each end; None if the pairs are too few.

    If nothing has changed, each ratio is below 1 with a chance of one half, whatever the noise is. So the
    number of ratios below 1 has a binomial distribution. The result is the largest k with which the chance of
    at most k ratios below 1 is not larger than CHANCE: 0 for 7 pairs, 1 for 11, 2 for 14.
    """
    chance, found = 0.0, None
    for k in range(pairs):
        chance += math.comb(pairs, k) / 2.0**pairs
        if chance > CHANCE:
            break
        found = k
    return found


def compare_runs(
    what: str, unit: str, runs: Sequence[Tuple[float, float]], more_is_better: bool
) -> Comparison:
    """Compare the paired runs (new, old) of one figure.

    The two runs of a pair follow one another, so other programs slow down both, and their ratio is more exact
    than either run. The spread goes from the smallest ratio to the largest, without the outliers that
    `dropped` counts.
    """
    new_values, old_values = zip(*runs)
    # a ratio above 1 means that the new checkout is worse
    ratios = sorted(old / new if more_is_better else new / old for new, old in runs)
    outliers = dropped(len(ratios))  # number of outliers at each end; None if the pairs are too few
    spread = (ratios[outliers or 0], ratios[-1 - (outliers or 0)])
    return Comparison(
        what,
        unit,
        median(new_values),
        median(old_values),
        median(ratios),
        spread,
        judged=outliers is not None,
        runs=list(runs),
    )


def compare_readings(pairs: Sequence[Tuple[Readings, Readings]]) -> Tuple[List[Comparison], List[Key]]:
    """Compare the values of each pair (new, old).

    Returns:
        Comparisons of the figures that every reading has, and the figures that some reading does not have.
    """
    all_readings = [readings for pair in pairs for readings in pair]
    keys = list(dict.fromkeys(key for readings in all_readings for key in readings))  # each key once
    found, missing = [], []
    for key in keys:
        if not all(key in readings for readings in all_readings):
            missing.append(key)
            continue
        what, unit = key
        runs = [(new[key].value, old[key].value) for new, old in pairs]
        found.append(compare_runs(what, unit, runs, all_readings[0][key].more_is_better))
    return found, missing


# ---------------------------------------------------------------------------- runs


def compare_checkouts(
    old: Path, names: Sequence[str], pairs: int, short: bool
) -> Tuple[List[Comparison], List[str]]:
    """Measure figures of this checkout and of another by turns.

    Args:
        old: Folder of the other checkout.
        names: Figures.
        pairs: Runs of each checkout.
        short: Measure for as short a time as `./dev bench --short`.

    Returns:
        Comparisons, and a sentence for each figure that could not be compared.

    Raises:
        CheckoutError: A checkout cannot be set up.
    """
    for folder in (OURS, old):
        print(f"setting up {folder}", file=sys.stderr)
        run_in(folder, "setup", "grade")  # the set-up must not be a part of a measured time
    found: List[Comparison] = []
    problems: List[str] = []
    for name in names:
        begin = time.monotonic()
        try:
            measured = [_measure_pair(old, name, number, short) for number in range(pairs)]
            compared, missing = compare_readings(measured)
        except CheckoutError as error:
            problems.append(f"{name} was not compared. {error}")
            continue
        found += compared
        problems += [
            f"{what} [{unit}] was not compared: one checkout has no such row." for what, unit in missing
        ]
        print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr)
    return found, problems


def _measure_pair(old: Path, name: str, number: int, short: bool) -> Tuple[Readings, Readings]:
    """Return the readings of both checkouts, this one first, measured one after the other.

    Every second pair measures the old checkout first, so a slow change of the machine favours neither.
    """
    if number % 2:
        before = _measure(old, name, short)
        return _measure(OURS, name, short), before
    return _measure(OURS, name, short), _measure(old, name, short)


def _measure(folder: Path, name: str, short: bool) -> Readings:
    """Measure a figure once, with the checkout's own benchmark, because ours may not fit its modules."""
    if name == "marking":
        return {key: Reading(value, more_is_better=False) for key, value in marking(folder).items()}
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary) / "bench.json"
        effort = ["--short"] if short else ["--repeats", "1"]
        run_in(folder, "bench", "--only", name, *effort, "--json", str(file))
        return readings_of(file, name, folder)


def readings_of(file: Path, name: str, folder: Path) -> Readings:
    """Return the value of the first run in each row that a checkout's benchmark has written for a figure.

    A row appears twice, with equal values, if it is compared with two baselines.

    Raises:
        CheckoutError: The file has other contents.
    """
    try:
        rows = json.loads(file.read_text())["figures"][name]
        found = {
            (row["what"], row["unit"]): Reading(float(row["runs"][0][0]), row.get("more_is_better", False))
            for row in rows
        }
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise CheckoutError(f"Cannot read the figures of {folder}: {error!r}. Take a newer commit.") from None
    for (what, unit), reading in found.items():
        if not 0.0 < reading.value < math.inf:
            raise CheckoutError(
                f"{folder} measured {what} = {reading.value} {unit}, which is not a positive number."
            )
    return found


# ---------------------------------------------------------------------------- report


def cells(comparisons: Sequence[Comparison]) -> List[Tuple[str, ...]]:
    """Return the rows of the table as texts, the head first."""
    lines: List[Tuple[str, ...]] = [("figure", "new", "old", "cost new : old", "spread", "")]
    for row in comparisons:
        verdict = ""
        if not row.judged:
            verdict = "too few pairs"
        elif row.worse:
            verdict = "WORSE"
        elif row.better:
            verdict = "better"
        spread = f"{row.spread[0]:.2f} to {row.spread[1]:.2f}"
        new = f"{row.new:.3g} {row.unit}"
        lines.append((row.what, new, f"{row.old:.3g}", f"{row.ratio:.2f}", spread, verdict))
    return lines


def document(comparisons: Sequence[Comparison], problems: Sequence[str], old: Path) -> Dict[str, Any]:
    """Return the content of the JSON file."""
    rows = [{**asdict(row), "worse": row.worse, "better": row.better} for row in comparisons]
    return {"against": str(old), "comparisons": rows, "problems": list(problems)}
