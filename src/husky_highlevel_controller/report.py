"""Writes results down: a table to read, JSON, JUnit XML, CSV, and one page with every picture.

In: `Result`s. Out: text. Must not know: ROS, how anything is judged, where files are.
"""

from __future__ import annotations

import base64
import csv
import io
import json
import textwrap
import xml.etree.ElementTree as ET
from dataclasses import asdict, dataclass
from html import escape
from typing import Any, Dict, Optional, Sequence, Tuple

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading import Item, total

WIDTH = 110  # letters of the table


@dataclass(frozen=True)
class Result:
    """What somebody gets."""

    name: str
    what: str  # the launch file or node
    settings: Dict[str, Any]  # exercise, seed and what else is the same for everybody
    items: Tuple[Item, ...]
    notes: Tuple[str, ...] = ()  # what went wrong, in sentences

    @property
    def points(self) -> float:
        """All of them."""
        return total(self.items)[0]

    @property
    def most(self) -> float:
        """That a machine can give."""
        return total(self.items)[1]

    @property
    def full(self) -> bool:
        """Everything that a machine can give."""
        return all(item.full for item in self.items)


def points(item: Item) -> str:
    """Points of an item, in words."""
    return f"{'-' if item.points is None else f'{item.points:g}'}/{item.most:g}"


def table(result: Result) -> str:
    """To be read on a terminal."""
    name = max(len(item.name) for item in result.items) + 2
    lines = [f"{result.name}  ({result.what})" if result.name != result.what else result.name, ""]
    for item in result.items:
        moment = f" [{item.at:.2f} s]" if item.at is not None else ""
        indent = " " * (name + 10)
        evidence = textwrap.wrap(item.evidence + moment, WIDTH - len(indent)) or [""]
        lines.append(f"{item.name:<{name}}{points(item):>8}  {evidence[0]}")
        lines += [indent + line for line in evidence[1:]]
    lines += ["", f"{'total':<{name}}{f'{result.points:g}/{result.most:g}':>8}"]
    by_hand = sum(item.most for item in result.items if item.points is None)
    if by_hand:
        lines[-1] += f"  and {by_hand:g} that a person has to give"
    lines += [line for note in result.notes for line in textwrap.wrap(f"note: {note}", WIDTH)]
    return "\n".join(lines)


def to_json(result: Result) -> str:
    """Everything, for programs, and to read it again."""
    content = asdict(result)
    content.update(points=result.points, most=result.most, full=result.full)
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
        return Result(content["name"], content["what"], content["settings"], items, notes)
    except (ValueError, TypeError, KeyError) as error:
        raise HuskyError(f"not a result: {error}") from error


def to_junit(results: Sequence[Result]) -> str:
    """JUnit XML: a suite for each submission, a case for each item; full marks or a failure."""
    root = ET.Element("testsuites")
    for result in results:
        items = result.items
        suite = ET.SubElement(
            root, "testsuite", name=_printable(result.name), tests=str(len(items)), errors="0",
            failures=str(sum(not item.full for item in items)),
            skipped=str(sum(item.points is None for item in items)),
        )  # fmt: skip
        for item in items:
            case = ET.SubElement(suite, "testcase", name=item.name, classname=_printable(result.name))
            words = _printable(f"{points(item)}: {item.evidence}")
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
    if results:
        writer.writerow(["submission", *(item.name for item in results[0].items), "total", "of", "notes"])
    for result in results:
        marks = ["" if item.points is None else f"{item.points:g}" for item in result.items]
        words = [result.name, *marks, f"{result.points:g}", f"{result.most:g}", " | ".join(result.notes)]
        writer.writerow([_harmless(word) for word in words])
    return text.getvalue()


def _harmless(cell: str) -> str:
    """A spreadsheet runs what begins like a formula."""
    cell = _printable(cell)
    return "'" + cell if cell[:1] in ("=", "+", "-", "@") else cell


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else " " for letter in text)


_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 1100px; padding: 0 1em }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; padding: .3em .6em; border-bottom: 1px solid #ddd; vertical-align: top }
td.points { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums }
.full { background: #e3f4e3 } .some { background: #fdf3d7 } .none { background: #fbe0de }
.hand { color: #777 }
section { margin-top: 2.5em } img { max-width: 100%; border: 1px solid #ddd; margin-top: .6em }
.note { color: #8a3a00; margin: .3em 0 }
"""


def to_html(results: Sequence[Result], pictures: Dict[str, Sequence[bytes]]) -> str:
    """One page that needs no other file.

    Args:
        results: of everybody.
        pictures: PNGs of each name.
    """
    body = ["<h1>Marking</h1>"]
    if results:
        settings = ", ".join(
            f"{key} {value}" for key, value in results[0].settings.items() if value is not None
        )
        body.append(f"<p>{len(results)} submissions; {escape(settings)}</p>")
        heads = "".join(f"<th>{escape(item.name)}</th>" for item in results[0].items)
        body.append(f"<table><tr><th>submission</th>{heads}<th>total</th></tr>")
        for number, result in enumerate(results):
            cells = "".join(_cell(item.points, item.most) for item in result.items)
            link = f'<a href="#s{number}">{escape(result.name)}</a>'
            body.append(f"<tr><td>{link}</td>{cells}{_cell(result.points, result.most)}</tr>")
        body.append("</table>")
    for number, result in enumerate(results):
        body.append(
            f'<section id="s{number}"><h2>{escape(result.name)}</h2><p>{escape(result.what)}</p><table>'
        )
        for item in result.items:
            moment = "" if item.at is None else f"{item.at:.2f}&nbsp;s"
            body.append(
                f"<tr><td>{escape(item.name)}</td>{_cell(item.points, item.most)}"
                f"<td>{escape(item.evidence)}</td><td>{moment}</td></tr>"
            )
        body.append("</table>")
        body += [f'<p class="note">{escape(note)}</p>' for note in result.notes]
        for picture in pictures.get(result.name, ()):
            data = base64.b64encode(picture).decode()
            body.append(f'<img alt="{escape(result.name)}" src="data:image/png;base64,{data}">')
        body.append("</section>")
    page = "\n".join(body)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>Marking</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n{page}\n</body></html>\n"
    )


def _cell(given: Optional[float], most: float) -> str:
    if given is None:
        return '<td class="points hand">by hand</td>'
    kind = "full" if given >= most - 1e-9 else "some" if given > 0.0 else "none"
    return f'<td class="points {kind}">{given:g} / {most:g}</td>'
