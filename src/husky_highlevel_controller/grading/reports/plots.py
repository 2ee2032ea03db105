"""Pictures of drives from above: the way, the pillar, the markers in time."""

from __future__ import annotations

import io
from math import cos, isfinite, sin
from typing import Any, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from husky_highlevel_controller.grading.drive.recording import Recording
from husky_highlevel_controller.robot import load_robot

COLORS = "viridis"  # of time
REACH = 40.0  # [m], a marker farther from the start is not drawn: it would shrink the rest to nothing


def draw_drives(recordings: Sequence[Recording], title: str) -> bytes:
    """Picture of all drives, side by side."""
    figure = Figure(figsize=(5.2 * len(recordings) + 0.8, 5.0), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(recordings), squeeze=False)[0]
    for number, (recording, axis) in enumerate(zip(recordings, axes), 1):
        _draw(recording, axis, figure)
        axis.set_title(f"drive {number}: {recording.ended or 'no drive'}", fontsize=9)
    # matplotlib reads $...$ as mathematics, and a name is anybody's
    figure.suptitle(title.replace("$", r"\$"), fontsize=11)
    return _png(figure)


def _draw(recording: Recording, axis: Any, figure: Figure) -> None:
    start, end = recording.start, float(recording.times[-1]) if len(recording.times) else 1.0
    axis.add_patch(Circle(recording.pillar, recording.pillar_size.radius, color="0.35", zorder=3))
    axis.plot(
        *recording.pillar, marker="o", markersize=9, markerfacecolor="none", color="0.35", label="pillar"
    )
    axis.plot(start.x, start.y, marker="^", color="tab:green", linestyle="none", label="start")
    if len(recording.times):
        x, y, yaw = recording.poses.T
        drawn = axis.scatter(x, y, c=recording.times, cmap=COLORS, s=4, vmin=0.0, vmax=end, zorder=2)
        figure.colorbar(drawn, ax=axis, label="simulated time [s]", shrink=0.75)
        corners = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
        c, s = cos(yaw[-1]), sin(yaw[-1])
        footprint = load_robot(recording.robot).footprint
        half_length, half_width = footprint.half_length, footprint.half_width
        outline = [
            (x[-1] + c * along - s * across, y[-1] + s * along + c * across)
            for along, across in ((i * half_length, j * half_width) for i, j in corners)
        ]
        axis.add_patch(Polygon(outline, fill=False, color="tab:red", zorder=3))
    markers = np.array(
        [
            (marker.at, *marker.position[:2])
            for marker in recording.markers
            if all(map(isfinite, marker.position))
            and np.hypot(marker.position[0] - start.x, marker.position[1] - start.y) < REACH
        ]
    ).reshape(-1, 3)
    if len(markers):
        markers = markers[:: max(1, len(markers) // 500)]
        axis.scatter(
            markers[:, 1], markers[:, 2], c=markers[:, 0], cmap=COLORS, vmin=0.0, vmax=end,
            marker="x", s=28, linewidths=0.9, zorder=4, label="markers",
        )  # fmt: skip
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.08)
    axis.grid(alpha=0.3)
    axis.set_xlabel("x in the world [m]")
    axis.set_ylabel("y in the world [m]")
    axis.legend(fontsize=8, loc="best")


def draw_pixels(pixels: np.ndarray) -> bytes:
    """(height, width, 3) of 0 to 255, as they are."""
    height, width = pixels.shape[:2]
    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100)
    FigureCanvasAgg(figure)
    figure.figimage(pixels.astype(np.uint8))
    return _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
