"""Shared by the unit tests of the controller: flat scenes, and a robot without physics."""

from dataclasses import replace
from math import atan2, hypot, inf, pi
from typing import List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from husky_evaluation.scenarios import SICK, Disc, scan_of
from husky_highlevel_controller.controller.behaviour import (
    ControllerState,
    ControlOutput,
    Observation,
    decide,
)
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.datatypes import STOP, Box, Cylinder, Pose, Pose2D, Scan, Twist2D, even_beams
from husky_highlevel_controller.geometry import advance, compose, pose_from_2d, quat_from_rpy, transform_point
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig
from husky_highlevel_controller.simulator.sensors.raycast import cast_rays, make_scene

# of the lidar in base_link (Husky URDF, husky_description 0.6.10): as it hangs, and as it could stand
UPSIDE_DOWN = Pose((0.337, 0.0, 0.30795), quat_from_rpy(pi, 0.0, 0.0))
UPRIGHT = Pose((0.3568, 0.0, 0.28785))

Wall = Tuple[float, float, float, float]  # x1, y1, x2, y2 [m]
THIN, HIGH = 1e-6, 9.0  # [m], of walls; of walls and circles


def box(x: float, y: float, yaw: float, length: float, width: float) -> Tuple[Wall, ...]:
    """The four sides of a rectangle centred at (x, y)."""
    centre = pose_from_2d(Pose2D(x, y, yaw))
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    corners = [transform_point(centre, (a * length / 2.0, b * width / 2.0, 0.0))[:2] for a, b in signs]
    return tuple(corners[i] + corners[(i + 1) % 4] for i in range(4))


def look(
    circles: Sequence[Disc] = (),
    segments: Sequence[Wall] = (),
    lidar: LidarConfig = SICK,
    noise: float = 0.001,
    rng: Optional[np.random.Generator] = None,
    laser: Pose = Pose(),  # noqa: B008
) -> Scan:
    """One sweep over the scene; `noise` is the standard deviation of a range [m] (none without `rng`)."""
    beams = even_beams(-lidar.angle_max, lidar.angle_max, lidar.beams)
    solids = [(Cylinder(radius, HIGH), Pose((x, y, 0.0))) for x, y, radius in circles]
    scene = make_scene(solids + [_wall(*segment) for segment in segments])
    ranges = cast_rays(scene, laser, beams, inf)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, noise, lidar.beams)
    return scan_of(ranges, lidar)


def _wall(x1: float, y1: float, x2: float, y2: float) -> Tuple[Box, Pose]:
    middle = Pose2D((x1 + x2) / 2.0, (y1 + y2) / 2.0, atan2(y2 - y1, x2 - x1))
    return Box((hypot(x2 - x1, y2 - y1), THIN, HIGH)), pose_from_2d(middle)


class Step(NamedTuple):
    """One scan of a drive."""

    time: float
    pose: Pose2D
    output: ControlOutput


class Toy:
    """A unicycle with the Husky's limits in a flat world; odom is the world.

    Commands are obeyed a scan late, or two where scans are many. Things may be changed between two drives.
    """

    def __init__(
        self,
        circles: Sequence[Disc] = (),
        segments: Sequence[Wall] = (),
        pose: Optional[Pose2D] = None,
        laser_in_base: Optional[Pose] = UPSIDE_DOWN,
        seed: Optional[int] = None,
        period: float = 0.02,
        **changes: object,
    ) -> None:
        self.circles, self.segments = list(circles), list(segments)
        self.pose, self.twist = pose or Pose2D(), STOP
        self.laser_in_base = laser_in_base
        self.control = replace(ControlConfig(), **changes)
        self.rng = None if seed is None else np.random.default_rng(seed)
        self.knows_odom, self.enabled = True, True
        self.time, self.controller_state = 0.0, ControllerState()
        self.period = period  # [s] between scans
        self.queue: List[Twist2D] = [STOP, STOP] if period < 0.03 else [STOP]

    def scan(self) -> Scan:
        """What the lidar sees now."""
        laser = compose(pose_from_2d(self.pose), self.laser_in_base or UPSIDE_DOWN)
        scan = look(self.circles, self.segments, rng=self.rng, laser=laser)
        return replace(scan, stamp=self.time)

    def step(self) -> Step:
        """One scan, one output, and the motion until the next."""
        observation = Observation(self.scan(), self.laser_in_base, self.pose if self.knows_odom else None)
        self.controller_state, output = decide(
            self.controller_state, observation, self.enabled, self.control, PillarConfig()
        )
        step = Step(self.time, self.pose, output)
        self.queue.append(output.twist)
        wanted, period = self.queue.pop(0), self.period
        dv, dw = 3.0 * period, 6.0 * period
        linear = min(max(wanted.linear, self.twist.linear - dv), self.twist.linear + dv)
        angular = min(max(wanted.angular, self.twist.angular - dw), self.twist.angular + dw)
        self.twist = Twist2D(linear, angular)
        self.pose = advance(self.pose, self.twist, period)
        self.time = round(self.time + period, 6)
        return step

    def drive(self, seconds: float) -> List[Step]:
        """Go on for a while."""
        return [self.step() for _ in range(round(seconds / self.period))]
