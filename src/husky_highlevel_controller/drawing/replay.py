"""A drive as one HTML page that plays it in 3D: it needs neither a server nor other files.

In: times and poses. Out: HTML of some hundred kilobytes.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from functools import lru_cache
from math import ceil
from typing import Any, Dict, List

import numpy as np
from markupsafe import Markup

from husky_highlevel_controller.course import PILLAR_RADIUS
from husky_highlevel_controller.drawing.robot_mesh import Part, robot_mesh
from husky_highlevel_controller.drawing.templates import render
from husky_highlevel_controller.robot import Robot, load_robot

PERIOD = 0.1  # [s] time between two poses that the page keeps; the page interpolates between them
# largest number of poses in a page; the page of a longer run keeps a pose less often than every PERIOD
MAX_POSES = 3000
MAX_MARKS = 1000  # largest number of markers in a page


@dataclass(frozen=True, eq=False)
class Replay:
    """Poses, paths and objects of a drive, in the world's frame."""

    title: str
    summary: str  # sentence that says how the run ended
    times: np.ndarray  # (N,) [s] rising
    poses: np.ndarray  # (N, 3) [m, m, rad], x, y and yaw of base_link
    # [m] x and y of the pillar's centre: (N, 2) at each time, (1, 2) if the pillar stands still, (0, 2) if
    # there is no pillar
    pillars: np.ndarray
    # (M, 3) [s, m, m] time, x and y of each marker that the controller has sent
    marks: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    pillar_radius: float = PILLAR_RADIUS  # [m]
    robot: Robot = field(default_factory=load_robot)


def to_html(replay: Replay) -> str:
    """Return the HTML page of a replay of one or more poses.

    To keep the page small, it contains only as many poses and markers as the animation needs.
    """
    rows = _rows_to_show(replay.times)
    pillars = replay.pillars
    if len(pillars) > 1:  # a position for each time
        pillars = pillars[rows]
        stands_still = (pillars == pillars[0]).all()
        if stands_still:
            pillars = pillars[:1]  # the page needs only one position
    marks = replay.marks[np.isfinite(replay.marks).all(axis=1)]
    every = max(ceil(len(marks) / MAX_MARKS), 1)  # every n-th marker is shown
    data = {
        "title": replay.title,
        "summary": replay.summary,
        "times": _rounded(replay.times[rows]),
        "poses": _rounded(replay.poses[rows]),
        "pillars": _rounded(pillars),
        "marks": _rounded(marks[::every]),
        "pillar": replay.pillar_radius,
        "robot": _robot(replay.robot.name),
    }
    # The data are written into a <script> of the page. Without this replacement, a title with "</script>"
    # would end the script.
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    return render("replay.html", data=Markup(text))


@lru_cache(maxsize=4)
def _robot(name: str) -> Dict[str, Any]:
    """Return sizes [m] and triangles [mm] of a robot of ROBOTS, by the names that the page's script uses."""
    robot = load_robot(name)
    body, wheel = robot_mesh(robot)
    wheels, drive, outline = robot.wheels, robot.drive, robot.footprint
    return {
        "size": [outline.half_length, outline.half_width],  # [m] half the length and half the width
        "height": drive.wheel_radius - wheels.height,  # [m] height of base_link above the ground
        # [m] x, y and z of the hub of the front left wheel in base_link, and radius
        "wheel": [wheels.base / 2.0, drive.wheel_separation / 2.0, wheels.height, drive.wheel_radius],
        # [m] distance between left and right wheels, from which the page computes how far the wheels roll in
        # a turn; it is larger than the real distance, because wheels that skid roll farther
        "track": drive.wheel_separation * drive.wheel_separation_multiplier,
        "body": _packed(body),
        "tyre": _packed(wheel),
    }


def _packed(parts: List[Part]) -> List[List[str]]:
    """Return the colour and the triangles of each part, in a short form for the page.

    The triangles are 16-bit integers [mm], low byte first, as base64.
    """
    packed = []
    for part in parts:
        millimetres = np.round(1000.0 * part.triangles).astype("<i2")
        packed.append([part.color, base64.b64encode(millimetres.tobytes()).decode()])
    return packed


def _rows_to_show(times: np.ndarray) -> np.ndarray:
    """Return the indices of the poses that the page keeps: the first of each period, and the last of all."""
    period = max(PERIOD, float(times[-1] - times[0]) / MAX_POSES)
    period_numbers = np.floor(times / period)
    # a row is the first of its period if the row before it has another number
    first_of_each = np.flatnonzero(np.diff(period_numbers, prepend=-np.inf))
    last = len(times) - 1
    return np.unique(np.append(first_of_each, last))


def _rounded(array: np.ndarray) -> Any:
    """Return an array as lists for JSON, rounded to 3 digits behind the point, so that the page is small."""
    return np.round(np.asarray(array, float), 3).tolist()
