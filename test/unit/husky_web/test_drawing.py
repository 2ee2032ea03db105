"""What is drawn in the scene, and what is left out."""

from math import dist

import numpy as np
import pytest

from husky_web import drawing
from husky_web.drawing import DASH, dashes


def test_an_item_that_cannot_be_shown_is_left_out_with_one_warning(monkeypatch):
    warnings = []
    monkeypatch.setattr(drawing.rospy, "logwarn", warnings.append)
    for _ in range(3):
        with drawing.on_error_log_and_skip("/markers"):
            drawing.rgb((float("nan"), 0.0, 0.0, 1.0))
    assert warnings == ["/markers is not shown: ValueError: cannot convert float NaN to integer"]


def test_dashes_stay_while_the_end_comes_nearer():
    long, short = (dashes((0.0, 0.0, 0.0), (length, 0.0, 0.0)) for length in (4.0, 2.1))
    assert np.array_equal(long[: len(short)], short)
    assert [dist(*dash) for dash in long] == pytest.approx([DASH] * len(long), abs=1e-6)
    assert len(dashes((1.0, 1.0, 0.0), (1.0, 1.0, 0.0))) == 0
