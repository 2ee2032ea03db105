"""Writes results down: a table to read, JSON, JUnit XML, CSV.

In: `Result`s. Out: text. Must not know: ROS, how anything is judged, where files are.
"""

from __future__ import annotations

import csv
import io
import json
import textwrap
import xml.etree.ElementTree as ET
from dataclasses import asdict, dataclass, replace
from typing import Any, Dict, Sequence, Tuple

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading.rubrics.items import Item, total

WIDTH = 110  # letters of the table
MAX_TEXT = 1000  # letters of an evidence or note


@dataclass(frozen=True)
class Result:
    """What somebody gets."""

    name: str
    what: str  # the launch file or node
    settings: Dict[str, Any]  # exercise, seed and what else is the same for everybody
    items: Tuple[Item, ...]
    notes: Tuple[str, ...] = ()  # what went wrong, in sentences
    problem: str = ""  # why it could not be marked, in a sentence; empty: it was marked

    def __post_init__(self) -> None:
        """Every text that a submission may have chosen is made printable, whatever it is written to."""
        items = tuple(
            replace(item, name=printable(item.name), evidence=printable(item.evidence)) for item in self.items
        )
        clean = {name: printable(getattr(self, name)) for name in ("name", "what", "problem")}
        for name, value in {**clean, "items": items, "notes": tuple(map(printable, self.notes))}.items():
            object.__setattr__(self, name, value)

    @property
    def points(self) -> float:
        """All of them."""
        return total(self.items)[0]

    @property
    def max_points(self) -> float:
        """That a machine can give."""
        return total(self.items)[1]

    @property
    def state(self) -> str:
        """Marked, or left to a person at least in part, or not marked at all."""
        if self.problem:
            return "could not be marked"
        return "for a person" if any(item.points is None for item in self.items) else "marked"

    @property
    def full(self) -> bool:
        """Everything that a machine can give."""
        return not self.problem and all(item.full for item in self.items)


def printable(text: str, limit: int = MAX_TEXT) -> str:
    """A text on one line without control letters, terminal escapes, or bytes that are no UTF-8; cut if long.

    A submission chooses the names of its files, nodes, topics and errors.
    """
    text = text if len(text) <= limit else text[:limit] + " [...]"
    text = text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else " " for letter in text)


def points(item: Item) -> str:
    """Points of an item, in words."""
    return f"{'-' if item.points is None else f'{item.points:g}'}/{item.max_points:g}"


def table(result: Result) -> str:
    """To be read on a terminal."""
    if result.problem:
        words = textwrap.wrap(f"{result.name}: could not be marked: {result.problem}", WIDTH)
        return "\n".join(
            [*words, *(line for note in result.notes for line in textwrap.wrap(f"note: {note}", WIDTH))]
        )
    name = max(len(item.name) for item in result.items) + 2
    lines = [f"{result.name}  ({result.what})" if result.name != result.what else result.name, ""]
    for item in result.items:
        moment = f" [{item.at:.2f} s]" if item.at is not None else ""
        indent = " " * (name + 10)
        evidence = textwrap.wrap(item.evidence + moment, WIDTH - len(indent)) or [""]
        lines.append(f"{item.name:<{name}}{points(item):>8}  {evidence[0]}")
        lines += [indent + line for line in evidence[1:]]
    lines += ["", f"{'total':<{name}}{f'{result.points:g}/{result.max_points:g}':>8}"]
    by_hand = sum(item.max_points for item in result.items if item.points is None)
    if by_hand:
        lines[-1] += f"  and {by_hand:g} that a person has to give"
    lines += [line for note in result.notes for line in textwrap.wrap(f"note: {note}", WIDTH)]
    return "\n".join(lines)


def to_json(result: Result) -> str:
    """Everything, for programs, and to read it again."""
    content = asdict(result)
    content.update(points=result.points, max_points=result.max_points, full=result.full)
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def from_json(text: str) -> Result:
    """What `to_json` wrote.

    Raises:
        HuskyError: it did not write this.
    """
    try:
        content = json.loads(text)
        items = tuple(Item(**item) for item in content["items"])
        notes = tuple(content["notes"])
        problem = str(content.get("problem", ""))
        return Result(content["name"], content["what"], content["settings"], items, notes, problem)
    except (ValueError, TypeError, KeyError) as error:
        raise HuskyError(f"not a result: {error}") from error


def to_junit(results: Sequence[Result]) -> str:
    """JUnit XML: a suite for each submission, a case for each item; full marks or a failure."""
    root = ET.Element("testsuites")
    for result in results:
        items = result.items
        suite = ET.SubElement(
            root, "testsuite", name=result.name, tests=str(len(items) + bool(result.problem)),
            errors=str(int(bool(result.problem))),
            failures=str(sum(not item.full for item in items)),
            skipped=str(sum(item.points is None for item in items)),
        )  # fmt: skip
        if result.problem:
            case = ET.SubElement(suite, "testcase", name="marking", classname=result.name)
            ET.SubElement(case, "error", message=f"could not be marked: {result.problem}")
        for item in items:
            case = ET.SubElement(suite, "testcase", name=item.name, classname=result.name)
            words = f"{points(item)}: {item.evidence}"
            if item.points is None:
                ET.SubElement(case, "skipped", message=words)
            elif not item.full:
                ET.SubElement(case, "failure", message=words)
            else:
                ET.SubElement(case, "system-out").text = words
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def to_csv(results: Sequence[Result]) -> str:
    """A line for each submission, a column for each item."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = list(dict.fromkeys(item.name for result in results for item in result.items))
    writer.writerow(["submission", *names, "total", "of", "state", "notes"])
    for result in results:
        given = {item.name: item.points for item in result.items}
        marks = ["" if given.get(name) is None else f"{given[name]:g}" for name in names]
        total = ["", ""] if result.problem else [f"{result.points:g}", f"{result.max_points:g}"]
        state = f"{result.state}: {result.problem}" if result.problem else result.state
        words = [result.name, *marks, *total, state, " | ".join(result.notes)]
        writer.writerow([_harmless(word) for word in words])
    return text.getvalue()


def _harmless(cell: str) -> str:
    """A spreadsheet runs what begins like a formula."""
    return "'" + cell if cell[:1] in ("=", "+", "-", "@") else cell
