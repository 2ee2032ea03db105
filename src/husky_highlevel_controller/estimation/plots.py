"""Paths of a robot seen from above, as a PNG of matplotlib."""

from __future__ import annotations

from itertools import cycle
from typing import Mapping

import numpy as np

from husky_highlevel_controller.plots import DRIVEN, MARKER, PILLAR, new_figure, plain, png

STYLES = ((MARKER, "-"), (PILLAR, "--"), (DRIVEN, "-."), ("black", ":"))  # told apart without colours, too


def draw_paths(paths: Mapping[str, np.ndarray]) -> bytes:
    """A PNG of paths (N, 2) [m] by name; a dot where each begins, a cross where it ends."""
    figure = new_figure(7.0, 6.0)
    plot = figure.add_subplot()
    for (name, path), (color, line) in zip(paths.items(), cycle(STYLES)):
        plot.plot(*path.T, color=color, linestyle=line, label=plain(name))
        plot.plot(*path[0], color=color, marker="o")
        plot.plot(*path[-1], color=color, marker="x")
    plot.set_aspect("equal", adjustable="datalim")
    plot.margins(0.08)
    plot.grid(alpha=0.3)
    plot.set_xlabel("x [m]")
    plot.set_ylabel("y [m]")
    plot.legend(loc="best")
    return png(figure)
