"""Drives as pages that play them, beside the still picture.

In: a `Recording`. Out: HTML. Must not know: ROS, points.
"""

from __future__ import annotations

import numpy as np

from husky_highlevel_controller.grading.drive.recording import ADD, Recording
from husky_highlevel_controller.replay import Replay, to_html
from husky_highlevel_controller.robot import load_robot

REPLAY = "replay.html"  # in the folder of a drive


def replay_page(recording: Recording, title: str) -> str:
    """The drive with the markers of the pillar as they came; empty where nothing was recorded."""
    if not len(recording.times):
        return ""
    marks = [(marker.at, *marker.position[:2]) for marker in recording.markers if marker.action == ADD]
    return to_html(
        Replay(
            title=title,
            words=recording.ended or "no end was recorded",
            times=recording.times,
            poses=recording.poses,
            pillars=np.array([recording.pillar]),
            pillar_radius=recording.pillar_size.radius,
            outline=load_robot(recording.robot).footprint,
            marks=np.array(marks, float).reshape(-1, 3),
        )
    )
