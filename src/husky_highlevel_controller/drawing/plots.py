"""Figures and PNGs of matplotlib, and the axes of a drive seen from above."""

from __future__ import annotations

import io
from itertools import cycle
from math import cos, sin
from typing import Any, Literal, Mapping, Optional, Tuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from husky_highlevel_controller.course import PILLAR_RADIUS
from husky_highlevel_controller.footprint import Footprint

DPI = 110
# colours that colour-blind people can distinguish, too
DRIVEN, MARKER, ROBOT, PILLAR = "#0b62c4", "#e06c00", "#d9a300", "0.35"
# colours and line styles that are distinct in black and white, too
STYLES = ((MARKER, "-"), (PILLAR, "--"), (DRIVEN, "-."), ("black", ":"))


def new_figure(
    width: float, height: float, layout: Optional[Literal["constrained"]] = "constrained"
) -> Figure:
    """Return an empty figure of a size in inches.

    With the layout "constrained", matplotlib makes room for labels. But it then draws the figure twice, so
    None is faster.
    """
    return Figure(figsize=(width, height), dpi=DPI, layout=layout)


def png(figure: Figure) -> bytes:
    """Return the bytes of a figure as a PNG file."""
    buffer = io.BytesIO()
    # the canvas writes the picture, because `figure.savefig` would draw everything twice
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def plain(text: str) -> str:
    """Escape $ in a text, because matplotlib would draw $...$ as mathematics."""
    return text.replace("$", r"\$")


def from_above(plot: Any, pillar: Tuple[float, float], radius: float) -> None:
    """Prepare axes of matplotlib for a drive seen from above, and draw the pillar.

    Args:
        plot: axes of matplotlib.
        pillar: x and y of the pillar in the world [m].
        radius: radius of the pillar [m].
    """
    plot.add_patch(Circle(pillar, radius, color=PILLAR, zorder=3))
    _axes_from_above(plot, " in the world")


def _axes_from_above(plot: Any, frame: str) -> None:
    """Prepare axes for x and y [m] at one scale.

    `frame` is added to the labels of the axes, for example " in odom".
    """
    plot.set_aspect("equal", adjustable="datalim")
    plot.margins(0.08)
    plot.grid(alpha=0.3)
    plot.set_xlabel(f"x{frame} [m]")
    plot.set_ylabel(f"y{frame} [m]")


def draw_paths(
    paths: Mapping[str, np.ndarray], title: str = "", pillar: Optional[Tuple[float, float]] = None
) -> bytes:
    """Return a PNG of paths. A dot marks the start of each path, a cross its end.

    Args:
        paths: positions (N, 2) [m] of each path, by the name in the legend.
        title: title of the picture.
        pillar: position of the pillar in the world [m]; None to draw no pillar.
    """
    figure = new_figure(7.0, 6.0)
    plot = figure.add_subplot()
    for (name, path), (color, line) in zip(paths.items(), cycle(STYLES)):
        plot.plot(*path.T, color=color, linestyle=line, label=plain(name))
        plot.plot(*path[0], color=color, marker="o")
        plot.plot(*path[-1], color=color, marker="x")
    if pillar is None:
        _axes_from_above(plot, "")
    else:
        from_above(plot, pillar, PILLAR_RADIUS)
    plot.set_title(plain(title), fontsize=11)
    if paths:
        plot.legend(loc="best")
    return png(figure)


def draw_robot(plot: Any, pose: Tuple[float, float, float], footprint: Footprint) -> None:
    """Draw a robot's outline at a pose in the world [m, m, rad], with an arrow on it that points ahead."""
    x, y, yaw = pose
    half_size = (footprint.half_length, footprint.half_width)
    # Each point below is a row vector on the left of this matrix. A row vector is rotated by the transposed
    # rotation matrix.
    transposed_rotation = np.array([[cos(yaw), sin(yaw)], [-sin(yaw), cos(yaw)]])
    # corners of the outline, and of an arrow on it, as multiples of half the length and half the width
    outline = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    arrow = ((0.8, 0.0), (-0.4, 0.7), (-0.1, 0.0), (-0.4, -0.7))
    for corners, color in ((outline, ROBOT), (arrow, "black")):
        points_in_base = np.array(corners) * half_size
        points_in_world = points_in_base @ transposed_rotation + (x, y)
        plot.add_patch(Polygon(points_in_world, facecolor=color, edgecolor="black", linewidth=0.8, zorder=4))
