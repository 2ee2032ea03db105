"""The tab of curves: errors, speeds and turning rates of the last half minute, as SVG.

A chart of viser's own takes its width from its tab before the tab is shown, and stays as narrow as a letter.
"""

from __future__ import annotations

from typing import Any, Dict, List, Sequence, Tuple

import numpy as np
import viser

from husky_highlevel_controller.ros.web.curves import Curve, fixed

COLORS = ("#2b86d9", "#e07b00")
RESOLUTION = 0.2  # [s] between two points of a curve: more are not seen, and are sent again and again
WIDTH, HEIGHT = 300.0, 110.0  # of a chart's own units
PLOTS: Dict[str, Tuple[str, Tuple[str, str]]] = {
    "error": ("error", ("distance [m]", "bearing [rad]")),
    "speed": ("forward speed [m/s]", ("commanded", "measured")),
    "turning": ("turning rate [rad/s]", ("commanded", "measured")),
}


class Plots:
    """Charts of the curves."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.curves = {name: Curve(2) for name in PLOTS}
        self._charts: Dict[str, Any] = {name: server.gui.add_html("") for name in PLOTS}

    def update(self) -> None:
        """Send what is new."""
        for name, chart in self._charts.items():
            content = chart_html(*PLOTS[name], self.curves[name].arrays)
            if chart.content != content:
                chart.content = content


def chart_html(title: str, labels: Sequence[str], arrays: Sequence[np.ndarray]) -> str:
    """A chart of series over time; NaN is a gap, and 0 is always within the range."""
    times, series = arrays[0], arrays[1:]
    finite = [values[np.isfinite(values)] for values in series]
    low = min([0.0, *(float(values.min()) for values in finite if len(values))])
    high = max([0.0, *(float(values.max()) for values in finite if len(values))])
    span = max(high - low, 0.1)
    lines = [_line(0.0, 0.0, low, span, "rgba(128,128,128,0.5)")]
    for values, color in zip(series, COLORS):
        lines.append(
            f'<path fill="none" stroke="{color}" stroke-width="1.5" d="{_path(times, values, low, span)}"/>'
        )
    key = " ".join(
        f'<span style="color:{color}">&#9632;</span> {label} {_newest(values)}'
        for label, color, values in zip(labels, COLORS, series)
    )
    limits = f"{fixed(low, 2)} to {fixed(low + span, 2)}, last {_length(times):.0f} s"
    return (
        f'<div class="husky-block"><b>{title}</b>, {limits}<br>{key}'
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" style="width:100%;display:block">'
        f"{''.join(lines)}</svg></div>"
    )


def _path(times: np.ndarray, values: np.ndarray, low: float, span: float) -> str:
    if len(times) < 3:
        return ""
    bins = np.floor(times / RESOLUTION)  # of absolute time: what is drawn once stays drawn
    kept = np.append(np.flatnonzero(np.diff(bins)), len(times) - 1)
    times, values = times[kept], values[kept]
    x = WIDTH * (times - times[0]) / (times[-1] - times[0])
    y = HEIGHT * (1.0 - (values - low) / span)
    words: List[str] = []
    pen = "M"
    for a, b in zip(x.tolist(), y.tolist()):
        if b == b:
            words.append(f"{pen}{a:.1f},{b:.1f}")
        pen = "L" if b == b else "M"
    return "".join(words)


def _line(start: float, end: float, low: float, span: float, color: str) -> str:
    y0, y1 = (HEIGHT * (1.0 - (value - low) / span) for value in (start, end))
    return f'<path d="M0,{y0:.1f}L{WIDTH:.0f},{y1:.1f}" stroke="{color}" stroke-width="0.7"/>'


def _newest(values: np.ndarray) -> str:
    return fixed(float(values[-1]), 2) if len(values) and values[-1] == values[-1] else "&ndash;"


def _length(times: np.ndarray) -> float:
    return float(times[-1] - times[0]) if len(times) else 0.0
