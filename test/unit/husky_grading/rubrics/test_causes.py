"""Causes of lost points: what ended well is not blamed for what others do."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from drives import GOOD

from husky_grading.notes import Kind, Note
from husky_grading.rubrics.causes import SILENT, causes, first_cause, hint_on

ENDED = Note(Kind.NODE_ENDED, "node set_up ends during the run (exit code 0)")


@pytest.mark.parametrize(("silence", "blamed"), [(0.0, []), (SILENT + 1.0, [ENDED])])
def test_a_helper_that_ends_is_not_blamed_at_the_deadline_while_commands_come(silence, blamed):
    end = Note(Kind.DEADLINE, "the time is over")
    commands = np.arange(0.02, GOOD.times[-1] - silence, 0.02)
    assert causes(replace(GOOD, notes=(ENDED,), ended=end, commands=commands)) == blamed


def test_commands_that_are_no_numbers_are_named():
    cause = first_cause(replace(GOOD, subscribed=True, command_count=50, fastest=inf, sharpest=0.2))
    assert cause.text == "it sends commands that the robot refuses: NaN, infinite, or not a Twist"
    assert "division by 0" in hint_on(cause)
