"""docs/exercises.md begins with a table: what a sheet says, what to type here, which file answers it."""

import re

import pytest

from husky_highlevel_controller.paths import share_folder

ROOT = share_folder()
DOCS = ROOT / "docs"
TABLE = re.compile(r"\| sheet \|.*?\n\|---.*?\n((?:\|.*\n)+)")


def rows():
    (lines,) = TABLE.findall((DOCS / "exercises.md").read_text())
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines.splitlines()]


def anchors(file):
    """Names by which a link finds a heading, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", file.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_sheet_and_every_tool_has_its_rows():
    sheets = [row[0] for row in rows()]
    for sheet, numbers in (("ENSTA", range(1, 12)), ("ETH", range(1, 8))):
        assert {f"{sheet} {number}" for number in numbers} <= set(sheets)
    text = "\n".join(" ".join(row) for row in rows())
    for tool in (
        "ros-noetic-husky-desktop", "roslaunch", "teleop_twist_keyboard", "rqt_console", "rqt_graph",
        "rqt_multiplot", "Gazebo's window", "volume",
    ):  # fmt: skip
        assert tool in text, tool


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row[0]}: {row[1][:30]}")
def test_each_named_file_is_there(row):
    assert len(row) == 4
    assert row[1]
    assert row[2]
    for target in re.findall(r"\]\(([^)]*)\)", row[3]):
        path, _, anchor = target.partition("#")
        file = (DOCS / path).resolve() if path else DOCS / "exercises.md"
        assert file.is_file(), target
        assert not anchor or anchor in anchors(file), target
    for file in re.findall(r"launch ([\w]+\.launch)", row[2]):
        assert (ROOT / "launch" / file).is_file() or "PACKAGE" in row[2] or "5ro14" in row[2]
