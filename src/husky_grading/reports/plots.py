"""Pictures of runs from above: the path, the pillar, the markers over time; and one moment of a run."""

from __future__ import annotations

from math import atan2, cos, hypot, isfinite, pi, sin
from typing import Any, List, Sequence

import numpy as np
from matplotlib.collections import LineCollection

from husky_grading.recording import ADD, EstimatedPath, MarkerSample, Recording
from husky_highlevel_controller.drawing.plots import (
    DRIVEN,
    MARKER,
    draw_paths,
    draw_robot,
    from_above,
    new_figure,
    plain,
    png,
)
from husky_highlevel_controller.robot import load_robot

COLORS = "viridis"  # colour map; the colour of a position shows its time
# [m] a marker that is farther from the robot's start is left out, because it would make the rest of the plot
# too small
MAX_DISTANCE_FROM_START = 40.0
# approximate largest numbers of markers and of lidar beams that are drawn
MAX_MARKERS, MAX_RAYS = 500, 120
SCAN = "#c2185b"


def draw_drives(recordings: Sequence[Recording], title: str) -> bytes:
    """Return a picture of all runs, side by side."""
    width, height = 5.2 * len(recordings) + 1.0, 5.0  # [inches]
    figure = new_figure(width, height, layout=None)
    # edges of all plots together, as fractions of the figure; they leave room for labels and colour bar
    edges = {"left": 0.85 / width, "right": 1 - 0.95 / width, "bottom": 0.5 / height, "top": 0.87}
    axes = figure.subplots(1, len(recordings), squeeze=False, gridspec_kw={**edges, "wspace": 0.24})[0]
    # [s] end of the longest run; all plots have the same colours for the same times
    end = max([float(recording.times[-1]) for recording in recordings if len(recording.times)], default=1.0)
    for number, (recording, axis) in enumerate(zip(recordings, axes), 1):
        dots = _draw_run(recording, axis, end)
        ending = recording.ended.text if recording.ended else "no run"
        axis.set_title(plain(f"run {number}: {ending}"), fontsize=10)
    bar = figure.add_axes((1 - 0.8 / width, 0.15, 0.18 / width, 0.65))
    # the colour bar is made from the dots of the last run; the dots of all runs have the same colours
    figure.colorbar(dots, cax=bar, label="simulated time [s]")
    figure.suptitle(plain(title), fontsize=11)
    return png(figure)


def draw_estimate(recording: Recording, estimate: EstimatedPath, title: str) -> bytes:
    """Return a picture of the path that a submission estimates, with the true one."""
    paths = {"true path": recording.poses[:, :2], estimate.topic: estimate.points[:, 1:]}
    return draw_paths({name: path for name, path in paths.items() if len(path)}, title)


def _draw_run(recording: Recording, axis: Any, end: float) -> Any:
    """Draw a run, and return the dots of its path; their colours show times from 0 to `end` [s]."""
    from_above(axis, recording.pillar, recording.pillar_size.radius)
    x, y, _ = recording.poses.T
    colors: Any = {"cmap": COLORS, "vmin": 0.0, "vmax": end}
    dots = axis.scatter(x, y, c=recording.times, s=5, zorder=2, **colors)
    if len(recording.poses):
        for row in (0, -1):  # the robot at the start and at the end
            draw_robot(axis, tuple(recording.poses[row]), load_robot(recording.robot).footprint)
        _write_label(axis, "start", (x[0], y[0]), seen_from=recording.pillar, gap=18)
    start = recording.start.x, recording.start.y
    _name_pillar(axis, recording, start)
    # about MAX_MARKERS markers, evenly distributed over the run
    every = max(1, len(recording.markers) // MAX_MARKERS)
    markers = _markers_in_plot(recording, recording.markers)[::every]
    if markers:
        places = np.array([marker.position[:2] for marker in markers])
        times = [marker.at for marker in markers]
        axis.scatter(
            places[:, 0], places[:, 1], c=times, marker="x", s=34, linewidths=1.2, zorder=6, **colors
        )
        name = "marker" if len(markers) == 1 else "markers"
        arrow = {"arrowstyle": "-", "color": MARKER}
        # a thin line leads from the text to one of the markers
        middle = places[len(places) // 2]
        _write_label(axis, name, middle, seen_from=start, gap=30, color=MARKER, arrowprops=arrow)
    return dots


def _write_label(
    axis: Any, text: str, at: Sequence[float], seen_from: Sequence[float], gap: float, **more: Any
) -> None:
    """Write a text next to a position `at`, beside the line from `seen_from` to `at`.

    The text is moved at right angles to this line, so it does not cover the line.

    Args:
        axis: axes of the plot.
        text: text.
        at: position that the text names, x and y [m].
        seen_from: position from which the line comes, x and y [m].
        gap: distance between the text and the line [points]; positive is left of the line, negative is right.
        more: further arguments of `annotate`.
    """
    # [rad] direction to the left of the line
    angle = atan2(at[1] - seen_from[1], at[0] - seen_from[0]) + pi / 2.0
    offset = gap * cos(angle), gap * sin(angle)  # [points] shift to the right, shift up
    alignment = "center"
    # if the text is moved to the side by more than 5 points, it begins or ends at the offset, so that it does
    # not reach back to the position
    if abs(offset[0]) > 5.0:
        alignment = "left" if offset[0] > 0.0 else "right"
    axis.annotate(
        text, at, offset, textcoords="offset points", ha=alignment, va="center", fontsize=9, zorder=8, **more
    )


def _name_pillar(axis: Any, recording: Recording, seen_from: Sequence[float]) -> None:
    """Write "pillar" to the right of the pillar, seen from a position [m]; "markers" is on the left."""
    (x, y), radius = recording.pillar, recording.pillar_size.radius
    # [rad] direction from the pillar's centre to its right edge
    angle = atan2(y - seen_from[1], x - seen_from[0]) - pi / 2.0
    right_edge = x + radius * cos(angle), y + radius * sin(angle)
    # a negative gap [points] moves the text to the right
    _write_label(axis, "pillar", right_edge, seen_from, gap=-10)


def _markers_in_plot(recording: Recording, markers: Sequence[MarkerSample]) -> List[MarkerSample]:
    """Return the added markers that a picture shows.

    The position of such a marker is finite and less than MAX_DISTANCE_FROM_START from the robot's start.
    """
    start = recording.start
    return [
        marker
        for marker in markers
        if marker.action == ADD
        and all(map(isfinite, marker.position))
        and hypot(marker.position[0] - start.x, marker.position[1] - start.y) < MAX_DISTANCE_FROM_START
    ]


def draw_moment(recording: Recording, at: float) -> bytes:
    """Return a picture of one moment [s] from above: robot, scan, pillar and latest marker."""
    figure = new_figure(8.0, 6.0)
    axis = figure.subplots()
    from_above(axis, recording.pillar, recording.pillar_size.radius)
    # index and values of the true pose at the moment
    row = min(int(np.searchsorted(recording.times, at)), len(recording.times) - 1)
    x, y, yaw = map(float, recording.poses[row])
    points = _last_scan(recording, at)
    robot = load_robot(recording.robot)
    driven_x, driven_y, _ = recording.poses[: row + 1].T  # path up to the moment
    axis.plot(driven_x, driven_y, color=DRIVEN, linewidth=1.5, label="driven", zorder=2)
    # position of the lidar [m], which is mounted ahead of base_link
    lidar = x + robot.lidar_mount.x * cos(yaw), y + robot.lidar_mount.x * sin(yaw)
    # about MAX_RAYS lines from the lidar to the points
    every = max(1, len(points) // MAX_RAYS)
    rays = [(lidar, tuple(point)) for point in points[::every]]
    axis.add_collection(LineCollection(rays, colors=SCAN, linewidths=0.4, alpha=0.4, zorder=1))
    axis.scatter(points[:, 0], points[:, 1], s=14, color=SCAN, zorder=5, label="laser scan")
    draw_robot(axis, (x, y, yaw), robot.footprint)
    markers_before = [marker for marker in recording.markers if marker.at <= at]
    markers = _markers_in_plot(recording, markers_before)
    if markers:
        marker = markers[-1]
        axis.plot(*marker.position[:2], "X", color=MARKER, markersize=12, markeredgecolor="white", zorder=7,
                  label=f"marker on {plain(marker.topic)}")  # fmt: skip
    _name_pillar(axis, recording, (x, y))
    axis.legend(fontsize=9)
    absent = "" if markers else "; no marker so far"
    axis.set_title(f"{recording.times[row]:.2f} s{absent}", fontsize=11)
    return png(figure)


def _last_scan(recording: Recording, at: float) -> np.ndarray:
    """Return the points of the last scan up to a moment [s], (K, 2) [m] in the world; empty if none."""
    stamps = recording.hits[:, 0]  # (M,) [s] time of the scan to which each point belongs
    hits_before = recording.hits[stamps <= at + 1e-6]  # 1e-6 is a tolerance for rounding
    if not len(hits_before):
        return hits_before[:, 1:]
    latest = hits_before[:, 0].max()  # [s] time of the last scan
    return hits_before[hits_before[:, 0] == latest][:, 1:]
