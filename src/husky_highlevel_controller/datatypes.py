"""The records that travel between modules: numbers with names, units and frames.

In: nothing. Out: immutable records, those of every step as tuples, which are made faster; scans are read-only
arrays.
Must not know: ROS, PyBullet, files.

SI units and REP 103 axes (x forward, y left, z up) throughout; quaternions are xyzw.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot
from typing import NamedTuple, Optional, Tuple, Union

import numpy as np

Vector3 = Tuple[float, float, float]
Quaternion = Tuple[float, float, float, float]
Rgba = Tuple[float, float, float, float]


class HuskyError(Exception):
    """Base of every error this package raises on bad input; its text is meant for the user."""


# ---------------------------------------------------------------------------- poses and motion


class Pose(NamedTuple):
    """A pose in space: of which frame, in which frame, says the variable's name."""

    position: Vector3 = (0.0, 0.0, 0.0)  # [m]
    quat_xyzw: Quaternion = (0.0, 0.0, 0.0, 1.0)


IDENTITY = Pose()


class Pose2D(NamedTuple):
    """A pose on the ground plane."""

    x: float = 0.0  # [m]
    y: float = 0.0  # [m]
    yaw: float = 0.0  # [rad], counter-clockwise


class Twist2D(NamedTuple):
    """A velocity of base_link, expressed in base_link."""

    linear: float = 0.0  # [m/s], forward
    angular: float = 0.0  # [rad/s], counter-clockwise


STOP = Twist2D()


# ---------------------------------------------------------------------------- world


@dataclass(frozen=True)
class Box:
    size: Vector3  # [m], full edge lengths


@dataclass(frozen=True)
class Cylinder:
    radius: float  # [m]
    length: float  # [m], along the part's z axis, centred


@dataclass(frozen=True)
class Sphere:
    radius: float  # [m]


@dataclass(frozen=True)
class Plane:
    normal: Vector3  # unit vector in the part's frame; collides as an infinite half space
    size: Tuple[float, float]  # [m], only what is drawn of it


Shape = Union[Box, Cylinder, Sphere, Plane]


@dataclass(frozen=True)
class Part:
    """One shape of a thing."""

    shape: Shape
    pose_in_thing: Pose = IDENTITY
    rgba: Rgba = (0.7, 0.7, 0.7, 1.0)  # each 0..1


@dataclass(frozen=True)
class Thing:
    """One rigid body of the world."""

    name: str
    pose_in_world: Pose
    collisions: Tuple[Part, ...]  # what it is made of for physics and the lidar
    visuals: Tuple[Part, ...]  # what is drawn of it
    mass: float = 0.0  # [kg]; 0 = static, never moves


@dataclass(frozen=True)
class World:
    name: str
    things: Tuple[Thing, ...]
    gravity: Vector3 = (0.0, 0.0, -9.8)  # [m/s^2], in the world


# ---------------------------------------------------------------------------- what the robot senses


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep of a planar lidar (sensor_msgs/LaserScan without the header's clothes)."""

    stamp: float  # [s]
    frame: str
    angle_min: float  # [rad], of beam 0 in `frame`
    angle_max: float  # [rad], of the last beam
    range_min: float  # [m]
    range_max: float  # [m]
    ranges: np.ndarray  # (N,) [m]; REP 117: too close -inf, no return +inf, invalid NaN

    @property
    def angle_increment(self) -> float:
        """Step between beams in rad; (max - min) / (N - 1), or 0 for fewer than two beams."""
        steps = len(self.ranges) - 1
        return (self.angle_max - self.angle_min) / steps if steps > 0 else 0.0

    @property
    def bearings(self) -> np.ndarray:
        """Angle of every beam in `frame`, (N,) [rad]."""
        return np.linspace(self.angle_min, self.angle_max, len(self.ranges))

    @property
    def valid(self) -> np.ndarray:
        """Mask of the beams that measured something, (N,) bool: range_min <= r <= range_max (REP 117)."""
        mask: np.ndarray = (self.ranges >= self.range_min) & (self.ranges <= self.range_max)
        return mask


class WheelState(NamedTuple):
    """The four wheels, in the order of `names`."""

    names: Tuple[str, ...]  # joint names
    angles: Tuple[float, ...]  # [rad], not wrapped
    speeds: Tuple[float, ...]  # [rad/s]
    efforts: Tuple[float, ...]  # [N m], by the motor


class RobotState(NamedTuple):
    """The truth about base_link."""

    pose_in_world: Pose
    velocity_in_base: Vector3  # [m/s], of base_link's origin
    angular_velocity_in_base: Vector3  # [rad/s]


class ImuSample(NamedTuple):
    """What an inertial measurement unit tells; on the Husky along base_link's axes."""

    stamp: float  # [s]
    quat_xyzw: Quaternion  # how the sensor stands in a level frame, whose heading is anybody's choice
    angular_velocity: Vector3  # [rad/s], along the sensor's axes
    specific_force: Vector3  # [m/s^2], along the sensor's axes: at rest 9.8 upwards (REP 145)


class GpsFix(NamedTuple):
    """What a satellite receiver tells, on the WGS 84 ellipsoid."""

    stamp: float  # [s]
    latitude: float  # [deg], north positive
    longitude: float  # [deg], east positive
    altitude: float  # [m]
    velocity: Vector3  # [m/s], towards north, west and up


@dataclass(frozen=True, eq=False)
class DepthImage:
    """What a depth camera sees."""

    stamp: float  # [s]
    frame: str  # optical: z forward, x to the right, y down
    depth: np.ndarray  # (height, width) float32 [m], along z; NaN where nothing was seen


class Odometry(NamedTuple):
    """Dead reckoning: where the robot believes it is."""

    pose_base_in_odom: Pose2D = Pose2D()
    twist_in_base: Twist2D = STOP


class Snapshot(NamedTuple):
    """The simulated robot at one instant."""

    stamp: float  # [s] of simulated time
    robot: RobotState
    wheels: WheelState  # as of the last odometry period, as both odometries
    command: Twist2D  # what the wheels are told, within the limits
    wheel_odometry: Odometry  # from the wheels alone
    odometry: Odometry  # from the wheels and the gyro
    touched: Tuple[str, ...] = ()  # names of the things the robot touches but does not stand on
    scan: Optional[Scan] = None  # None between two scan periods
    imu: Optional[ImuSample] = None  # None between two of its periods
    gps: Optional[GpsFix] = None  # None between two of its periods


class Pillar(NamedTuple):
    """A pillar seen in one scan."""

    x: float  # [m], centre, in the laser's frame
    y: float  # [m], centre, in the laser's frame
    radius: float  # [m]
    beams: int  # how many beams it rests on
    residual: float  # [m], root mean square distance of the beams' end points from the circle

    @property
    def bearing(self) -> float:
        """Direction of the centre in the laser's frame [rad]."""
        return atan2(self.y, self.x)

    @property
    def distance(self) -> float:
        """From the laser to the pillar's near surface [m]."""
        return hypot(self.x, self.y) - self.radius
