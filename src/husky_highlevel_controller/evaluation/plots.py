"""Draws what many drives came to: heat maps, curves, ways from above.

In: arrays. Out: PNG.
"""

from __future__ import annotations

import io
from typing import Any, Mapping, NamedTuple, Sequence, Tuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from husky_highlevel_controller.course import PILLAR_RADIUS
from husky_highlevel_controller.evaluation.setup import Axis

COLORS = ("tab:blue", "tab:red")  # of A and B


class Panel(NamedTuple):
    """Quantity over the grid."""

    title: str
    values: np.ndarray  # (N,) or (N, M), one for each point; nan: none
    colors: str = "viridis"
    is_logarithmic: bool = False
    limits: Tuple[float, float] = (np.nan, np.nan)  # of the colours; nan: the values' own


Marks = Mapping[str, Sequence[float]]  # what stands out, by its name: a value for each axis


def draw_sweep(axes: Sequence[Axis], panels: Sequence[Panel], marks: Marks, title: str) -> bytes:
    """Curves over one axis, or heat maps over two, with marks."""
    figure = _figure(9.6, 7.2)
    for plot, panel in zip(figure.subplots(2, 2).flat, panels):
        if len(axes) == 1:
            _curve(plot, axes[0], panel, marks)
        else:
            _heat_map(figure, plot, axes, panel, marks)
        plot.set_title(panel.title, fontsize=10)
        plot.set_xlabel(axes[0].label)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    figure.suptitle(title, fontsize=11)
    return _png(figure)


def draw_ways(ways: Mapping[str, np.ndarray], pillar: Tuple[float, float], title: str) -> bytes:
    """Ways to a pillar from above.

    Args:
        ways: (N, 3) poses [m, m, rad] in the world, by the words for the legend.
        pillar: its centre in the world [m].
        title: of the picture.
    """
    figure = _figure(6.0, 5.6)
    plot = figure.subplots()
    plot.add_patch(Circle(pillar, PILLAR_RADIUS, color="0.35", zorder=3))
    for color, (words, poses) in zip(COLORS, ways.items()):
        plot.plot(*poses[0, :2], "^", color="tab:green")
        plot.plot(poses[:, 0], poses[:, 1], color=color, label=words.replace("$", r"\$"))
        plot.plot(*poses[-1, :2], "o", color=color)
    plot.set_aspect("equal", adjustable="datalim")
    plot.set_xlabel("x in the world [m]")
    plot.set_ylabel("y in the world [m]")
    plot.grid(alpha=0.3)
    plot.legend(fontsize=8)
    plot.set_title(title)
    return _png(figure)


def _curve(plot: Any, axis: Axis, panel: Panel, marks: Marks) -> None:
    plot.plot(axis.values, panel.values, marker=".")
    for number, (name, (value,)) in enumerate(marks.items()):
        plot.axvline(value, color=f"C{number + 1}", linestyle="--", label=name)
    _scale(plot.set_xscale, plot.xaxis, axis)
    plot.grid(alpha=0.3)


def _heat_map(figure: Figure, plot: Any, axes: Sequence[Axis], panel: Panel, marks: Marks) -> None:
    values = np.ma.masked_invalid(panel.values.T)
    low, high = (None if np.isnan(limit) else limit for limit in panel.limits)
    norm = (LogNorm if panel.is_logarithmic else Normalize)(low, high)
    drawn = plot.pcolormesh(*map(_edges, axes), values, cmap=panel.colors, norm=norm)
    plot.set_facecolor("0.85")  # where there is no value
    bar = figure.colorbar(drawn, ax=plot)
    if panel.is_logarithmic:
        bar.ax.yaxis.set_minor_formatter("{x:g}")
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.ax.tick_params(which="minor", labelsize=7)
    for symbol, (name, (x, y)) in zip("*os^", marks.items()):
        plot.plot(
            x, y, symbol, markersize=13 if symbol == "*" else 9, label=name, color="white",
            markeredgecolor="black", linestyle="none", clip_on=False, zorder=3,
        )  # fmt: skip
    _scale(plot.set_xscale, plot.xaxis, axes[0])
    _scale(plot.set_yscale, plot.yaxis, axes[1])
    plot.set_ylabel(axes[1].label)


def _edges(axis: Axis) -> np.ndarray:
    """Edges of the cells, half way between two values, (N + 1,)."""
    values = np.log(axis.values) if axis.is_geometric else np.array(axis.values, dtype=float)
    middles = (values[1:] + values[:-1]) / 2.0
    first, last = (middles[0], middles[-1]) if len(middles) else (values[0] + 0.5, values[0] - 0.5)
    edges = np.concatenate([[2.0 * values[0] - first], middles, [2.0 * values[-1] - last]])
    return np.exp(edges) if axis.is_geometric else edges


def _scale(set_scale: Any, drawn_axis: Any, axis: Axis) -> None:
    """With equal ratios: a logarithmic scale with plain numbers at some of the values."""
    if axis.is_geometric:
        set_scale("log")
        shown = axis.values[:: len(axis.values) // 8 + 1]
        drawn_axis.set_major_locator(FixedLocator(shown))
        drawn_axis.set_major_formatter(FixedFormatter([f"{value:.2g}" for value in shown]))
        drawn_axis.set_minor_locator(NullLocator())


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
