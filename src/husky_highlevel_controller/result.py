"""Result of a command, in evaluation and in marking: tables and a verdict, as text, as Markdown or in a file.

In: values. Out: text by `str`, Markdown, CSV, Parquet; by `config.to_json` a file that `config.load` reads.
Results with the same values are equal, also if one has lists and the other tuples.
"""

from __future__ import annotations

import csv
import io
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any, List, Mapping, NamedTuple, Sequence

PARAMETERS = ".6g"  # number format of a table of parameters, whose values may be far below 0.001
WIDTH = 110  # largest number of characters of a line
# smallest number of characters of a wrapped column, even if the line then becomes longer than WIDTH
MIN_WRAPPED = 30
# pattern of a text that a spreadsheet runs as a formula; a negative number is not a formula
FORMULA = re.compile(r"[=+@\t\r]|-(?!\d[\d.]*$)")
# HTML code for each character that has a meaning in Markdown or HTML
ENTITIES = {ord(letter): f"&#{ord(letter)};" for letter in "\\`*_{}[]<>#|!~&"}


class Cell(NamedTuple):
    """Cell of a table."""

    value: Any
    style: str = ""  # style of the cell: "ok", "missed" or ""
    link: str = ""  # address of the page to which the cell links


@dataclass(frozen=True)
class Table:
    """Table of a result; a cell may be a `Cell` or a plain value."""

    title: str
    header: Sequence[str]  # names of the columns; not printed if all are empty
    rows: Sequence[Sequence[Any]]
    folded: bool = False  # true if the table is shown only on the web page, and not in the text
    # format of the numbers in the text
    number_format: str = ".3f"

    def __post_init__(self) -> None:
        """Turn lists into tuples, so that a table from a JSON file equals the table that was written.

        A list inside a row was a `Cell`.
        """
        rows = []
        for row in self.rows:
            rows.append(tuple(Cell(*entry) if isinstance(entry, list) else entry for entry in row))
        # the record is frozen, so its fields are set in this way
        object.__setattr__(self, "rows", tuple(rows))
        object.__setattr__(self, "header", tuple(self.header))

    @property
    def cells(self) -> List[List[Cell]]:
        """Return the rows, in which each plain value has become a `Cell`."""
        return [[entry if isinstance(entry, Cell) else Cell(entry) for entry in row] for row in self.rows]

    @property
    def values(self) -> List[List[Any]]:
        """Return the rows with the plain values of their cells, without styles and links."""
        return [[cell.value for cell in row] for row in self.cells]

    def __str__(self) -> str:
        """Return the title and aligned columns as text, with numbers to the right.

        The texts of the last column are wrapped, so that a line has at most WIDTH characters.
        """
        columns = list(zip(self.header, *self.values))
        # for each column: whether it has a number, and the number of characters of its longest text
        are_numbers = [any(type(value) in (int, float) for value in column) for column in columns]
        widths = [max(len(self._text(value)) for value in column) for column in columns]
        # position at which the last column begins, because two spaces follow each column before it
        indent = sum(widths[:-1]) + 2 * len(widths[:-1])
        last_width = max(WIDTH - indent, MIN_WRAPPED)
        lines = [self.title] if self.title else []
        # a header of empty names is not printed
        rows = [self.header, *self.values] if any(self.header) else self.values
        for row in rows:
            *texts, last = map(self._text, row)
            last_lines: List[str] = []
            for line in last.split("\n"):
                last_lines += textwrap.wrap(line, last_width) or [""]  # `wrap` drops an empty line
            # the first line of the last column stands beside the other columns, its other lines stand below
            aligned = []
            for text, width, is_number in zip([*texts, last_lines[0]], widths, are_numbers):
                aligned.append(text.rjust(width) if is_number else text.ljust(width))
            lines.append("  ".join(aligned).rstrip())
            lines += [" " * indent + line for line in last_lines[1:]]
        return "\n".join(lines)

    def to_markdown(self) -> str:
        """Return a table of Markdown, in which special characters are escaped so that they are shown."""
        # header, then the line of dashes that Markdown asks for, then the rows
        rows = [self.header, ["---"] * len(self.header), *(map(self._text, row) for row in self.values)]
        return "\n".join(f"| {' | '.join(map(plain_markdown, row))} |" for row in rows)

    def to_csv(self) -> str:
        """Return header and rows as CSV.

        A text that a spreadsheet would run as a formula gets an apostrophe before it.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(map(_harmless, row) for row in self.values)
        return text.getvalue()

    def write(self, path: Path) -> List[Path]:
        """Write PATH.csv, and PATH.parquet if pyarrow is installed; return both paths or one."""
        files = [path.with_suffix(".csv"), path.with_suffix(".parquet")]
        files[0].write_text(self.to_csv(), encoding="utf-8")
        try:
            from pyarrow import Table as Columns
            from pyarrow import parquet
        except ImportError:
            return files[:1]
        # `values` has plain values and no `Cell`, as pyarrow needs
        columns = map(list, zip(*self.values))
        parquet.write_table(Columns.from_pydict(dict(zip(self.header, columns))), files[1])
        return files

    def _text(self, value: Any) -> str:
        """Return a value as text; numbers that are not whole numbers have the format of this table."""
        return format(value, self.number_format) if isinstance(value, float) else str(value)


def every_row(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return a folded table of one or more rows; the keys, which are the same in all rows, are its header."""
    return Table(title, list(rows[0]), [list(row.values()) for row in rows], folded=True)


@dataclass(frozen=True)
class Result:
    """Result of a command: tables and a verdict."""

    title: str
    lead: str  # sentence below the title
    tables: Sequence[Table]
    verdict: str = ""
    failed: bool = False  # true if the result is bad, so that the exit code is 1
    source: str = ""  # sentence with the machines, the versions, and a hash of the runs

    def __post_init__(self) -> None:
        """Turn the tables into a tuple, so that a result from a JSON file equals the one that was written."""
        object.__setattr__(self, "tables", tuple(self.tables))

    def __str__(self) -> str:
        """Return title, lead, the tables that are not folded, and the verdict as text, wrapped at WIDTH."""
        shown = [str(table) for table in self.tables if not table.folded]
        lead, verdict = textwrap.fill(self.lead, WIDTH), textwrap.fill(self.verdict, WIDTH)
        parts = [self.title, lead, *shown, verdict]
        return "\n\n".join(part for part in parts if part)

    def to_markdown(self) -> str:
        """Return a section of Markdown with all parts of the result."""
        parts = [f"### {plain_markdown(self.title)}", plain_markdown(self.lead)]
        for table in self.tables:
            parts += [plain_markdown(table.title), table.to_markdown()]
        parts.append(plain_markdown(self.verdict))
        return "\n\n".join(part for part in parts if part)


def plain_markdown(text: str) -> str:
    """Text on one line, escaped so that Markdown and HTML show it unchanged."""
    return " ".join(text.split()).translate(ENTITIES)


def _harmless(value: Any) -> Any:
    """Return a value for a CSV file; a text that a spreadsheet would run gets an apostrophe before it."""
    return f"'{value}" if isinstance(value, str) and FORMULA.match(value) else value
