"""Files of a student's result: what an earlier result has left goes."""

import json
from dataclasses import replace

from test_tables import BROKEN, RESULT

from husky_grading.reports.files import load_result, write_result


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
