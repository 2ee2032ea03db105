"""Curves of the page and the charts that show them."""

import re

import numpy as np
import pytest

from husky_web.plots import CHARTS, Curve, chart_html, fixed, nice_ticks


def test_a_curve_keeps_its_window_and_begins_anew_when_time_runs_backwards():
    curve = Curve(1, window=10.0)
    for second in range(30):
        curve.add(float(second), second / 2.0)
        curve.add(float(second), -1.0)  # the clock stands still
    times, values = curve.arrays
    assert times.tolist() == [float(second) for second in range(19, 30)]
    assert values[-1] == 14.5
    curve.add(0.0, 7.0)
    assert [array.tolist() for array in curve.arrays] == [[0.0], [7.0]]


def test_a_rate_is_the_growth_over_the_last_seconds():
    amounts = Curve(1, window=2.0)
    assert amounts.rate is None
    for second in np.arange(0.0, 10.0, 0.5):
        amounts.add(second, min(50.0 * second, 425.0))
    assert amounts.rate == pytest.approx(25.0)  # from 375 at 7.5 s to 425 at 8.5 s and later
    amounts.add(10.0, 0.0)  # counted anew
    assert amounts.rate is None


@pytest.mark.parametrize("value", [float("nan"), 1.7e308, -1.7e308, 1e12])
def test_a_chart_draws_what_is_no_measurement_as_a_gap_and_survives_nothing(value):
    speed = CHARTS[2]
    times, values = np.arange(5.0), np.array([0.0, 0.1, value, -value, 2.0])
    html = chart_html(speed, (times, values, values))
    curve = re.search(r'class="curve commanded" d="([^"]+)"', html)
    assert re.sub("[0-9.,]", "", curve.group(1)) == "MLM"
    assert len(html) < 5000
    assert 'text-anchor="end">2<' in html
    assert "<svg" in chart_html(speed, (np.zeros(0),) * 3)


def test_a_chart_marks_a_change_of_a_parameter_while_it_is_in_the_window():
    times = np.arange(0.0, 100.0)
    marks = [(50.0, "p_gain_vel 2 > 1"), (90.0, "<p_gain_ang> 2 > 4")]
    html = chart_html(CHARTS[0], (times, times), marks)
    assert "p_gain_vel" not in html
    assert "&lt;p_gain_ang&gt; 2 &gt; 4" in html


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.0, 19.69, [0, 10, 20]),
        (-0.001, 1.003, [0, 0.5, 1.0]),
        (-0.02, 0.25, [-0.1, 0, 0.1, 0.2, 0.3]),
        (0.0, 1.0, [0, 0.5, 1.0]),
    ],
)
def test_ticks_are_round_and_hold_all_values(low, high, ticks):
    assert nice_ticks(low, high) == pytest.approx(ticks)


def test_a_number_that_rounds_to_nothing_has_no_sign():
    assert [fixed(value, 2) for value in (-0.001, 0.0, -0.01, 1.005, -12.0)] == [
        "0.00", "0.00", "-0.01", "1.00", "-12.00",
    ]  # fmt: skip


def test_a_chart_keeps_its_range_before_a_robot_that_stands_and_names_the_line_where_it_is_to_stop():
    times = np.arange(10.0)
    html = {chart.name: chart_html(chart, (times, *[0.0 * times] * len(chart.series))) for chart in CHARTS}
    for name, low, high in (
        ("distance", 0, 6),
        ("bearing", -0.5, 0.5),
        ("speed", 0, 1),
        ("turning", -0.5, 0.5),
    ):
        assert f'text-anchor="end">{low:g}<' in html[name], name
        assert f'text-anchor="end">{high:g}<' in html[name], name
    assert [name for name in html if ">stop_distance<" in html[name]] == ["distance"]
