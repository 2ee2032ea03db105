"""Pictures of many runs: heat maps, curves, pairs.

In: arrays. Out: PNG.
"""

from __future__ import annotations

from math import ceil
from typing import Any, Callable, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator

from husky_evaluation.setup import Axis
from husky_highlevel_controller.drawing.plots import DRIVEN, MARKER, new_figure, plain, png

MAX_LABELLED = 15  # cells are labelled only if each axis has at most this number of values
SYMBOLS = "*os^"  # symbols of the marks in a heat map
GOOD_COLOR = "#fee838"  # colour of the best values: the bright end of the colour map cividis
HATCH = "////"
EMPTY_GREY = 0.85  # red, green and blue of a cell without a value


class Panel(NamedTuple):
    """Quantity over a grid of one axis with N values, or of two axes with N and M values."""

    title: str
    values: np.ndarray  # value at each point of the grid, (N,) or (N, M); nan if a point has no value
    # smallest range of the colour scale or y axis, so that small differences of the values look small
    min_range: float
    digits: int = 1  # digits after the decimal point of a cell's label
    is_good_high: bool = False  # true if high values are better than low values
    is_logarithmic: bool = False
    # true for points at which not every run succeeds; same shape as the values
    hatched: Optional[np.ndarray] = None


# points that are marked in a picture: text in the legend, and value on each axis
Marks = Mapping[str, Sequence[float]]


def draw_sweep(axes: Sequence[Axis], panels: Sequence[Panel], marks: Marks, title: str = "") -> bytes:
    """Draw panels with marks: curves over one axis, or heat maps over two axes. Return a PNG."""
    columns, rows = min(len(panels), 2), ceil(len(panels) / 2)
    figure = new_figure(5.6 * columns, 4.6 * rows)
    plots = figure.subplots(rows, columns, squeeze=False).flat
    for plot, panel in zip(plots, panels):
        if len(axes) == 1:
            _curve(plot, axes[0], panel, marks)
        else:
            _heat_map(plot, axes, panel, marks)
        plot.set_title(panel.title, fontsize=11)
        plot.set_xlabel(axes[0].label)
    # the legend is made from the first panel, because every panel has the same marks
    handles, _ = figure.axes[0].get_legend_handles_labels()
    if len(axes) == 2:
        handles.append(Patch(facecolor=GOOD_COLOR, label="bright: better"))
        if any(panel.hatched is not None and panel.hatched.any() for panel in panels):
            handles.append(Patch(facecolor="w", edgecolor="0.4", hatch=HATCH, label="not every run succeeds"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9)
    figure.suptitle(plain(title), fontsize=11)
    return png(figure)


def draw_costs(costs: Sequence[float]) -> bytes:
    """Draw the cost of each setup that was tried, and the smallest cost so far at each; return a PNG."""
    figure = new_figure(5.6, 4.2)
    plot = figure.subplots()
    numbers = np.arange(1, len(costs) + 1)
    plot.plot(numbers, costs, "o", color=DRIVEN, markersize=4, label="a setup")
    plot.step(numbers, np.minimum.accumulate(costs), color=MARKER, where="post", label="smallest so far")
    # the y axis leaves out the worst costs; otherwise all other costs would look equal
    plot.set_ylim(top=float(np.quantile(costs, 0.9)) * 1.1)
    plot.set_xlabel("setup")
    plot.xaxis.set_major_locator(MaxNLocator(integer=True))
    plot.set_ylabel("objective [s]")
    plot.grid(alpha=0.3)
    plot.legend(fontsize=9)
    return png(figure)


def draw_pairs(pairs: Sequence[Tuple[float, float]], title: str) -> bytes:
    """Draw a figure of two controllers A and B, such as the time to arrival; return a PNG.

    Each start is a dot. On the line, both figures are equal.

    Args:
        pairs: figure of A and figure of B, for each start.
        title: name of the figure.
    """
    figure = new_figure(5.6, 4.8)
    plot = figure.subplots()
    a, b = np.array(pairs).reshape(-1, 2).T
    # `axline` needs one point of the line B = A. The axes include this point, so it must be near the dots.
    middle = float(a.mean())
    plot.axline((middle, middle), slope=1.0, color="0.5", linewidth=1.0)
    plot.plot(a, b, "o", color=DRIVEN, alpha=0.6, markersize=5)
    plot.set_aspect("equal", adjustable="datalim")
    plot.set_xlabel("A")
    plot.set_ylabel("B")
    plot.annotate("B is slower", (0.03, 0.93), xycoords="axes fraction", color="0.4")
    plot.annotate("B is faster", (0.97, 0.03), xycoords="axes fraction", color="0.4", ha="right")
    plot.grid(alpha=0.3)
    plot.set_title(title, fontsize=11)
    return png(figure)


def _limits(panel: Panel) -> Tuple[float, float]:
    """Return the limits of the colours or of the y axis: smallest and largest value of the panel.

    If their difference is less than the panel's `min_range`, the limit at the worst value is moved outwards.
    Otherwise small differences would look large.
    """
    values = panel.values[np.isfinite(panel.values)]
    low, high = 0.0, 0.0  # limits of a panel without values
    if len(values):
        low, high = float(values.min()), float(values.max())
    missing_range = max(panel.min_range - (high - low), 0.0)
    if panel.is_good_high:
        return low - missing_range, high
    return low, high + missing_range


def _curve(plot: Any, axis: Axis, panel: Panel, marks: Marks) -> None:
    """Draw a panel over one axis as a curve, with a vertical line for each mark."""
    plot.plot(axis.values, panel.values, marker="o", markersize=4, color=DRIVEN)
    low, high = _limits(panel)
    plot.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    for line_style, (name, values) in zip(("-", "--", ":"), marks.items()):
        # a mark has one value for each axis, and this grid has only one axis
        plot.axvline(values[0], color=MARKER, linestyle=line_style, label=name)
    if axis.is_geometric:
        # matplotlib labels a logarithmic axis only at powers of ten, so the labels are set here: at every
        # `step`-th value, which are at most 8 labels
        plot.set_xscale("log")
        plot.xaxis.set_minor_locator(NullLocator())
        step = len(axis.values) // 8 + 1
        ticks = axis.values[::step]
        plot.xaxis.set_major_locator(FixedLocator(ticks))
        plot.xaxis.set_major_formatter(FixedFormatter([f"{value:.3g}" for value in ticks]))
    plot.grid(alpha=0.3)


def _heat_map(plot: Any, axes: Sequence[Axis], panel: Panel, marks: Marks) -> None:
    """Draw a panel over two axes as cells of equal size, one for each point of the grid."""
    low, high = _limits(panel)
    # a logarithmic scale cannot begin at 0, which is the limit if no point has a value
    norm = LogNorm(low, high) if panel.is_logarithmic and low > 0.0 else Normalize(low, high)
    # transposed, so that the first axis of the grid is horizontal
    values = np.ma.masked_invalid(panel.values.T)
    colors = "cividis" if panel.is_good_high else "cividis_r"
    image = plot.imshow(values, cmap=colors, norm=norm, origin="lower", aspect="auto")
    plot.set_facecolor(str(EMPTY_GREY))  # masked cells are transparent, so they show this colour
    if panel.hatched is not None:
        _hatch_cells(plot, panel.hatched & np.isfinite(panel.values))
    rows, columns = values.shape
    # white lines between the cells
    for edge in range(1, columns):
        plot.axvline(edge - 0.5, color="w", linewidth=0.8)
    for edge in range(1, rows):
        plot.axhline(edge - 0.5, color="w", linewidth=0.8)
    if max(rows, columns) <= MAX_LABELLED:
        _label_cells(plot, values.filled(np.nan), lambda value: image.cmap(norm(value)), panel.digits)
    else:
        plot.figure.colorbar(image, ax=plot)
    for set_ticks, axis in zip((plot.set_xticks, plot.set_yticks), axes):
        # Only every `step`-th cell has a tick, so that at most MAX_LABELLED + 1 ticks are drawn. For example,
        # 15 values have the step 1, and 16 to 31 values have the step 2.
        step = len(axis.values) // (MAX_LABELLED + 1) + 1
        set_ticks(range(0, len(axis.values), step), [f"{value:.3g}" for value in axis.values[::step]])
    _mark_points(plot, axes, marks)
    plot.set_ylabel(axes[1].label)


def _hatch_cells(plot: Any, is_hatched: np.ndarray) -> None:
    """Hatch the cells of a heat map at which an array (columns, rows) is true."""
    # the cell (column, row) is a square of size 1, and its centre has the coordinates (column, row)
    for column, row in np.argwhere(is_hatched):
        corner = (column - 0.5, row - 0.5)
        plot.add_patch(Rectangle(corner, 1.0, 1.0, fill=False, hatch=HATCH, edgecolor="0.4", linewidth=0))


def _label_cells(
    plot: Any, values: np.ndarray, color_of: Callable[[float], Sequence[float]], digits: int
) -> None:
    """Write the value into each cell of a heat map, in white or black.

    Args:
        plot: axes of matplotlib.
        values: values of the cells, (rows, columns); nan if a cell has no value.
        color_of: function that returns the colour (r, g, b, a) of a cell with a value.
        digits: digits after the decimal point.
    """
    font_size = 9 if max(values.shape) <= 8 else 7
    for (row, column), value in np.ndenumerate(values):
        has_value = np.isfinite(value)
        color = color_of(value) if has_value else 3 * (EMPTY_GREY,)
        # red, green and blue are 0 to 1, so their sum is 3 for white and 0 for black
        is_dark = sum(color[:3]) < 1.5
        plot.text(
            column, row, f"{value:.{digits}f}" if has_value else "-", fontsize=font_size,
            ha="center", va="center", color="w" if is_dark else "k", zorder=5,
            # border around the text in the colour of the cell, so that hatching behind it does not hide the
            # text
            path_effects=[withStroke(linewidth=3, foreground=color)],
        )  # fmt: skip


def _mark_points(plot: Any, axes: Sequence[Axis], marks: Marks) -> None:
    """Draw the marks of a heat map, each on the upper or lower border of its cell.

    A mark in the middle of a cell would hide the number that is written there.
    """
    for symbol, (name, values) in zip(SYMBOLS, marks.items()):
        # position of the mark in cells; cell i has its centre at i, and its borders at i - 0.5 and i + 0.5
        x = float(np.interp(values[0], axes[0].values, range(len(axes[0].values))))
        y = float(np.interp(values[1], axes[1].values, range(len(axes[1].values))))
        # A mark between the centres of two cells is drawn on the border between these cells, for example at
        # 3.5 for y = 3.2 and for y = 3.8. A mark at a centre, such as y = 3, is drawn on the upper border.
        border = np.floor(y) + 0.5
        # a star looks smaller than another symbol of the same size
        plot.plot(
            x, border, symbol, markersize=12 if symbol == "*" else 8, label=name, color=MARKER,
            markeredgecolor="w", markeredgewidth=1.0, linestyle="none", clip_on=False, zorder=6,
        )  # fmt: skip
