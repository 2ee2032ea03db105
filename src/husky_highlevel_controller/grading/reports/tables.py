"""Tables of results: text for a terminal, JUnit XML, CSV."""

from __future__ import annotations

import csv
import io
import re
import textwrap
import xml.etree.ElementTree as ET
from typing import Sequence

from husky_highlevel_controller.grading.records import Item, Result, ResultState

WIDTH = 110  # letters of the table


def points(item: Item) -> str:
    """Points of an item, as text."""
    return f"{'-' if item.points is None else f'{item.points:g}'}/{item.max_points:g}"


def table(result: Result) -> str:
    """Table of a result, for a terminal."""
    notes = [line for note in result.notes for line in textwrap.wrap(f"note: {note}", WIDTH)]
    if result.problem:
        lines = textwrap.wrap(f"{result.name}: could not be marked: {result.problem}", WIDTH)
        return "\n".join(lines + notes)
    name = max(len(item.name) for item in result.items) + 2
    lines = [f"{result.name}  ({result.what})" if result.name != result.what else result.name, ""]
    for item in result.items:
        moment = f" [{item.at:.2f} s]" if item.at is not None else ""
        indent = " " * (name + 10)
        evidence = textwrap.wrap(item.evidence + moment, WIDTH - len(indent)) or [""]
        lines.append(f"{item.name:<{name}}{points(item):>8}  {evidence[0]}")
        lines += [indent + line for line in evidence[1:]]
        if item.hint:
            lines += [indent + line for line in textwrap.wrap(f"look at: {item.hint}", WIDTH - len(indent))]
    lines += ["", f"{'total':<{name}}{f'{result.points:g}/{result.max_points:g}':>8}"]
    by_hand = sum(item.max_points for item in result.items if item.points is None)
    if by_hand:
        lines[-1] += f"  and {by_hand:g} that a person has to give"
    return "\n".join(lines + notes)


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
            evidence = f"{points(item)}: {item.evidence}"
            if item.points is None:
                ET.SubElement(case, "skipped", message=evidence)
            elif not item.full:
                ET.SubElement(case, "failure", message=evidence)
            else:
                ET.SubElement(case, "system-out").text = evidence
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def to_csv(results: Sequence[Result]) -> str:
    """A line for each submission, a column for each item."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = list(dict.fromkeys(item.name for result in results for item in result.items))
    writer.writerow(["submission", *names, "total", "of", "state", "notes"])
    for result in results:
        points_by_name = {item.name: item.points for item in result.items}
        marks = ["" if points_by_name.get(name) is None else f"{points_by_name[name]:g}" for name in names]
        total = ["", ""] if result.problem else [f"{result.points:g}", f"{result.max_points:g}"]
        state = result.state.value + f": {result.problem}" * bool(result.problem)
        notes = _harmless(" | ".join(result.notes))
        writer.writerow([_harmless(result.name), *marks, *total, _harmless(state), notes])
    return text.getvalue()


# name of a folder that Moodle packs: student and number
MOODLE = re.compile(r"^(.+)_(\d+)_assignsubmission_")


def to_moodle(results: Sequence[Result]) -> str:
    """Moodle's grading worksheet: a line for each result that is decided as a whole and not held back."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["Identifier", "Full name", "Grade", "Maximum Grade", "Feedback comments"])
    for result in results:
        if result.state is ResultState.MARKED and not result.held:
            name = MOODLE.match(result.name)
            identifier = f"Participant {name[2]}" if name else ""
            comments = "; ".join(f"{item.name} {points(item)}: {item.evidence}" for item in result.items)
            marks = [f"{result.points:g}", f"{result.max_points:g}"]
            student = _harmless(name[1] if name else result.name)
            writer.writerow([identifier, student, *marks, _harmless(comments)])
    return text.getvalue()


def _harmless(cell: str) -> str:
    """A text that no spreadsheet runs as a formula."""
    return "'" + cell if cell[:1] in ("=", "+", "-", "@") else cell
