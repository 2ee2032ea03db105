"""Writes down what many drives came to: tables for programs, a page for people.

In: rows, pictures. Out: CSV, Parquet, HTML.
"""

from __future__ import annotations

import csv
from base64 import b64encode
from html import escape
from pathlib import Path
from typing import Any, List, Mapping, Sequence

Rows = Sequence[Mapping[str, Any]]
HEAD = (
    '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>'
    "body{{font-family:sans-serif;margin:2em}}td,th{{padding:.1em .8em;text-align:right}}"
    "img{{max-width:100%}}"
    "</style></head><body><h1>{title}</h1>"
)


def write_table(rows: Rows, path: Path) -> List[Path]:
    """Write PATH.csv, and PATH.parquet where pyarrow is installed; the files written."""
    with path.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    try:
        from pyarrow import Table, parquet
    except ImportError:
        return [path.with_suffix(".csv")]
    parquet.write_table(Table.from_pylist([dict(row) for row in rows]), path.with_suffix(".parquet"))
    return [path.with_suffix(".csv"), path.with_suffix(".parquet")]


def write_page(path: Path, title: str, words: str, rows: Rows, pictures: Sequence[bytes]) -> None:
    """Write a page with everything in it: text, PNG pictures, a table of rows."""
    parts = [HEAD.format(title=escape(title)), f"<pre>{escape(words)}</pre>"]
    parts += [f'<p><img alt="" src="data:image/png;base64,{b64encode(p).decode()}"></p>' for p in pictures]
    if rows:
        cells = ["".join(f"<th>{escape(name)}</th>" for name in rows[0])]
        cells += ["".join(f"<td>{escape(_word(cell))}</td>" for cell in row.values()) for row in rows]
        parts.append(f"<table>{''.join(f'<tr>{line}</tr>' for line in cells)}</table>")
    path.write_text("\n".join([*parts, "</body></html>\n"]))


def _word(cell: Any) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)
