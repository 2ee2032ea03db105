"""Robot description as data: names, topics, sizes, masses and limits, from config/robots/.

The section `robot` of each file is the record `Robot`. The other sections are the simulator's sensors
(`simulator/simulator_config.py`). docs/robots.md lists the steps for a further robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Dict, Tuple

import yaml

from husky_highlevel_controller.config import ConfigError, number, read_config, setting
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.paths import share_folder

ROBOTS = ("husky", "smb")
# other names of robots, each with the name in ROBOTS; husky_melodic differs from husky only in the topic and
# the frame of the lidar, which the launch files set
VERSIONS = {"husky_melodic": "husky"}


@dataclass(frozen=True)
class Hull:
    """Body without wheels: a box centred on base_link."""

    length: float = number(0.1, 10.0, "along x [m]")
    width: float = number(0.1, 10.0, "along y [m]")
    mass: float = number(0.1, 1e4, "mass without wheels and lidar [kg]")


@dataclass(frozen=True)
class Wheels:
    """Four driven wheels."""

    joints: Tuple[str, ...] = setting("front left, front right, rear left, rear right", length=4)
    base: float = number(0.05, 10.0, "distance from front to rear axle [m]")
    height: float = number(-1.0, 1.0, "height of the axles above base_link [m]")
    width: float = number(0.01, 1.0, "width of each wheel [m]")
    mass: float = number(0.01, 1e3, "mass of each wheel [kg]")


@dataclass(frozen=True)
class DriveConfig:
    """Limits and geometry of the differential drive, as in diff_drive_controller."""

    max_linear: float = number(0.01, 10.0, "[m/s]")
    max_linear_acceleration: float = number(0.01, 100.0, "[m/s^2]")
    max_angular: float = number(0.01, 20.0, "[rad/s]")
    max_angular_acceleration: float = number(0.01, 100.0, "[rad/s^2]")
    wheel_separation: float = number(0.05, 10.0, "distance between left and right joints [m]")
    wheel_separation_multiplier: float = number(
        0.1, 10.0, "factor of the wheel separation, because the wheels skid"
    )
    wheel_radius: float = number(0.01, 1.0, "[m]")
    timeout: float = number(0.01, 10.0, "an older command counts as a stop [s]")


@dataclass(frozen=True)
class LidarMount:
    """Pose of the planar lidar in base_link."""

    frame: str = setting("frame in which the beams start")
    x: float = number(-5.0, 5.0, "[m]")
    z: float = number(-5.0, 5.0, "[m]")
    upside_down: bool = setting("angles grow clockwise, seen from above")


@dataclass(frozen=True)
class ImuMount:
    """Position of the IMU in base_link; its axes are parallel to those of base_link."""

    frame: str = setting("frame in the headers of its messages")
    x: float = number(-5.0, 5.0, "[m]")
    y: float = number(-5.0, 5.0, "[m]")
    z: float = number(-5.0, 5.0, "[m]")


@dataclass(frozen=True)
class RobotTopics:
    """Names of the topics, in the robot's namespace."""

    scan: str = setting("sensor_msgs/LaserScan")
    points: str = setting("sensor_msgs/PointCloud2 of a 3D lidar, if it has one")
    imu: str = setting("sensor_msgs/Imu")
    odometry: str = setting("nav_msgs/Odometry of wheels and gyro")
    wheel_odometry: str = setting("nav_msgs/Odometry of the wheels")
    wheel_command: str = setting("geometry_msgs/Twist, the output of twist_mux")
    limited_command: str = setting("geometry_msgs/TwistStamped within the limits")
    velocity: Tuple[str, ...] = setting("geometry_msgs/Twist, inputs of twist_mux, highest priority first")

    def __post_init__(self) -> None:
        """Raise ValueError if twist_mux has no input for a guard above the input of the controller."""
        if len(self.velocity) < 2:
            raise ValueError(f"velocity has {len(self.velocity)} inputs; guard and controller need one each")


@dataclass(frozen=True)
class Robot:
    """Robot: everything that differs between robots."""

    name: str = setting("name of the robot, one of ROBOTS")
    title: str = setting("name of the robot in messages")
    description: str = setting("xacro file in urdf/")
    profiles: Tuple[str, ...] = setting("drivers that can be simulated, gazebo and robot")
    hull: Hull = setting("the body")
    wheels: Wheels = setting("the wheels")
    drive: DriveConfig = setting("the drive")
    lidar_mount: LidarMount = setting("the lidar")
    imu_mount: ImuMount = setting("the IMU")
    topics: RobotTopics = setting("the topics")

    @cached_property
    def footprint(self) -> Footprint:
        """Return the outline of the robot from above: the hull, and a strip for the wheels of either side."""
        separation, width = self.drive.wheel_separation, self.wheels.width
        # [m] distance from the middle of the robot to the front end of a front wheel
        half_strip = self.wheels.base / 2.0 + self.drive.wheel_radius
        return Footprint(
            hull=(self.hull.length / 2.0, self.hull.width / 2.0),
            wheels=(half_strip, (separation - width) / 2.0, (separation + width) / 2.0),
        )


@lru_cache(maxsize=None)
def robot_file(name: str) -> Dict[str, Any]:
    """Return the content of a robot's file config/robots/NAME.yaml; ConfigError if there is no such robot."""
    name = VERSIONS.get(name, name)
    if name not in ROBOTS:
        raise ConfigError(f"robot '{name}' is not {' or '.join(ROBOTS)}")
    with (share_folder() / "config" / "robots" / f"{name}.yaml").open() as file:
        content: Dict[str, Any] = yaml.safe_load(file)
    return content


@lru_cache(maxsize=None)
def load_robot(name: str = "husky") -> Robot:
    """Return the robot of a name; ConfigError if there is no such robot, or its file is wrong."""
    (robot,) = read_config(robot_file(name)["robot"], f"config/robots/{name}.yaml: robot/", Robot)
    return robot
