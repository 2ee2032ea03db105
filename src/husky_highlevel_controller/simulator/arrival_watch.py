"""Arrival of the robot at a pillar, whatever node drives it.

In: true motion of the robot, pillars. Out: an arrival, when the robot has come to stand at a pillar. There is
no second arrival at the same pillar before the robot has left it.
"""

from __future__ import annotations

from math import cos, inf
from typing import Callable, Iterable, List, NamedTuple, Optional

import numpy as np

from husky_highlevel_controller.course import REACHED, STANDS
from husky_highlevel_controller.datatypes import Body, Cylinder, Pose, TrueState
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.geometry import compose, pose_to_2d, rotate

STANDING_TIME = 0.5  # [s] time for which a robot must stand at a pillar to count as arrived
# [m] The robot has left a pillar if the gap between them is larger than this. Then it can arrive at this
# pillar again.
AWAY = 1.0
PERIOD = 0.5  # [s] simulated time between two checks whether the robot has left the pillar
# [rad] a cylinder that is tilted by more than this, because the robot has pushed it over, is not a pillar
MAX_TILT = 0.3


class PillarPlace(NamedTuple):
    """Place of an upright cylinder in the world."""

    name: str
    x: float  # [m] position of the pillar's axis in the world
    y: float  # [m]
    radius: float  # [m]


class Arrival(NamedTuple):
    """Robot that has come to stand at a pillar."""

    stamp: float  # [s] simulated time at which the robot came to a stop
    pillar: str
    gap: float  # [m] distance between the robot's footprint and the surface of the pillar


class ArrivalWatch:
    """Memory of the robot's motion and of its last arrival."""

    def __init__(self, footprint: Footprint) -> None:
        """Begin with a robot that has not driven; `footprint` is the robot's outline."""
        self._footprint = footprint
        self.forget()

    def forget(self) -> None:
        """Begin again, because the robot was put elsewhere."""
        self._has_driven = False  # true if the robot has driven since its last stop was checked
        self._stands_since = inf  # [s] stamp of the stop; inf while the robot moves
        # name of the last pillar at which the robot has arrived; None after the robot has left this pillar
        self._arrived_at: Optional[str] = None
        # [s] earliest time of the next check whether the robot has left the pillar `_arrived_at`
        self._next_check = -inf

    def update(self, state: TrueState, pillars: Callable[[], Iterable[PillarPlace]]) -> Optional[Arrival]:
        """Take in the motion of the robot; return an arrival if it has stood at a pillar for STANDING_TIME.

        Args:
            state: true motion of the robot now.
            pillars: function that lists the pillars of the world; it is called only when it is needed.
        """
        is_moving = max(abs(state.speed), abs(state.yaw_rate)) > STANDS
        if is_moving:
            self._has_driven, self._stands_since = True, inf
            # until the robot has left its last pillar, another stop there is not another arrival
            if self._arrived_at is not None and state.stamp >= self._next_check:
                self._next_check = state.stamp + PERIOD
                last_pillar = [pillar for pillar in pillars() if pillar.name == self._arrived_at]
                # the robot has also left a pillar that no longer exists
                if min(self._gaps(state, last_pillar), default=inf) > AWAY:
                    self._arrived_at = None
            return None

        # at the first call after a stop, `_stands_since` is inf and becomes the present stamp
        self._stands_since = min(self._stands_since, state.stamp)
        if not self._has_driven or state.stamp - self._stands_since < STANDING_TIME:
            return None
        self._has_driven = False  # this stop is not checked again
        all_pillars = list(pillars())
        gaps = self._gaps(state, all_pillars)  # [m] distances from the robot's outline to the pillars
        if not gaps or min(gaps) > REACHED:
            return None
        nearest = all_pillars[int(np.argmin(gaps))].name
        if nearest == self._arrived_at:
            return None
        self._arrived_at = nearest
        # a gap is negative if the robot touches the pillar, because bodies in Bullet sink in a little
        return Arrival(self._stands_since, nearest, max(0.0, min(gaps)))

    def _gaps(self, state: TrueState, pillars: List[PillarPlace]) -> List[float]:
        """Return the gaps between the robot's footprint and the surfaces of pillars [m]."""
        pose = np.array([pose_to_2d(state.pose_in_world)])
        return [
            float(self._footprint.gaps(pose, np.array([each.x, each.y]), each.radius)[0]) for each in pillars
        ]


def pillar_of(body: Body, pose_body_in_world: Pose) -> Optional[PillarPlace]:
    """Return a body as a pillar; None if it is anything but one upright cylinder."""
    if len(body.collisions) != 1:
        return None
    (geometry,) = body.collisions
    pose_in_world = compose(pose_body_in_world, geometry.pose_in_body)
    (_, _, axis_z) = rotate(pose_in_world.quat_xyzw, (0.0, 0.0, 1.0))
    # if the cylinder stands upside down, its axis points down; it is still a pillar
    if not isinstance(geometry.shape, Cylinder) or abs(axis_z) < cos(MAX_TILT):
        return None
    x, y, _ = pose_in_world.position
    return PillarPlace(body.name, x, y, geometry.shape.radius)


def arrival_sentence(arrival: Arrival) -> str:
    """Return an arrival as a sentence for the log."""
    return (
        f"the robot has arrived after {arrival.stamp:.2f} s of simulated time: it stands {arrival.gap:.3f} m "
        f"from '{arrival.pillar}'"
    )
