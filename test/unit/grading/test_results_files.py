"""What marking writes: for people, for programs, for spreadsheets and browsers."""

import csv
import io
import json
import re
from dataclasses import replace

import pytest
from defusedxml import ElementTree

from husky_highlevel_controller.config import to_json
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.grading.notes import Kind, Note, texts
from husky_highlevel_controller.grading.records import Item, MarkingResult, Override
from husky_highlevel_controller.grading.reports.files import load_result, write_result
from husky_highlevel_controller.grading.reports.tables import to_csv, to_junit, to_moodle, to_result
from husky_highlevel_controller.grading.settings import with_override

ITEMS = (
    Item("drives", 20.0, 20.0, "half of the way after 10.20 s", 10.2),
    Item("arrives", 12.5, 30.0, "stops <short> & far", 17.0),
    Item("style", None, 30.0, "for a person"),
)
RESULT = MarkingResult(
    "=ann", "--launch ann a.launch", {"seed": 0}, ITEMS, ("<b>package</b> 'x' is missing",)
)


def test_the_table_has_item_points_evidence_moment_and_total():
    lines = str(to_result(RESULT)).splitlines()
    assert any(
        re.search(r"^drives +20/20 +half of the way after 10.20 s \[10.20 s\]$", line) for line in lines
    )
    assert any(re.search(r"^arrives +12.5/30 ", line) for line in lines)
    assert any(re.search(r"^total +32.5/50 +and 30 that a person has to give$", line) for line in lines)
    assert max(map(len, lines)) <= 110


def test_a_late_penalty_is_a_number_for_a_teachers_sum():
    late = Item("late", -4.0, 0.0, "10 % of 40 points: a day")
    row = list(csv.reader(io.StringIO(to_csv([replace(RESULT, items=(*ITEMS, late))]))))[1]
    assert float(row[4]) == -4.0
    assert float(row[5]) == 28.5


def test_moodle_gets_what_is_decided_and_not_held_back(tmp_path):
    done = replace(RESULT, name="Ann Lee_4711_assignsubmission_file_", items=ITEMS[:2])
    held = with_override(replace(done, name="Bob"), Override(hold=True))
    rows = list(csv.DictReader(io.StringIO(to_moodle([RESULT, done, held]))))
    assert [(row["Identifier"], row["Full name"], row["Grade"]) for row in rows] == [
        ("Participant 4711", "Ann Lee", "32.5")
    ]
    write_result(done, tmp_path)
    assert (tmp_path / "feedback.html").exists()
    write_result(held, tmp_path)
    assert not (tmp_path / "feedback.html").exists()
    assert load_result(tmp_path / "result.json").held


def test_full_marks_are_all_that_a_machine_can_give():
    assert not RESULT.full
    assert MarkingResult("a", "", {}, (ITEMS[0], ITEMS[2])).full


def test_what_a_submission_calls_itself_reaches_no_terminal():
    hostile = "a\x1b]0;x\x07 \x9b31m \u202e \udc80 \x00 b"
    item = Item(hostile, 1.0, 2.0, hostile)
    result = MarkingResult(hostile, hostile, {}, (item,), (hostile, "x" * 5000), hostile)
    unmarked = replace(result, problem="")
    for text in (
        str(to_result(result)),
        str(to_result(unmarked)),
        to_csv([result]),
        to_json(result),
        to_junit([result]),
    ):
        assert all(letter.isprintable() or letter == "\n" for letter in text)
        text.encode("utf-8")
    ElementTree.fromstring(to_junit([result]))
    assert len(result.notes[1]) < 1100


def test_a_result_comes_back_from_its_file(tmp_path):
    write_result(RESULT, tmp_path)
    assert load_result(tmp_path / "result.json") == RESULT
    assert json.loads((tmp_path / "result.json").read_text())["points"] == 32.5


@pytest.mark.parametrize("text", ["", "{}", "[]", "null"])
def test_what_is_no_result_is_an_error(text, tmp_path):
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(HuskyError, match=r"result\.json: "):
        load_result(tmp_path / "result.json")


def test_junit_has_a_case_for_each_item():
    (suite,) = ElementTree.fromstring(to_junit([RESULT])).findall("testsuite")
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("3", "1", "1")
    cases = suite.findall("testcase")
    assert [case.get("name") for case in cases] == ["drives", "arrives", "style"]
    assert cases[1].find("failure").get("message") == "12.5/30: stops <short> & far"
    assert cases[2].find("skipped") is not None


def test_a_cell_holds_the_notes_of_a_hand_in_that_makes_thousands():
    notes = texts(Note(Kind.EXCEPTION, f"{number} {'x' * 2000}") for number in range(10_000))
    row = list(csv.reader(io.StringIO(to_csv([replace(RESULT, notes=tuple(notes))]))))[1]
    assert len(row[-1]) < 32768
    assert row[-1].endswith("and 9970 more notes")


def test_csv_has_a_line_each_and_no_formulas():
    rows = list(csv.reader(io.StringIO(to_csv([RESULT, RESULT]))))
    assert rows[0] == ["submission", "drives", "arrives", "style", "total", "of", "state", "notes"]
    assert rows[1] == [
        "'=ann",
        "20",
        "12.5",
        "",
        "32.5",
        "50",
        "for a person",
        "<b>package</b> 'x' is missing",
    ]
    assert len(rows) == 3
