"""Simulated time against the clock on the wall, with made-up clocks."""

import pytest

from husky_highlevel_controller.simulator.pacing import MAX_LAG, Pacer


@pytest.mark.parametrize(("factor", "wall"), [(1.0, 10.0), (2.0, 5.0), (0.5, 20.0), (0.0, 0.0)])
def test_a_fast_machine_takes_as_long_as_asked(factor, wall):
    now = 100.0
    pacer = Pacer(factor, 0.0, now)
    for step in range(1, 101):
        now += pacer.delay(step * 0.1, now)
    assert now - 100.0 == pytest.approx(wall)


def test_a_hiccup_is_made_up_for():
    pacer = Pacer(1.0, 0.0, 100.0)
    hiccup = 0.9 * MAX_LAG
    assert pacer.lag(1.0, 101.0 + hiccup) is None
    assert pacer.delay(1.0, 101.0 + hiccup) == 0.0
    # no rest until simulated time is where it would be without the hiccup
    assert pacer.delay(2.0, 102.0 - 0.1) == pytest.approx(0.1)


def test_a_machine_too_slow_is_told_the_factor_it_reached():
    assert Pacer(1.0, 5.0, 100.0).lag(6.0, 102.0) == pytest.approx(0.5)
    assert Pacer(3.0, 5.0, 100.0).lag(7.0, 102.0) == pytest.approx(1.0)


def test_after_a_lag_or_a_restart_it_starts_over_instead_of_chasing_lost_time():
    pacer = Pacer(1.0, 0.0, 100.0)
    assert pacer.lag(1.0, 104.0) is not None
    assert pacer.lag(1.1, 104.1) is None
    assert pacer.delay(2.0, 104.0) == pytest.approx(1.0)
    pacer.restart(3.0, 500.0)
    assert pacer.lag(3.1, 500.1) is None
    assert pacer.delay(4.0, 500.0) == pytest.approx(1.0)


def test_as_fast_as_it_goes_never_waits_and_never_complains():
    pacer = Pacer(0.0, 0.0, 100.0)
    for stamp, now in ((1000.0, 100.1), (1000.1, 9999.0)):
        assert pacer.delay(stamp, now) == 0.0
        assert pacer.lag(stamp, now) is None
