"""Confidence intervals of paired drives."""

from math import isnan

import numpy as np
import pytest

from husky_evaluation.statistics import bootstrap


def test_the_interval_is_that_of_the_normal_distribution_for_normal_differences():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    mean, low, high = bootstrap(values.tolist())
    half = 1.96 * values.std() / 20.0
    assert mean == pytest.approx(values.mean())
    assert (low, high) == pytest.approx((mean - half, mean + half), abs=0.02)
    assert bootstrap(values.tolist()) == (mean, low, high), "the same every time"


def test_equal_drives_have_no_interval_and_no_drives_none():
    assert bootstrap([0.0, 0.0]) == (0.0, 0.0, 0.0)
    assert all(map(isnan, bootstrap([])))
    assert bootstrap([0.5]).summary("cm", 100.0) == "+50.000 cm [+50.000, +50.000]"
