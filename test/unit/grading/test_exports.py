"""Results as Gradescope, Classroom 50 and GitHub take them."""

import json

from husky_highlevel_controller.grading.records import Item, MarkingResult
from husky_highlevel_controller.grading.reports.exports import (
    CLASSROOM50_FIELDS,
    to_classroom50,
    to_gradescope,
    write_exports,
)
from husky_highlevel_controller.grading.reports.tables import to_markdown

ITEMS = (
    Item("drives", 20.0, 20.0, "half of the way after 10.20 s", 10.2),
    Item("arrives", 12.5, 30.0, "stops | <short>"),
    Item("style", None, 30.0, "for a person"),
)
RESULT = MarkingResult("ann", "a.launch", {"seed": 0}, ITEMS, ("package 'x' is missing",))
BROKEN = MarkingResult("bob", "", {"seed": 0}, (), (), "it does not build")


def test_gradescope_has_a_test_for_each_item_and_no_score_where_a_person_gives_it():
    content = json.loads(to_gradescope(RESULT))
    assert content["score"] == 32.5
    assert [test.get("score") for test in content["tests"]] == [20.0, 12.5, None]
    assert [test.get("max_score") for test in content["tests"]] == [20.0, 30.0, None]
    assert [test.get("status") for test in content["tests"]] == ["passed", "failed", None]
    assert "package 'x' is missing" in content["output"]
    unmarked = json.loads(to_gradescope(BROKEN))
    assert "could not be marked: it does not build" in unmarked["output"]
    assert "score" not in unmarked


def test_what_could_not_be_marked_leaves_no_score_of_an_earlier_marking(tmp_path):
    for result in (RESULT, BROKEN):
        write_exports(result, tmp_path)
        scores = [path for path in tmp_path.glob("*/*.json") if "score" in json.loads(path.read_text())]
        assert len(scores) == (2 if result is RESULT else 0)


def test_classroom_50_gets_whole_numbers_that_add_up_and_the_runner_s_names():
    variables = {name: f"the {field}" for field, name in CLASSROOM50_FIELDS.items()}
    content = json.loads(to_classroom50(RESULT, variables, "2026-06-01T14:32:01Z"))
    assert content["schema"] == "classroom50/result/v1"
    assert all(content[field] == f"the {field}" for field in CLASSROOM50_FIELDS)
    assert content["datetime"] == "2026-06-01T14:32:01Z"
    assert [(test["test-name"], test["passed"]) for test in content["tests"]] == [
        ("drives", True),
        ("arrives", False),
    ]
    assert all(type(test[key]) is int for test in content["tests"] for key in ("score", "max-score"))
    assert content["score"] == sum(test["score"] for test in content["tests"]) == 32
    assert content["max-score"] == 50


def test_the_review_is_the_commit_where_the_runner_names_none():
    assert json.loads(to_classroom50(RESULT, {"COMMIT_URL": "c"}, ""))["review"] == "c"


def test_the_step_summary_is_a_table_that_no_text_breaks():
    text = to_markdown([RESULT, BROKEN])
    assert "| ann | 32.5 / 50 | for a person |" in text
    assert "| bob |  | could not be marked |" in text
    assert "| arrives | 12.5/30 | stops &#124; &#60;short&#62; |" in text
