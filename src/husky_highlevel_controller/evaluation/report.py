"""Reports of many drives as text, JSON and page; tables for programs; replays of single drives.

In: rows, pictures, traces. Out: text, JSON, CSV, Parquet, HTML.
"""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from husky_highlevel_controller.config import to_plain
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.evaluation.rollout import Trace
from husky_highlevel_controller.replay import Replay, to_html
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.templates import render


class Cell(NamedTuple):
    """Cell of a table."""

    value: Any
    style: str = ""  # ok or missed; empty: neither
    link: str = ""  # address


@dataclass(frozen=True)
class Table:
    """Table of a report; a cell that is no `Cell` is a plain value."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]
    folded: bool = False  # on the page, and left out of the text

    @property
    def cells(self) -> List[List[Cell]]:
        """The rows, each of `Cell`s."""
        return [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in self.rows]

    def __str__(self) -> str:
        lines = [list(self.header)]
        for row in self.cells:
            lines.append([f"{x:.3f}" if isinstance(x, float) else str(x) for x, _, _ in row])
        widths = [max(map(len, column)) for column in zip(*lines)]
        aligned = ([first.ljust(widths[0]), *map(str.rjust, others, widths[1:])] for first, *others in lines)
        return "\n".join([self.title, *("  " + "  ".join(line).rstrip() for line in aligned)])


def every_row(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Folded table of rows, one or more, that have the same keys."""
    return Table(title, list(rows[0]), [list(row.values()) for row in rows], folded=True)


@dataclass(frozen=True)
class Report:
    """Report of a command that drives: tables and a verdict; a text by `str`, page and JSON by `write`."""

    title: str
    lead: str  # the sentence below it
    tables: Sequence[Table]
    verdict: str = ""
    failed: bool = False  # what the verdict says, for the exit code
    source: str = ""  # hash of the drives, machines, versions

    def __str__(self) -> str:
        shown = [str(table) for table in self.tables if not table.folded]
        return "\n\n".join([self.lead, *shown, *filter(None, [self.verdict])])

    def write(self, folder: Path, pictures: Optional[Mapping[str, bytes]] = None) -> Path:
        """Write index.html, with PNGs by their captions, and report.json; return the page.

        Numbers that are not finite are null in JSON.
        """
        finite = json.loads(json.dumps(to_plain(self)), parse_constant=lambda _: None)
        (folder / "report.json").write_text(json.dumps(finite), encoding="utf-8")
        page = folder / "index.html"
        page.write_text(render("report.html", report=self, pictures=pictures or {}), encoding="utf-8")
        return page


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
