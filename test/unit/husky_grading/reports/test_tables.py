"""What marking writes: for people, for programs and other graders, for spreadsheets and browsers."""

import csv
import io
import json
import re
from dataclasses import replace

import pytest
from defusedxml import ElementTree

from husky_grading.notes import Kind, Note, texts
from husky_grading.recording import Recording
from husky_grading.records import Item, MarkingResult, Override
from husky_grading.reports.files import load_result, write_result
from husky_grading.reports.tables import (
    to_csv,
    to_junit,
    to_markdown,
    to_moodle,
    to_result,
)
from husky_grading.settings import with_override
from husky_highlevel_controller.config import ConfigError, load, to_json

ITEMS = (
    Item("drives", 20.0, 20.0, "half of the way after 10.20 s", 10.2),
    Item("arrives", 12.5, 30.0, "stops | <short> & far", 17.0),
    Item("style", None, 30.0, "by hand"),
)
RESULT = MarkingResult(
    "=ann", "--launch ann a.launch", {"seed": 0}, ITEMS, ("<b>package</b> 'x' is missing",)
)
BROKEN = MarkingResult("bob", "", {"seed": 0}, (), (), "it does not build")


def rows_of(text):
    return list(csv.reader(io.StringIO(text)))


def test_a_result_comes_back_from_its_file_and_its_table_has_points_evidence_moment_and_total(tmp_path):
    write_result(RESULT, tmp_path)
    assert load_result(tmp_path / "result.json") == RESULT
    assert json.loads((tmp_path / "result.json").read_text())["points"] == 32.5
    text = str(to_result(RESULT))
    assert max(map(len, text.splitlines())) <= 110
    for line in (
        r"drives +20/20 +half of the way after 10.20 s \[10.20 s\]$",
        r"arrives +12.5/30 ",
        r"total +32.5/50 +and up to 30 by hand$",
    ):
        assert re.search(f"^{line}", text, re.MULTILINE), line


@pytest.mark.parametrize("text", ["", "{}", "[]", "null", '{"start": {"x": 1}}'])
@pytest.mark.parametrize("kind", [MarkingResult, Recording])
def test_what_is_no_result_or_recording_is_an_error_that_names_the_file(kind, text, tmp_path):
    (tmp_path / "made.json").write_text(text)
    with pytest.raises(ConfigError, match=r"made\.json: "):
        load(kind, tmp_path / "made.json")


def test_moodle_gets_what_is_decided_and_not_held_back(tmp_path):
    done = replace(RESULT, name="Ann Lee_4711_assignsubmission_file_", items=ITEMS[:2])
    held = with_override(replace(done, name="Bob"), Override(hold=True))
    heading, *rows = rows_of(to_moodle([RESULT, done, held]))
    (row,) = (dict(zip(heading, row)) for row in rows)
    assert (row["Identifier"], row["Full name"], row["Grade"]) == ("Participant 4711", "Ann Lee", "32.5")
    for result in (done, held):
        write_result(result, tmp_path)
        assert (tmp_path / "feedback.html").exists() is (result is done)
    assert load_result(tmp_path / "result.json").held


def test_full_marks_are_all_that_a_machine_can_give():
    assert not RESULT.full
    assert replace(RESULT, items=(ITEMS[0], ITEMS[2])).full
    assert not BROKEN.full


def test_what_a_submission_calls_itself_reaches_no_terminal():
    hostile = "a\x1b]0;x\x07 \x9b31m \u202e \udc80 \x00 b"
    item = Item(hostile, 1.0, 2.0, hostile)
    result = MarkingResult(hostile, hostile, {}, (item,), (hostile, "x" * 5000), hostile)
    tables = [str(to_result(each)) for each in (result, replace(result, problem=""))]
    for text in (*tables, to_csv([result]), to_json(result), to_junit([result])):
        assert all(letter.isprintable() or letter == "\n" for letter in text)
        text.encode("utf-8")
    ElementTree.fromstring(to_junit([result]))
    assert len(result.notes[1]) < 1100


def test_csv_has_a_line_each_that_a_spreadsheet_reads_as_no_formula():
    late = Item("late", -4.0, 0.0, "10 % of 40 points: a day")
    notes = tuple(texts(Note(Kind.EXCEPTION, f"{number} {'x' * 2000}") for number in range(10_000)))
    heading, broken, row = rows_of(to_csv([BROKEN, RESULT]))
    assert heading == ["submission", "drives", "arrives", "style", "total", "of", "state", "notes"]
    assert row == [
        "'=ann",
        "20",
        "12.5",
        "",
        "32.5",
        "50",
        "to be graded by hand",
        "<b>package</b> 'x' is missing",
    ]
    assert broken == ["bob", "", "", "", "", "", "could not be marked: it does not build", ""], "no zero"
    row = rows_of(to_csv([replace(RESULT, items=(*ITEMS, late), notes=notes)]))[1]
    assert (float(row[4]), float(row[5])) == (-4.0, 28.5), "numbers for a teacher's sum"
    assert len(row[-1]) < 32768
    assert row[-1].endswith("and 9970 more notes")


def test_junit_has_a_case_for_each_item_and_an_error_for_what_could_not_be_marked():
    suite, broken = ElementTree.fromstring(to_junit([RESULT, BROKEN])).findall("testsuite")
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("3", "1", "1")
    cases = suite.findall("testcase")
    assert [case.get("name") for case in cases] == ["drives", "arrives", "style"]
    assert cases[1].find("failure").get("message") == "12.5/30: stops | <short> & far"
    assert cases[2].find("skipped") is not None
    assert broken.get("errors") == "1"


def test_a_table_for_a_browser_is_broken_by_no_text():
    text = to_markdown([RESULT, BROKEN])
    assert "| =ann | 32.5 / 50 | to be graded by hand |" in text
    assert "| bob |  | could not be marked |" in text
    assert "| arrives | 12.5/30 | stops &#124; &#60;short&#62; &#38; far &#91;17.00 s&#93; |" in text
