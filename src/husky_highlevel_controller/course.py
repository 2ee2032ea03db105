"""The course's world: its file, its pillar, and the topics of the courses' Huskies.

In: nothing. Out: constants.

Numbers: singlePillar.world of the ETH course; a test holds them to worlds/singlePillar.world.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from husky_highlevel_controller.paths import share_folder

PILLAR_NAME = "unit_cylinder"  # of the pillar's model
PILLAR_RADIUS = 0.2  # [m]
PILLAR_POSITION = (20.0, 5.0)  # [m], its axis in the world
REACHED = 0.35  # [m], from the robot's outline to the pillar: so near, it has reached it
TOUCH = 0.01  # [m], so near, it touches the pillar
STANDS = 0.05  # [m/s] and [rad/s], slower is standing


class PillarSize(NamedTuple):
    """A pillar that stands on the ground."""

    radius: float  # [m]
    height: float  # [m]


# of the world that each robot's sheets bring; the SMB's: singlePillar.world of 2021
PILLARS = {"husky": PillarSize(PILLAR_RADIUS, 2.0), "smb": PillarSize(1.0, 5.0)}


def course_world() -> Path:
    """The world file with the one pillar."""
    return share_folder() / "worlds" / "singlePillar.world"
