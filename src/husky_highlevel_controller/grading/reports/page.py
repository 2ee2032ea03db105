"""HTML: one page of a class for the teacher, one self-contained feedback for each student."""

from __future__ import annotations

import base64
import re
import statistics
from dataclasses import dataclass, replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from husky_highlevel_controller.grading.records import Item, Result
from husky_highlevel_controller.paths import share_folder

LEAD = 1.0  # [s], simulated: a replay begins so long before the moment of the first cause
BARS = 10  # of the histogram
BAR_HEIGHT = 60  # [pixels], the highest
COLOURS = {"marked": "", "for a person": "person", "could not be marked": "unmarked"}


@dataclass(frozen=True)
class Row:
    """A result as a template sees it."""

    result: Result
    cells: Tuple[Optional[Item], ...]  # one for each column
    pictures: Tuple[str, ...]  # PNG in base64
    files: Tuple[Tuple[str, str], ...]  # words and address
    replays: Tuple[str, ...] = ()  # HTML, each a page of its own

    @property
    def open(self) -> float:
        """Points that a person has to give."""
        return sum(item.max_points for item in self.result.items if item.points is None)

    @property
    def colour(self) -> str:
        """Class of the state's cell."""
        return COLOURS[self.result.state]


def class_page(
    results: Sequence[Result],
    pictures: Mapping[str, Sequence[bytes]],
    files: Mapping[str, Sequence[Tuple[str, str]]],
) -> str:
    """The teacher's page, sorted by name.

    Args:
        results: of all students.
        pictures: PNGs by name.
        files: by name, (words, path relative to the page) of logs.
    """
    ordered = sorted(results, key=lambda result: result.name.casefold())
    columns = list(dict.fromkeys(item.name for result in ordered for item in result.items))
    rows = [
        _row(result, columns, pictures.get(result.name, ()), files.get(result.name, ())) for result in ordered
    ]
    shares = [result.points / result.max_points for result in ordered if result.max_points]
    return render(
        "class.html",
        rows=rows,
        columns=columns,
        settings=_settings(ordered[0]) if ordered else "no submissions",
        counts=[(state, n) for state in COLOURS if (n := sum(r.state == state for r in ordered))],
        median=round(100.0 * statistics.median(shares), 1) if shares else None,
        bars=histogram(shares),
    )


def feedback_page(result: Result, pictures: Sequence[bytes], replays: Sequence[str] = ()) -> str:
    """Page for one student, which needs no other file and names no other student.

    Args:
        result: the student's.
        pictures: PNGs.
        replays: HTML pages that play the drives.
    """
    cause = result.cause
    if cause is not None and cause.at is not None and replays:
        drive = re.search(r"drive (\d+): ", cause.evidence)
        shown = min(int(drive[1]) if drive else 1, len(replays)) - 1
        start = f"const start = {max(cause.at - LEAD, 0.0):.2f};"
        replays = [*replays]
        replays[shown] = replays[shown].replace("const start = 0;", start, 1)
    row = replace(_row(result, [], pictures, ()), replays=tuple(replays))
    return render("feedback.html", row=row, settings=_settings(result))


def histogram(shares: Sequence[float]) -> List[Dict[str, Any]]:
    """Bars over shares (0 to 1) of the points that were decided: count, height [px], label [%]."""
    counts = [0] * BARS
    for share in shares:
        counts[min(int(BARS * share), BARS - 1)] += 1
    highest = max([*counts, 1])
    return [
        {
            "count": count,
            "height": round(BAR_HEIGHT * count / highest),
            "label": f"{100 * number // BARS}-{100 * (number + 1) // BARS}",
        }
        for number, count in enumerate(counts)
    ]


def _row(
    result: Result, columns: Sequence[str], pictures: Sequence[bytes], files: Sequence[Tuple[str, str]]
) -> Row:
    items = {item.name: item for item in result.items}
    return Row(
        result,
        tuple(items.get(name) for name in columns),
        tuple(base64.b64encode(picture).decode() for picture in pictures),
        tuple((words, quote(path)) for words, path in files),
    )


def _settings(result: Result) -> str:
    return ", ".join(f"{key} {value}" for key, value in result.settings.items() if value is not None)


def render(template: str, **values: Any) -> str:
    """A page of a template in web/templates/, with the common style."""
    folder = share_folder() / "web" / "templates"
    environment = Environment(
        loader=FileSystemLoader(str(folder)),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(number=lambda value: f"{value:g}", grade=_grade)
    style = Markup((folder / "style.css").read_text())
    return environment.get_template(template).render(style=style, **values)


def _grade(points: float, max_points: float) -> str:
    return "full" if points >= max_points - 1e-9 else "some" if points > 0.0 else "none"
