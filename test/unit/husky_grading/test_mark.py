"""Marking of one hand-in: it has a result whatever goes wrong."""

import pytest

from husky_grading import mark as mark_module
from husky_grading.mark import mark
from husky_grading.records import Job, MarkingConfig
from husky_highlevel_controller.datatypes import HuskyError


@pytest.mark.parametrize(
    ("error", "problem"),
    [(TimeoutError(), "TimeoutError"), (HuskyError(), "HuskyError"), (OSError(), "OSError")],
    ids=["TimeoutError", "HuskyError", "OSError"],
)
def test_an_error_without_a_text_is_told_by_its_name(error, problem, tmp_path, monkeypatch):
    def fail(*_):
        raise error

    monkeypatch.setattr(mark_module, "prepare", fail)
    result = mark(Job("ann", str(tmp_path / "ann"), MarkingConfig(), hand_in=str(tmp_path)))
    assert result.problem == problem
