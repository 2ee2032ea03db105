"""The course's world: its file, its pillar, and the topics of the courses' Huskies.

In: nothing. Out: constants.

The numbers are from singlePillar.world of the ETH course. A test compares them with the file in worlds/.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from husky_highlevel_controller.paths import share_folder

PILLAR_NAME = "unit_cylinder"  # name of the pillar model
PILLAR_RADIUS = 0.2  # [m]
PILLAR_POSITION = (20.0, 5.0)  # [m] position of the pillar's axis in the world
REACHED = 0.35  # [m] gap between robot and pillar that counts as reached
TOUCH = 0.01  # [m] gap between robot and pillar that counts as a touch
STANDS = 0.05  # fastest motion that counts as standing [m/s, rad/s]


class PillarSize(NamedTuple):
    """A pillar that stands on the ground."""

    radius: float  # [m]
    height: float  # [m]


# size of the pillar in the exercise sheets of each robot; for the SMB, the pillar of singlePillar.world of
# 2021
PILLARS = {"husky": PillarSize(PILLAR_RADIUS, 2.0), "smb": PillarSize(1.0, 5.0)}


def course_world() -> Path:
    """Return the path of the world file with one pillar."""
    return share_folder() / "worlds" / "singlePillar.world"
