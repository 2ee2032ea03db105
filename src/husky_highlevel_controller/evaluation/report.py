"""Results of many drives: tables for programs, a page for people, replays of single drives.

In: rows, pictures, traces. Out: CSV, Parquet, HTML.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.evaluation.rollout import Trace
from husky_highlevel_controller.replay import Replay, to_html
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.templates import render


class Cell(NamedTuple):
    """Cell of a table, or a verdict."""

    value: Any
    style: str = ""  # ok or missed; empty: neither
    link: str = ""  # address


@dataclass(frozen=True)
class Table:
    """Table of a page; a cell that is no `Cell` is a plain value."""

    title: str
    header: Sequence[str]
    cells: Sequence[Sequence[Any]]
    folded: bool = False

    @property
    def rows(self) -> List[List[Cell]]:
        """The cells, each a `Cell`."""
        return [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in self.cells]


def write_page(
    path: Path, title: str, lead: str, tables: Sequence[Table],
    pictures: Optional[Mapping[str, bytes]] = None, verdict: Optional[Cell] = None, source: str = "",
) -> None:  # fmt: skip
    """Write a page with everything in it.

    Args:
        path: of the page.
        title: of the page.
        lead: the sentence below it.
        tables: in order.
        pictures: PNGs by their captions.
        verdict: the result in a sentence.
        source: of the results: hash, machine, versions.
    """
    parts = {"pictures": pictures, "verdict": verdict, "source": source}
    path.write_text(render("report.html", title=title, lead=lead, tables=tables, **parts), encoding="utf-8")


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows of a quantity, two values and a remark, for a terminal."""
    return "\n".join(f"  {title:<34}{a:>10}{b:>10}   {remark}".rstrip() for title, a, b, remark in rows)


def write_table(rows: Sequence[Mapping[str, Any]], path: Path) -> List[Path]:
    """Write PATH.csv, and PATH.parquet where pyarrow is installed; the files written."""
    with path.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    try:
        from pyarrow import Table as Columns
        from pyarrow import parquet
    except ImportError:
        return [path.with_suffix(".csv")]
    parquet.write_table(Columns.from_pylist([dict(row) for row in rows]), path.with_suffix(".parquet"))
    return [path.with_suffix(".csv"), path.with_suffix(".parquet")]


def replay_page(
    name: str, summary: str, control: ControlConfig, trace: Trace, robot: Robot
) -> Tuple[str, str]:
    """File name and text of the page that plays a drive; the name tells scenario, gains and stop distance."""
    gains = f"gains {control.p_gain_vel:g} {control.p_gain_ang:g}"
    title = f"{name}, {gains}, stop {control.stop_distance:g} m"
    page = to_html(Replay(title, summary, trace.times, trace.poses, trace.pillars, robot=robot))
    return f"{re.sub(r'[^a-z0-9.]+', '_', title.lower())}.html", page
