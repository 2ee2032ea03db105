"""Immutable records that pass between modules, with the unit and frame of every field.

Records made at every physics step are named tuples, which are faster to make; arrays are read-only.

SI units and REP 103 axes (x forward, y left, z up) throughout; quaternions are xyzw.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

Vector3 = Tuple[float, float, float]
Quaternion = Tuple[float, float, float, float]
Rgba = Tuple[float, float, float, float]


class HuskyError(Exception):
    """Base of every error this package raises on bad input; its text is meant for the user."""


# ---------------------------------------------------------------------------- poses and motion


class Pose(NamedTuple):
    """A pose in space; the variable's name gives both frames, as in `pose_laser_in_base`."""

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
    size: Vector3  # [m] lengths of the box along its x, y and z axes


@dataclass(frozen=True)
class Cylinder:
    radius: float  # [m]
    length: float  # [m] length along the z axis; the origin is in the middle of the cylinder

    @property
    def size(self) -> Vector3:
        """Edges of the box around the shape [m]."""
        return (2.0 * self.radius, 2.0 * self.radius, self.length)


@dataclass(frozen=True)
class Sphere:
    radius: float  # [m]

    @property
    def size(self) -> Vector3:
        """Edges of the box around the shape [m]."""
        return (2.0 * self.radius,) * 3


@dataclass(frozen=True)
class Plane:
    normal: Vector3  # unit vector in the geometry's frame that points away from the solid side of the plane
    size: Tuple[float, float]  # [m] edges of the rectangle that is drawn; collisions use the infinite plane


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles. They are a surface, which rays meet from either side, and have no inside."""

    vertices: np.ndarray  # (V, 3) [m] corners in the geometry's frame, read-only
    faces: np.ndarray  # (F, 3) row numbers of `vertices`, three for each triangle; read-only
    source: str = ""  # name of the mesh's file; empty if unknown

    @cached_property
    def _digest(self) -> bytes:
        """Hash of the triangles, which is compared instead of them, because a mesh may have a million."""
        return hashlib.sha256(self.vertices.tobytes() + self.faces.tobytes()).digest()

    def __eq__(self, other: object) -> bool:
        """Return whether another mesh has the same triangles, also if it is another object in memory."""
        return isinstance(other, TriangleMesh) and self._digest == other._digest

    def __hash__(self) -> int:
        """Return the same number for equal meshes."""
        return hash(self._digest)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner of the box around the mesh, (2, 3) [m]."""
        return np.array((self.vertices.min(axis=0), self.vertices.max(axis=0)))

    @property
    def size(self) -> Vector3:
        """Edges of the box around the shape [m]."""
        x, y, z = (self.bounds[1] - self.bounds[0]).tolist()
        return (x, y, z)


Shape = Union[Box, Cylinder, Sphere, Plane, TriangleMesh]


@dataclass(frozen=True)
class Geometry:
    """A collision or visual shape of a body."""

    shape: Shape
    pose_in_body: Pose = IDENTITY
    rgba: Rgba = (0.7, 0.7, 0.7, 1.0)  # red, green, blue and opacity, each from 0 to 1


@dataclass(frozen=True)
class Body:
    """A rigid body of the world (SDF link)."""

    name: str
    pose_in_world: Pose
    collisions: Tuple[Geometry, ...]  # shapes that the physics and the lidar use
    visuals: Tuple[Geometry, ...]  # shapes for display
    mass: float = 0.0  # [kg] mass of the body; 0 for a static body, which never moves
    # name of the model that has this body; bodies of one model do not collide with one another; empty if the
    # body collides with all others
    model: str = ""
    # pose of the model's frame in the body's frame; of nested models, the outermost model counts
    pose_model_in_body: Pose = IDENTITY


@dataclass(frozen=True)
class World:
    """A world to simulate (SDF world), without the robot."""

    name: str
    bodies: Tuple[Body, ...]
    gravity: Vector3 = (0.0, 0.0, -9.8)  # [m/s^2] gravity in the world


# ---------------------------------------------------------------------------- what the robot senses


class Beams(NamedTuple):
    """Directions of a planar lidar's beams in its own frame; both arrays are read-only."""

    bearings: np.ndarray  # (N,) [rad], ascending
    directions: np.ndarray  # (2, N) x and y of a unit vector along each beam


def beams_at(bearings: np.ndarray) -> Beams:
    """Return the beams of a lidar at these angles, (N,) [rad], ascending."""
    angles = np.array(bearings, dtype=float)
    directions = np.array((np.cos(angles), np.sin(angles)))
    for array in (angles, directions):
        array.setflags(write=False)
    return Beams(angles, directions)


@lru_cache(maxsize=16)
def even_beams(angle_min: float, angle_max: float, count: int) -> Beams:
    """Return `count` beams at equal steps from `angle_min` to `angle_max` [rad].

    The result is kept, because every scan of a lidar has the same beams.
    """
    return beams_at(np.linspace(angle_min, angle_max, count))


@dataclass(frozen=True, eq=False)
class Scan:
    """Scan of a planar lidar (sensor_msgs/LaserScan)."""

    stamp: float  # [s]
    frame: str  # name of the lidar's frame
    angle_min: float  # [rad] angle of beam 0 in `frame`
    angle_max: float  # [rad] angle of the last beam in `frame`
    range_min: float  # [m] a smaller range is not valid
    range_max: float  # [m] this range and larger ones are not valid
    ranges: np.ndarray  # (N,) [m] ranges as the driver publishes them
    time_increment: float = 0.0  # [s] time between two beams; `stamp` is the time of the first beam
    scan_time: float = 0.0  # [s] time between two scans; 0 if unknown
    intensities: Optional[np.ndarray] = None  # (N,) echo strengths in the driver's unit; None if all are 0

    @property
    def angle_increment(self) -> float:
        """Angle between neighbouring beams [rad]; 0 if the scan has fewer than two beams."""
        steps = len(self.ranges) - 1
        return (self.angle_max - self.angle_min) / steps if steps > 0 else 0.0

    @property
    def beams(self) -> Beams:
        """Angle and direction of every beam in `frame`."""
        return even_beams(self.angle_min, self.angle_max, len(self.ranges))

    @property
    def bearings(self) -> np.ndarray:
        """Angle of every beam in `frame`, (N,) [rad], read-only."""
        return self.beams.bearings

    @cached_property
    def returns(self) -> np.ndarray:
        """Ranges, in which every beam that met nothing has +inf, (N,) [m].

        REP 117 asks for +inf, but the LMS1xx driver gives 0.0, and other drivers give NaN or `range_max`.
        """
        returns = np.where((self.ranges < self.range_max) & (self.ranges != 0.0), self.ranges, np.inf)
        returns.setflags(write=False)
        return returns

    @cached_property
    def valid(self) -> np.ndarray:
        """Mask of the beams that measured something, (N,) bool: range_min <= range < range_max.

        In `returns`, a range of range_max or more is inf.
        """
        mask: np.ndarray = (self.returns >= self.range_min) & (self.returns < np.inf)
        return mask

    @cached_property
    def valid_count(self) -> int:
        """Number of the beams that measured something."""
        return int(np.count_nonzero(self.valid))


class WheelState(NamedTuple):
    """Angles, speeds and torques of the four wheel joints, in the order of `names`."""

    names: Tuple[str, ...]  # joint names
    angles: Tuple[float, ...]  # [rad] angles of the joints, which are not limited to one turn
    speeds: Tuple[float, ...]  # [rad/s]
    efforts: Tuple[float, ...]  # [N m] torques of the motors


class ModelMotion(NamedTuple):
    """Pose and velocity of a model, all in one frame: the world, or another model."""

    pose: Pose
    velocity: Vector3 = (0.0, 0.0, 0.0)  # [m/s] velocity of the model's origin
    angular_velocity: Vector3 = (0.0, 0.0, 0.0)  # [rad/s]


class RobotState(NamedTuple):
    """True pose and velocity of base_link."""

    pose_in_world: Pose
    velocity_in_base: Vector3  # [m/s] velocity of base_link's origin
    angular_velocity_in_base: Vector3  # [rad/s]


class ImuSample(NamedTuple):
    """Sample of an inertial measurement unit; on the Husky along base_link's axes."""

    stamp: float  # [s]
    # orientation of the sensor; roll and pitch are true, but the heading counts from an unknown direction
    quat_xyzw: Quaternion
    angular_velocity: Vector3  # [rad/s] components along the sensor's axes
    specific_force: Vector3  # [m/s^2] components along the sensor's axes; at rest 9.8 m/s^2 upwards (REP 145)


class PowerState(NamedTuple):
    """Power of a Husky's base; pairs are (left, right)."""

    uptime: float  # [s]
    currents: Tuple[float, float]  # [A] currents of the motors
    electronics_current: float  # [A] current of everything except the motors
    voltage: float  # [V] voltage of the battery
    charge: float  # remaining charge as a fraction of `capacity`
    capacity: float  # [Wh]
    driver_temperatures: Tuple[float, float]  # [deg C]
    motor_temperatures: Tuple[float, float]  # [deg C]


class MagSample(NamedTuple):
    """A magnetometer's reading; on the Husky along base_link's axes."""

    stamp: float  # [s]
    field: Vector3  # [T]


class GpsFix(NamedTuple):
    """Fix of a satellite receiver, on the WGS 84 ellipsoid."""

    stamp: float  # [s]
    latitude: float  # [deg], north positive
    longitude: float  # [deg], east positive
    altitude: float  # [m]
    velocity: Vector3  # [m/s] components towards north, west and up


class Odometry(NamedTuple):
    """Pose and velocity by dead reckoning."""

    pose_base_in_odom: Pose2D = Pose2D()
    twist_in_base: Twist2D = STOP


class OdometrySample(NamedTuple):
    """Reading of the wheel encoders, and the dead reckoning from it."""

    wheels: WheelState
    from_wheels: Odometry  # dead reckoning with forward speed and yaw rate from the wheels
    filtered: Odometry  # dead reckoning with forward speed from the wheels and yaw rate from the gyro


class Snapshot(NamedTuple):
    """The simulated robot after one physics step; a sensor is None between its samples."""

    stamp: float  # [s] simulated time
    step: int  # number of physics steps since the last reset
    robot: RobotState
    command: Twist2D  # command that the wheels follow, within the limits of the robot
    contacts: Tuple[str, ...] = ()  # names of the bodies that the robot touches but does not stand on
    # sample, taken at ODOMETRY_RATE and with every scan; None at all other steps
    odometry: Optional[OdometrySample] = None
    scan: Optional[Scan] = None
    imu: Optional[ImuSample] = None
    gps: Optional[GpsFix] = None
    mag: Optional[MagSample] = None
    power: Optional[PowerState] = None

    @property
    def true_state(self) -> TrueState:
        """True motion at this step."""
        pose, (speed, _, _), (_, _, yaw_rate) = self.robot
        return TrueState(self.stamp, pose, speed, yaw_rate)


class TrueState(NamedTuple):
    """True motion of the robot at one moment, by which a run is graded."""

    stamp: float  # [s], simulated
    pose_in_world: Pose  # pose of base_link
    speed: float  # [m/s], forward
    yaw_rate: float  # [rad/s]

    def to_numbers(self) -> Tuple[float, ...]:
        """Return the state as ten numbers for a file: stamp, x, y, z, quaternion xyzw, speed, yaw rate."""
        position, quat = self.pose_in_world
        return (self.stamp, *position, *quat, self.speed, self.yaw_rate)

    @classmethod
    def from_numbers(cls, numbers: Sequence[float]) -> TrueState:
        """Make the state from the numbers of `to_numbers`; ValueError if there are more or fewer."""
        stamp, x, y, z, qx, qy, qz, qw, speed, yaw_rate = (float(number) for number in numbers)
        return cls(stamp, Pose((x, y, z), (qx, qy, qz, qw)), speed, yaw_rate)
