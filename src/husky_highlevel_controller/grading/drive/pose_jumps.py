"""Finds jumps in a drive: poses that no Husky can reach in the time between them.

In: times and poses. Out: sentences. Must not know: ROS, points.
"""

from __future__ import annotations

from typing import List

import numpy as np

MAX_SPEED = 4.0  # [m/s], four times the Husky's: contacts may push it
SLACK = 0.1  # [m], for one period's solver corrections


def pose_jumps(times: np.ndarray, poses: np.ndarray) -> List[str]:
    """The first jump of a drive, in a sentence.

    Args:
        times: (N,) [s].
        poses: (N, 3) [m, m, rad] of base_link in the world.
    """
    if len(times) < 2:
        return []
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    jumps = np.flatnonzero(steps > SLACK + MAX_SPEED * np.diff(times))
    return [f"the robot jumps {steps[row]:.2f} m at {times[row + 1]:.2f} s" for row in jumps[:1]]
