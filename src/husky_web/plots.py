"""Curves tab: errors and speeds of the last half minute as SVG charts.

A chart of viser itself is too narrow, because it takes its width from its tab before the tab is shown.
"""

from __future__ import annotations

from collections import deque
from html import escape
from math import ceil, floor, isnan, log10
from typing import Any, Deque, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import viser

CAPACITY = 1000  # largest number of samples of a curve
WINDOW = 30.0  # [s] time that a chart shows
# [s] time between two points of a drawn curve; more points would not be visible, but would cost time at each
# update
RESOLUTION = 0.4
# [px] width and height of a chart in a window of 1280 px, and space for labels at its four sides
WIDTH, HEIGHT, LEFT, TOP, BOTTOM, RIGHT = 300.0, 130.0, 36.0, 6.0, 18.0, 6.0
# [px] right and lower edge of the area in which the curves are drawn
PLOT_RIGHT, PLOT_BOTTOM = WIDTH - RIGHT, HEIGHT - BOTTOM
TIME_TICKS = ((30, "-30 s", "start"), (20, "-20 s", "middle"), (10, "-10 s", "middle"), (0, "now", "end"))
# a curve may exceed the last tick by this fraction of the distance between two ticks, so that 1.003 m/s needs
# no tick at 1.5 m/s
SLACK = 0.02
LARGEST = 1e9  # values from this size on are not drawn
MAX_MARKS = 8  # largest number of parameter changes that a chart shows
Mark = Tuple[float, str]  # time [s] and text of a change of a parameter


class Chart(NamedTuple):
    """Chart of one quantity."""

    name: str  # name of the chart's curve in `Plots.curves`
    title: str
    unit: str
    series: Tuple[str, ...]  # names of the lines in the chart; the line "commanded" is dashed
    # lowest and highest value that the y axis always contains, so that noise does not look large
    least_range: Tuple[float, float]
    zero: str = ""  # text at the line of the value 0; empty if there is no text


CHARTS = (
    Chart("distance", "distance to go", "m", ("measured",), (0.0, 5.0), "stop_distance"),
    Chart("bearing", "bearing of the pillar", "rad", ("measured",), (-0.5, 0.5)),
    Chart("speed", "forward speed", "m/s", ("commanded", "measured"), (0.0, 1.0)),
    Chart("turning", "turning rate", "rad/s", ("commanded", "measured"), (-0.5, 0.5)),
)


class Curve:
    """The samples of the last `window` seconds."""

    def __init__(self, series: int, window: float = WINDOW) -> None:
        """Begin empty; `series` is the number of values of a sample, without its time."""
        self._window, self._series = window, series
        # time [s] and values of each sample, the newest last
        self._samples: Deque[Tuple[float, ...]] = deque(maxlen=CAPACITY)

    def add(self, stamp: float, *values: float) -> None:
        """Add a sample, unless its time [s] is that of the last sample.

        If the time runs backwards, the earlier samples are dropped.
        """
        samples = self._samples
        if samples and stamp < samples[-1][0]:
            samples.clear()
        if samples and stamp == samples[-1][0]:
            return
        samples.append((stamp, *values))
        while stamp - samples[0][0] > self._window:
            samples.popleft()

    @property
    def arrays(self) -> Tuple[np.ndarray, ...]:
        """Return the times and each series, oldest first; NaN if there was no value."""
        return tuple(np.array(list(self._samples), float).reshape(-1, self._series + 1).T)

    @property
    def rate(self) -> Optional[float]:
        """Return how much the first value of the samples grows per second.

        None if there are fewer than two samples, or if the value has become smaller, for example because the
        simulator was started again.
        """
        if len(self._samples) < 2:
            return None
        oldest, newest = self._samples[0], self._samples[-1]  # each is a time [s] and then the values
        seconds, growth = newest[0] - oldest[0], newest[1] - oldest[1]
        return growth / seconds if growth >= 0.0 else None


class Plots:
    """Charts of the curves, with a line at each change of a parameter."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.curves = {chart.name: Curve(len(chart.series)) for chart in CHARTS}
        self._element = gui.add_html("")
        self._marks: Deque[Mark] = deque(maxlen=MAX_MARKS)

    def mark(self, stamp: float, text: str) -> None:
        """Mark a change of a parameter at a time [s]."""
        self._marks.append((stamp, text))

    def update(self) -> None:
        """Send new charts to the pages."""
        charts = (chart_html(chart, self.curves[chart.name].arrays, list(self._marks)) for chart in CHARTS)
        self._element.content = f'<div class="husky-charts">{"".join(charts)}</div>'


class _Axes(NamedTuple):
    """Axes of a chart; they convert times [s] and values to positions in its picture [px], also in arrays."""

    end: float  # [s] time at the right edge
    low: float  # value at the lower edge
    high: float  # value at the upper edge

    def x(self, time: Any) -> Any:
        """Return the distance of a time from the left edge of the picture."""
        return LEFT + (PLOT_RIGHT - LEFT) * (1.0 + (time - self.end) / WINDOW)

    def y(self, value: Any) -> Any:
        """Return the distance of a value from the upper edge of the picture."""
        return TOP + (PLOT_BOTTOM - TOP) * (self.high - value) / (self.high - self.low)


def chart_html(chart: Chart, arrays: Sequence[np.ndarray], marks: Sequence[Mark] = ()) -> str:
    """Return HTML of a chart of series over time; NaN and values from LARGEST on are gaps.

    Args:
        chart: kind of the chart.
        arrays: times [s], and the values of each series, all (N,).
        marks: changes of parameters.
    """
    times, series = arrays[0], [np.where(np.abs(each) < LARGEST, each, np.nan) for each in arrays[1:]]
    all_values = np.concatenate([chart.least_range, *series])  # the y axis contains all these values
    finite = all_values[np.isfinite(all_values)]
    ticks = nice_ticks(float(finite.min()), float(finite.max()))
    axes = _Axes(float(times[-1]) if len(times) else 0.0, ticks[0], ticks[-1])
    parts = [*_grid(chart, axes, ticks), *_mark_lines(axes, marks)]
    for name, values in zip(chart.series, series):
        parts.append(f'<path class="curve {name}" d="{_path(times, values, axes)}"/>')
    newest = [fixed(values[-1] if len(values) else None, 2) for values in series]
    legend = "".join(
        f'<span><i class="{name}"></i>{name if len(series) > 1 else ""} {value}</span>'
        for name, value in zip(chart.series, newest)
    )
    # text for a screen reader, because it cannot read the curves
    spoken = ", ".join(f"{name} {value}" for name, value in zip(chart.series, newest))
    plot_area = f"{LEFT},{PLOT_RIGHT},{TOP},{PLOT_BOTTOM},{axes.low},{axes.high},{WINDOW}"  # page.js reads it
    return (
        f'<div class="husky-block husky-chart"><div><b>{chart.title}</b> [{chart.unit}]{legend}</div>'
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" aria-label="{chart.title}: {spoken}"'
        f' data-plot="{plot_area}">'
        f"{''.join(parts)}</svg></div>"
    )


def _grid(chart: Chart, axes: _Axes, ticks: Sequence[float]) -> List[str]:
    """Return SVG of the horizontal lines at some values, the vertical lines at some times, and the labels."""
    # Each tick has a line with its number at the left. page.css has a style for the line of the value 0. The
    # texts are shifted by some pixels, so that they do not touch the lines.
    parts = []
    for tick in ticks:
        y, style = axes.y(tick), "grid" if tick else "zero"
        parts.append(
            f'<path class="{style}" d="M{LEFT:.0f},{y:.1f}H{PLOT_RIGHT:.0f}"/>'
            f'<text x="{LEFT - 4.0:.0f}" y="{y + 3.5:.1f}" text-anchor="end">{tick:g}</text>'
        )
    if chart.zero:  # text above the line of the value 0
        parts.append(
            f'<text class="stop" x="{PLOT_RIGHT - 3.0:.0f}" y="{axes.y(0.0) - 3.0:.1f}" text-anchor="end">'
            f"{chart.zero}</text>"
        )
    for age, name, anchor in TIME_TICKS:
        x = axes.x(axes.end - age)
        parts.append(
            f'<path class="grid" d="M{x:.1f},{TOP:.0f}V{PLOT_BOTTOM:.0f}"/>'
            f'<text x="{x:.1f}" y="{HEIGHT - 5.0:.0f}" text-anchor="{anchor}">{name}</text>'
        )
    return parts


def _mark_lines(axes: _Axes, marks: Sequence[Mark]) -> List[str]:
    """Return SVG of a vertical line with a text for each change of a parameter that is in the window."""
    parts = []
    for stamp, text in marks:
        if 0.0 <= axes.end - stamp < WINDOW:
            x = axes.x(stamp)
            # the text is on the side of the line with more space
            anchor, shift = ("start", 3.0) if x < WIDTH / 2.0 else ("end", -3.0)
            parts.append(
                f'<path class="mark" d="M{x:.1f},{TOP:.0f}V{PLOT_BOTTOM:.0f}"/>'
                f'<text class="mark" x="{x + shift:.1f}" y="{TOP + 9.0:.0f}" text-anchor="{anchor}">'
                f"{escape(text)}</text>"
            )
    return parts


def nice_ticks(low: float, high: float) -> List[float]:
    """Return three to six round numbers with equal steps, whose range includes `low` and `high`.

    `low` and `high` may be outside of the range by up to SLACK times the step.
    """
    least_step = (high - low) / 3.0  # a smaller step would need too many numbers
    power = 10.0 ** floor(log10(least_step))
    # smallest round step that is not less than `least_step`; 1e-9 is a tolerance for rounding
    round_steps = [power * factor for factor in (1.0, 2.0, 5.0, 10.0)]
    step = min(each for each in round_steps if each >= least_step * (1.0 - 1e-9))
    first, last = floor(low / step + SLACK), ceil(high / step - SLACK)
    return [round(step * number, 9) for number in range(first, last + 1)]


def _path(times: np.ndarray, values: np.ndarray, axes: _Axes) -> str:
    """Return a curve as the data of an SVG path: the last point in each RESOLUTION, and the newest point.

    Args:
        times: times (N,) [s].
        values: values (N,); NaN is a gap in the curve.
        axes: axes of the chart.
    """
    if len(times) < 3:  # one or two samples do not make a visible curve
        return ""
    # time is divided into intervals of RESOLUTION; (N,) number of the interval of each sample
    intervals = np.floor(times / RESOLUTION)
    # index of the last sample of each interval: the next sample is in another interval, or there is none
    rows = np.append(np.flatnonzero(np.diff(intervals)), len(times) - 1)
    steps: List[str] = []
    command = "M"  # "M" is SVG's command to move to a point without a line; "L" draws a line to a point
    for x, y in zip(axes.x(times[rows]).tolist(), axes.y(values[rows]).tolist()):
        is_gap = isnan(y)
        if not is_gap:
            steps.append(f"{command}{x:.1f},{y:.1f}")
        command = "M" if is_gap else "L"
    return "".join(steps)


def fixed(value: Optional[float], digits: int) -> str:
    """Return a number with `digits` digits after the point, or a dash if unknown; a rounded 0 has no sign."""
    if value is None or value != value:
        return "&ndash;"
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


def choice_html(number: Optional[int]) -> str:
    """Return an invisible element that tells viser.css which button of the next group looks pressed.

    `number` is the number of the button; None if no button of the group looks pressed.
    """
    return f'<i class="husky-choice-{"none" if number is None else number}" hidden></i>'
