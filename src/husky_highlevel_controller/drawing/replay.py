"""A drive as one HTML page that plays it in 3D: it needs neither a server nor other files.

In: times and poses. Out: HTML of some hundred kilobytes.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from functools import lru_cache
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

    The page keeps only as many poses as a smooth animation needs.
    """
    rows = _rows_to_show(replay.times)
    # `pillars` has a row for each time, or only one row, or none
    pillars = replay.pillars if len(replay.pillars) < 2 else replay.pillars[rows]
    # if the pillar stands still, the page needs only one position; without a pillar, the comparison gives
    # true, too
    stands_still = (pillars == pillars[:1]).all()
    marks = replay.marks[np.isfinite(replay.marks).all(axis=1)]
    # marks are the markers that the controller has sent; every n-th mark is shown, so that there are at most
    # MAX_MARKS; the division is rounded up
    every = max(-(-len(marks) // MAX_MARKS), 1)
    data = {
        "title": replay.title,
        "summary": replay.summary,
        "times": _rounded(replay.times[rows]),
        "poses": _rounded(replay.poses[rows]),
        "pillars": _rounded(pillars[:1] if stands_still else pillars),
        "marks": _rounded(marks[::every]),
        "pillar": replay.pillar_radius,
        "robot": _robot(replay.robot.name),
    }
    # titles may contain HTML, which must not become a tag
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    return render("replay.html", data=Markup(text))


@lru_cache(maxsize=4)
def _robot(name: str) -> Dict[str, Any]:
    """Sizes [m] and triangles [mm] of a robot of ROBOTS, by the names that the page's script uses."""
    robot = load_robot(name)
    body, wheel = robot_mesh(robot)
    wheels, drive, outline = robot.wheels, robot.drive, robot.footprint
    return {
        "size": [outline.half_length, outline.half_width],  # [m] half the length and half the width
        "height": drive.wheel_radius - wheels.height,  # [m] height of base_link above the ground
        # [m] x, y and z of the hub of the front left wheel in base_link, and radius
        "wheel": [wheels.base / 2.0, drive.wheel_separation / 2.0, wheels.height, drive.wheel_radius],
        # [m] distance between left and right wheels from which the page computes how a turn rolls them; it is
        # larger than the real distance, because the wheels skid
        "track": drive.wheel_separation * drive.wheel_separation_multiplier,
        "body": _packed(body),
        "tyre": _packed(wheel),
    }


def _packed(parts: List[Part]) -> List[List[str]]:
    """Colour and triangles of each part; triangles are 16-bit integers [mm], in base64."""
    return [
        [part.color, base64.b64encode(np.round(1000.0 * part.triangles).astype("<i2").tobytes()).decode()]
        for part in parts
    ]


def _rows_to_show(times: np.ndarray) -> np.ndarray:
    """The first row of each period, and the last row."""
    period = max(PERIOD, float(times[-1] - times[0]) / MAX_POSES)
    first_of_each = np.flatnonzero(np.diff(np.floor(times / period), prepend=-np.inf))
    return np.unique(np.append(first_of_each, len(times) - 1))


def _rounded(array: np.ndarray) -> Any:
    return np.round(np.asarray(array, float), 3).tolist()
