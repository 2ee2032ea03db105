"""Benchmark of the package against baselines: `./dev bench`.

Every figure is measured by turns with its yardstick, so that what else the machine does falls on both; the
ratios are what to look at.
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
from typing import Dict, List

from figures import FIGURES
from rows import SHORT, Effort, Row

from husky_evaluation.tasks.fingerprint import processor

RESULTS = Path(__file__).resolve().parents[2] / ".dev" / "bench.json"


def machine() -> Dict[str, object]:
    """What the figures were measured on."""
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
    """The rows as Markdown, which reads well on a terminal too."""
    cells = [("figure", "ours", "baseline", "ratio", "goal", "reached")]
    cells += [
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
    widths = [max(map(len, column)) for column in zip(*cells)]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def reached(row: Row) -> str:
    """How near a figure is to its goal, and what limits it."""
    if row.near is None or row.near >= 1.0:
        return "" if row.near is None else "yes"
    return f"{row.near:.0%}" + (f": {row.limit}" if row.limit else "")


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(prog="./dev bench", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", default=RESULTS,
                        help="file for the metrics of every run (default: .dev/bench.json)")  # fmt: skip
    parser.add_argument("--only", action="append", choices=list(FIGURES), metavar="NAME",
                        help=f"metric to measure, one of {', '.join(FIGURES)}; may be repeated")  # fmt: skip
    parser.add_argument(
        "--short", action="store_true", help="check that the benchmark works; the times mean nothing"
    )
    parser.add_argument("--repeats", type=int, help=f"runs of each figure (default: {Effort().repeats})")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT",
                        help="checkout of another commit, against which grading is measured")  # fmt: skip
    wanted = parser.parse_args()
    effort = SHORT if wanted.short else Effort()
    if wanted.repeats:
        effort = replace(effort, repeats=wanted.repeats, markings=wanted.repeats)
    effort = replace(effort, against=wanted.against and wanted.against.resolve())
    all_figures = [name for name in FIGURES if name != "marking" or (wanted.against and not wanted.short)]
    found, host, rows = {}, machine(), []
    for name in wanted.only or all_figures:
        begin = time.monotonic()
        found[name] = FIGURES[name](effort)
        rows += found[name]
        print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr)
    print(", ".join(f"{key} {value}" for key, value in host.items()) + "\n")
    print(table([replace(row, near=None) for row in rows] if wanted.short else rows))
    if wanted.short:
        print("\nA short run shows that the benchmark works; its times mean nothing.")
    figures = {name: [asdict(row) for row in each] for name, each in found.items()}
    document = {"machine": host, "effort": asdict(effort), "figures": figures}
    wanted.json.write_text(json.dumps(document, indent=2, default=str) + "\n")
    print(f"\nevery run: {wanted.json}")


if __name__ == "__main__":
    main()
