"""Results of marking as every command's result, as Markdown, JUnit XML and CSV."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import Sequence

from husky_grading.records import Item, MarkingResult, ResultState
from husky_highlevel_controller.result import Result, Table


def points(item: Item) -> str:
    """Return the points of an item as text, such as 12.5/20, or -/20 if the item is graded by hand."""
    given = "-" if item.points is None else f"{item.points:g}"
    return f"{given}/{item.max_points:g}"


def to_result(marking: MarkingResult) -> Result:
    """Return a marking in the form in which every command prints its result: tables and a verdict."""
    rows = []
    for item in marking.items:
        evidence = item.evidence
        if item.at is not None:
            evidence += f" [{item.at:.2f} s]"
        if item.hint:
            evidence += f"\nhint: {item.hint}"
        rows.append((item.name, points(item), evidence))
    # largest sum of points that a person may still give
    by_hand = sum(item.max_points for item in marking.items if item.points is None)
    left = f"and up to {by_hand:g} by hand" if by_hand else ""
    total = ("total", f"{marking.points:g}/{marking.max_points:g}", left)
    tables = []
    if rows:
        tables.append(Table("", ("item", "points", "evidence"), [*rows, total]))
    if marking.notes:
        tables.append(Table("Notes", ("",), [[note] for note in marking.notes]))
    verdict = f"could not be marked: {marking.problem}" if marking.problem else ""
    # the graded launch file or node is named above the table, unless the title already names it
    lead = marking.what if marking.what != marking.name else ""
    return Result(marking.name, lead, tables, verdict, failed=not marking.full)


def to_markdown(results: Sequence[MarkingResult]) -> str:
    """Return Markdown for $GITHUB_STEP_SUMMARY: a table of all results, then the items of each."""
    rows = [
        (each.name, "" if each.problem else f"{each.points:g} / {each.max_points:g}", each.state.value)
        for each in results
    ]
    overview = Table("", ("student", "points", "state"), rows).to_markdown()
    return "\n\n".join([overview, *(to_result(each).to_markdown() for each in results)]) + "\n"


def to_junit(results: Sequence[MarkingResult]) -> str:
    """Return JUnit XML: a suite for each submission, a case for each item, a failure if points are lost."""
    root = ET.Element("testsuites")
    for result in results:
        items = result.items
        suite = ET.SubElement(
            # a submission that could not be marked has one more test case, for its problem
            root, "testsuite", name=result.name, tests=str(len(items) + bool(result.problem)),
            errors=str(int(bool(result.problem))),
            # `full` is also true for an item that is graded by hand, so this item does not count
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


def to_csv(results: Sequence[MarkingResult]) -> str:
    """Return CSV with a line for each submission and a column for each item."""
    # names of all items, each once; these are the columns
    names = list(dict.fromkeys(item.name for result in results for item in result.items))
    rows = []
    for result in results:
        # an item without points, or which the student does not have, gets an empty cell
        points_by_name = {item.name: item.points for item in result.items}
        marks = ["" if points_by_name.get(name) is None else f"{points_by_name[name]:g}" for name in names]
        total = ["", ""] if result.problem else [f"{result.points:g}", f"{result.max_points:g}"]
        state = f"{result.state.value}: {result.problem}" if result.problem else result.state.value
        rows.append([result.name, *marks, *total, state, " | ".join(result.notes)])
    return Table("", ["submission", *names, "total", "of", "state", "notes"], rows).to_csv()


# pattern of the name of a student's folder in an archive from Moodle; the groups are the student's name and
# number
MOODLE = re.compile(r"^(.+)_(\d+)_assignsubmission_")


def to_moodle(results: Sequence[MarkingResult]) -> str:
    """Return Moodle's grading worksheet: a line for each result that is complete.

    A result that the teacher holds back has no line, because its student gets no feedback yet.
    """
    rows = []
    for result in results:
        if result.state is ResultState.MARKED and not result.held:
            identifier, full_name = "", result.name
            # a folder in Moodle's archive is named after the student's name and number
            match = MOODLE.match(result.name)
            if match:
                full_name, identifier = match[1], f"Participant {match[2]}"
            marks = [f"{result.points:g}", f"{result.max_points:g}"]
            comments = "; ".join(f"{item.name} {points(item)}: {item.evidence}" for item in result.items)
            rows.append([identifier, full_name, *marks, comments])
    header = ["Identifier", "Full name", "Grade", "Maximum Grade", "Feedback comments"]
    return Table("", header, rows).to_csv()
