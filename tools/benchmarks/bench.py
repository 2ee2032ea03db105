"""Benchmark of the package against baselines: `./dev bench`.

Every figure is measured by turns with its baseline, so that other work of the machine slows both. Look at the
ratios. With --against the baseline is another checkout, and the exit code is 1 if a figure is worse by more
than its spread or could not be compared.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Dict, List, Sequence, Tuple

from against import PAIRS, cells, compare_checkouts, document
from checkouts import CheckoutError, checkout
from figures import FIGURES
from rows import SHORT, Effort, Row

from husky_evaluation.tasks.fingerprint import processor

RESULTS = Path(__file__).resolve().parents[2] / ".dev" / "bench.json"


def machine() -> Dict[str, object]:
    """Return a description of this machine and of the versions that are measured."""
    memory = Path("/proc/meminfo").read_text().split()[1]
    return {
        "cpu": processor() or platform.machine(),
        "cores": os.cpu_count(),
        "memory_gb": round(int(memory) * 1024 / 1e9, 1),
        "system": platform.platform(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "pybullet": version("pybullet"),
        "load": os.getloadavg()[0],
    }


def table(rows: List[Row]) -> str:
    """Return the rows as a table of Markdown, which reads well on a terminal, too."""
    lines = [("figure", "ours", "baseline", "ratio", "goal", "reached")]
    lines += [
        (
            row.what,
            f"{row.ours:.3g} {row.unit}",
            f"{row.yardstick:.3g} ({row.against})",
            f"{row.ratio:.2f}",
            row.goal,
            reached(row),
        )
        for row in rows
    ]
    return markdown(lines)


def markdown(cells: Sequence[Tuple[str, ...]]) -> str:
    """Return a table of Markdown from its rows of cells, the head first."""
    widths = [max(map(len, column)) for column in zip(*cells)]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def reached(row: Row) -> str:
    """Return how near a figure is to its goal, and what keeps it from the goal; empty without a goal."""
    if row.near is None:
        return ""
    if row.near >= 1.0:
        return "yes"
    return f"{row.near:.0%}: {row.limit}" if row.limit else f"{row.near:.0%}"


def main() -> int:
    """Measure, print and write. Return the exit code."""
    parser = argparse.ArgumentParser(prog="./dev bench", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", default=RESULTS,
                        help="file for the metrics of every run (default: .dev/bench.json)")  # fmt: skip
    parser.add_argument("--only", action="append", choices=[*FIGURES, "marking"], metavar="NAME",
                        help=f"metric to measure, one of {', '.join(FIGURES)}, or marking with --against; "
                        "may be repeated")  # fmt: skip
    parser.add_argument(
        "--short", action="store_true", help="check that the benchmark works; the times mean nothing"
    )
    parser.add_argument("--repeats", type=int,
                        help=f"runs of each figure (default: {Effort().repeats}; "
                        f"with --against: {PAIRS})")  # fmt: skip
    parser.add_argument("--against", type=checkout, metavar="CHECKOUT",
                        help="checkout of another commit; the runs of both alternate")  # fmt: skip
    wanted = parser.parse_args()
    if wanted.repeats is not None and wanted.repeats < 1:
        parser.error(f"argument --repeats: {wanted.repeats} is too few. Use at least 1.")
    if wanted.against:
        return compare_with(wanted)
    if "marking" in (wanted.only or []):
        parser.error("marking has no baseline of its own. Add --against CHECKOUT.")
    measure(wanted)
    return 0


def compare_with(wanted: argparse.Namespace) -> int:
    """Measure this checkout and another by turns. Return 1 if a figure is worse or was not compared."""
    names = wanted.only or [*FIGURES, *([] if wanted.short else ["marking"])]
    host, pairs = machine(), wanted.repeats or (1 if wanted.short else PAIRS)
    try:
        found, problems = compare_checkouts(wanted.against, names, pairs, wanted.short)
    except CheckoutError as error:
        print(f"[dev] error: {error}", file=sys.stderr)
        return 1
    print(describe(host) + "\n")
    print(markdown(cells(found)))
    for problem in problems:
        print(f"[dev] error: {problem}", file=sys.stderr)
    write(wanted.json, {"machine": host, **document(found, problems, wanted.against)})
    return 1 if problems or any(row.worse for row in found) else 0


def measure(wanted: argparse.Namespace) -> None:
    """Measure the figures and their baselines; print and write the rows."""
    effort = SHORT if wanted.short else Effort()
    if wanted.repeats:
        effort = replace(effort, repeats=wanted.repeats)
    found, host, rows = {}, machine(), []
    for name in wanted.only or FIGURES:
        begin = time.monotonic()
        found[name] = FIGURES[name](effort)
        rows += found[name]
        print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr)
    print(describe(host) + "\n")
    # the figures of a short run mean nothing, so they are not compared with the goals
    print(table([replace(row, near=None) for row in rows] if wanted.short else rows))
    if wanted.short:
        print("\nA short run shows that the benchmark works; its times mean nothing.")
    figures = {name: [asdict(row) for row in each] for name, each in found.items()}
    write(wanted.json, {"machine": host, "effort": asdict(effort), "figures": figures})


def describe(host: Dict[str, object]) -> str:
    """Return the description of a machine in one line."""
    return ", ".join(f"{key} {value}" for key, value in host.items())


def write(file: Path, found: Dict[str, Any]) -> None:
    """Write every run's figures."""
    file.write_text(json.dumps(found, indent=2) + "\n")
    print(f"\nevery run: {file}")


if __name__ == "__main__":
    sys.exit(main())
