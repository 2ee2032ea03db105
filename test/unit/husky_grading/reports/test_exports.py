"""Results for teaching platforms, Gradescope and Classroom 50, and what an earlier result has left."""

import json
from dataclasses import replace

from test_tables import BROKEN, RESULT

from husky_grading.reports import exports
from husky_grading.reports.files import load_result, write_result


def test_gradescope_has_a_test_for_each_item_and_no_score_where_a_person_gives_it():
    content = json.loads(exports.to_gradescope(RESULT))
    assert content["score"] == 32.5
    scores = [(test.get("score"), test.get("max_score"), test.get("status")) for test in content["tests"]]
    assert scores == [(20.0, 20.0, "passed"), (12.5, 30.0, "failed"), (None, None, None)]
    assert "package</b> 'x' is missing" in content["output"]
    unmarked = json.loads(exports.to_gradescope(BROKEN))
    assert "could not be marked: it does not build" in unmarked["output"]
    assert "score" not in unmarked


def test_classroom_50_gets_whole_numbers_that_add_up_and_the_runner_s_names():
    fields = exports.CLASSROOM50_FIELDS
    variables = {name: f"the {field}" for field, name in fields.items()}
    content = json.loads(exports.to_classroom50(RESULT, variables, "2026-06-01T14:32:01Z"))
    assert (content["schema"], content["datetime"]) == ("classroom50/result/v1", "2026-06-01T14:32:01Z")
    assert all(content[field] == f"the {field}" for field in fields)
    passed = [(test["test-name"], test["passed"]) for test in content["tests"]]
    assert passed == [("drives", True), ("arrives", False)]
    assert all(type(test[key]) is int for test in content["tests"] for key in ("score", "max-score"))
    assert content["score"] == sum(test["score"] for test in content["tests"]) == 32
    assert content["max-score"] == 50
    only_commit = json.loads(exports.to_classroom50(RESULT, {"COMMIT_URL": "c"}, ""))
    assert only_commit["review"] == "c", "where the runner names none"


def test_what_could_not_be_marked_leaves_no_score_of_an_earlier_marking(tmp_path):
    for result in (RESULT, BROKEN):
        write_result(result, tmp_path)
        scores = [path for path in tmp_path.glob("*/*.json") if "score" in json.loads(path.read_text())]
        assert len(scores) == (2 if result is RESULT else 0)
        assert load_result(tmp_path / "result.json") == result


def test_feedback_that_is_held_is_not_there_and_comes_back(tmp_path):
    for held in (False, True, False):
        write_result(replace(RESULT, held=held), tmp_path)
        assert (tmp_path / "feedback.html").exists() is not held
