"""Records of marking: a job that another machine reads has settings that are in range."""

from dataclasses import replace

import pytest
from packages import put

from husky_grading.records import Job, printable
from husky_highlevel_controller.config import ConfigError, load, to_json


@pytest.mark.parametrize(
    "setting", [{"trials": -3}, {"pace": 0.0}, {"robot": "xy"}, {"deadline": float("nan")}, {"seed": -1}]
)
def test_a_setting_of_a_job_that_is_out_of_range_is_named(job, setting, tmp_path):
    wrong = put(tmp_path / "job.json", to_json(replace(job, config=replace(job.config, **setting))))
    with pytest.raises(ConfigError, match=f"config/{next(iter(setting))} = "):
        load(Job, wrong)


@pytest.mark.parametrize(
    ("text", "shown"), [("a\nb", "a b"), ("\udc80", "\\x80"), ("\ud800", "\\ud800"), ("\u00fc", "\u00fc")]
)
def test_a_text_of_a_submission_is_printable_whatever_it_has(text, shown):
    assert printable(text) == shown
