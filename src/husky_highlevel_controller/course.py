"""The course's world: its file, its pillar, and the topics of the courses' Huskies.

In: nothing. Out: constants.

The numbers are from singlePillar.world of the ETH course. A test compares them with the file in worlds/.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from husky_highlevel_controller.paths import share_folder

PILLAR_NAME = "unit_cylinder"  # name of the pillar's model in the world file
PILLAR_RADIUS = 0.2  # [m]
PILLAR_POSITION = (20.0, 5.0)  # [m] position of the pillar's axis in the world
# [m] a robot has reached the pillar if the gap between its footprint and the pillar is at most this
REACHED = 0.35
TOUCH = 0.01  # [m] a robot touches the pillar if the gap between them is at most this
STANDS = 0.05  # [m/s], [rad/s] slower motion counts as standing


class PillarSize(NamedTuple):
    """A pillar that stands on the ground."""

    radius: float  # [m]
    height: float  # [m]


# size of the pillar in the exercise sheets of each robot; the size for the SMB is from singlePillar.world of
# the year 2021
PILLARS = {"husky": PillarSize(PILLAR_RADIUS, 2.0), "smb": PillarSize(1.0, 5.0)}


def course_world() -> Path:
    """Return the path of the world file with one pillar."""
    return share_folder() / "worlds" / "singlePillar.world"
