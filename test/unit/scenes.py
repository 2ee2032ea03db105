"""Shared by the unit tests of the controller: flat scenes, and a robot without physics."""

from dataclasses import replace
from math import cos, pi, sin
from typing import List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.controller.behaviour import (
    ControllerState,
    ControlOutput,
    Observation,
    decide,
)
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.datatypes import STOP, Pose, Pose2D, Scan, Twist2D
from husky_highlevel_controller.evaluation.scenarios import SICK, Disc, scan_of
from husky_highlevel_controller.geometry import (
    advance,
    compose,
    inverse,
    pose_from_2d,
    quat_from_rpy,
    transform_point,
)
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig

# of the lidar in base_link (Husky URDF, husky_description 0.6.10): as it hangs, and as it could stand
UPSIDE_DOWN = Pose((0.337, 0.0, 0.30795), quat_from_rpy(pi, 0.0, 0.0))
UPRIGHT = Pose((0.3568, 0.0, 0.28785))

Wall = Tuple[float, float, float, float]  # x1, y1, x2, y2 [m], in the laser's frame


def box(x: float, y: float, yaw: float, length: float, width: float) -> Tuple[Wall, ...]:
    """The four sides of a rectangle centred at (x, y)."""
    corners = [
        (
            x + cos(yaw) * a * length / 2 - sin(yaw) * b * width / 2,
            y + sin(yaw) * a * length / 2 + cos(yaw) * b * width / 2,
        )
        for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    return tuple(corners[i] + corners[(i + 1) % 4] for i in range(4))


def room(size: float, yaw: float, x: float = 0.0, y: float = 0.0) -> Tuple[Wall, ...]:
    """Four walls around the lidar."""
    return box(x, y, yaw, size, size)


def cast(
    circles: Sequence[Disc] = (), segments: Sequence[Wall] = (), lidar: LidarConfig = SICK
) -> Tuple[np.ndarray, np.ndarray]:
    """Distance to the first body each beam meets, (N,) [m], and which it is, (N,).

    Circles are numbered first, then segments; nothing is inf and -1.
    """
    bearings = np.linspace(-lidar.angle_max, lidar.angle_max, lidar.beams)
    c, s = np.cos(bearings), np.sin(bearings)
    hits = [np.full(lidar.beams, np.inf)]
    with np.errstate(divide="ignore", invalid="ignore"):
        for x, y, radius in circles:
            along, across = x * c + y * s, x * s - y * c
            near = along - np.sqrt(radius**2 - across**2)
            hits.append(np.where(near > 0.0, near, np.inf))
        for x1, y1, x2, y2 in segments:
            dx, dy = x2 - x1, y2 - y1
            cross = c * dy - s * dx
            distance, share = (x1 * dy - y1 * dx) / cross, (x1 * s - y1 * c) / cross
            hits.append(np.where((distance > 0.0) & (share >= 0.0) & (share <= 1.0), distance, np.inf))
    table = np.array(hits)
    return table.min(axis=0), table.argmin(axis=0) - 1


def look(
    circles: Sequence[Disc] = (),
    segments: Sequence[Wall] = (),
    lidar: LidarConfig = SICK,
    noise: float = 0.001,
    rng: Optional[np.random.Generator] = None,
) -> Scan:
    """One sweep over the scene; `noise` is the standard deviation of a range [m] (none without `rng`)."""
    ranges, _ = cast(circles, segments, lidar)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, noise, lidar.beams)
    return scan_of(ranges, lidar)


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
        control: Optional[ControlConfig] = None,
        seed: Optional[int] = None,
        period: float = 0.02,
        **changes: object,
    ) -> None:
        self.circles, self.segments = list(circles), list(segments)
        self.pose, self.twist = pose or Pose2D(), STOP
        self.laser_in_base = laser_in_base
        self.control = control or replace(ControlConfig(), **changes)
        self.rng = None if seed is None else np.random.default_rng(seed)
        self.knows_odom, self.enabled = True, True
        self.time, self.controller_state = 0.0, ControllerState()
        self.period = period  # [s] between scans
        self.queue: List[Twist2D] = [STOP, STOP] if period < 0.03 else [STOP]

    def scan(self) -> Scan:
        """What the lidar sees now."""
        to_laser = inverse(compose(pose_from_2d(self.pose), self.laser_in_base or UPSIDE_DOWN))

        def seen(x: float, y: float) -> Tuple[float, float]:
            return transform_point(to_laser, (x, y, 0.0))[:2]

        circles = [(*seen(x, y), radius) for x, y, radius in self.circles]
        segments = [(*seen(x1, y1), *seen(x2, y2)) for x1, y1, x2, y2 in self.segments]
        return replace(look(circles, segments, rng=self.rng), stamp=self.time)

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
