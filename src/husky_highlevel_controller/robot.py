"""Robot description as data: names, topics, sizes, masses and limits, from config/robots/.

The first section of the file, `robot`, is the record `Robot`; the other entries are the simulator's sensors
(`simulator/simulation.py`). docs/robots.md says what a further robot needs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, Dict, Tuple

import yaml

from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.footprint import Footprint
from husky_highlevel_controller.paths import share_folder

ROBOTS = ("husky", "smb")


@dataclass(frozen=True)
class Hull:
    """Body without wheels: a box centred on base_link."""

    length: float = field(metadata={"min": 0.1, "max": 10.0, "help": "along x [m]"})
    width: float = field(metadata={"min": 0.1, "max": 10.0, "help": "along y [m]"})
    mass: float = field(metadata={"min": 0.1, "max": 1e4, "help": "without wheels and lidar [kg]"})


@dataclass(frozen=True)
class Wheels:
    """Four driven wheels."""

    joints: Tuple[str, ...] = field(
        metadata={"length": 4, "help": "front left, front right, rear left, rear right"}
    )
    base: float = field(metadata={"min": 0.05, "max": 10.0, "help": "from front to rear axle [m]"})
    height: float = field(metadata={"min": -1.0, "max": 1.0, "help": "of the axles above base_link [m]"})
    width: float = field(metadata={"min": 0.01, "max": 1.0, "help": "of each [m]"})
    mass: float = field(metadata={"min": 0.01, "max": 1e3, "help": "of each [kg]"})


@dataclass(frozen=True)
class DriveConfig:
    """Limits and geometry of the differential drive, as in diff_drive_controller."""

    max_linear: float = field(metadata={"min": 0.01, "max": 10.0, "help": "[m/s]"})
    max_linear_acceleration: float = field(metadata={"min": 0.01, "max": 100.0, "help": "[m/s^2]"})
    max_angular: float = field(metadata={"min": 0.01, "max": 20.0, "help": "[rad/s]"})
    max_angular_acceleration: float = field(metadata={"min": 0.01, "max": 100.0, "help": "[rad/s^2]"})
    wheel_separation: float = field(
        metadata={"min": 0.05, "max": 10.0, "help": "between left and right joints [m]"}
    )
    wheel_separation_multiplier: float = field(
        metadata={"min": 0.1, "max": 10.0, "help": "of the separation, since the wheels skid"}
    )
    wheel_radius: float = field(metadata={"min": 0.01, "max": 1.0, "help": "[m]"})
    timeout: float = field(
        metadata={"min": 0.01, "max": 10.0, "help": "an older command counts as a stop [s]"}
    )


@dataclass(frozen=True)
class LidarMount:
    """Pose of the planar lidar in base_link."""

    frame: str = field(metadata={"help": "where its beams start"})
    x: float = field(metadata={"min": -5.0, "max": 5.0, "help": "[m]"})
    z: float = field(metadata={"min": -5.0, "max": 5.0, "help": "[m]"})
    upside_down: bool = field(metadata={"help": "angles grow clockwise, seen from above"})


@dataclass(frozen=True)
class ImuMount:
    """Position of the IMU in base_link, whose axes are its own."""

    frame: str = field(metadata={"help": "that its messages name"})
    x: float = field(metadata={"min": -5.0, "max": 5.0, "help": "[m]"})
    y: float = field(metadata={"min": -5.0, "max": 5.0, "help": "[m]"})
    z: float = field(metadata={"min": -5.0, "max": 5.0, "help": "[m]"})


@dataclass(frozen=True)
class RobotTopics:
    """Names of the topics, in the robot's namespace."""

    scan: str = field(metadata={"help": "sensor_msgs/LaserScan"})
    points: str = field(metadata={"help": "sensor_msgs/PointCloud2 of a 3D lidar, if it has one"})
    imu: str = field(metadata={"help": "sensor_msgs/Imu"})
    odometry: str = field(metadata={"help": "nav_msgs/Odometry of wheels and gyro"})
    wheel_odometry: str = field(metadata={"help": "nav_msgs/Odometry of the wheels"})
    wheel_command: str = field(metadata={"help": "geometry_msgs/Twist, the output of twist_mux"})
    limited_command: str = field(metadata={"help": "geometry_msgs/TwistStamped within the limits"})
    velocity: Tuple[str, ...] = field(
        metadata={"help": "geometry_msgs/Twist, inputs of twist_mux, the strongest first"}
    )

    def __post_init__(self) -> None:
        """Raises ValueError where a guard has no input above the controller's."""
        if len(self.velocity) < 2:
            raise ValueError(f"velocity has {len(self.velocity)} inputs; guard and controller need one each")


@dataclass(frozen=True)
class Robot:
    """Robot: everything that is not the same for all."""

    name: str = field(metadata={"help": "one of ROBOTS"})
    title: str = field(metadata={"help": "its name in sentences"})
    description: str = field(metadata={"help": "xacro file in urdf/"})
    profiles: Tuple[str, ...] = field(metadata={"help": "whose drivers can be simulated: gazebo, robot"})
    hull: Hull = field(metadata={"help": "the body"})
    wheels: Wheels = field(metadata={"help": "the wheels"})
    drive: DriveConfig = field(metadata={"help": "the drive"})
    lidar_mount: LidarMount = field(metadata={"help": "the lidar"})
    imu_mount: ImuMount = field(metadata={"help": "the IMU"})
    topics: RobotTopics = field(metadata={"help": "the topics"})

    @cached_property
    def footprint(self) -> Footprint:
        """Outline from above: the hull, and the wheels of either side."""
        separation, width = self.drive.wheel_separation, self.wheels.width
        return Footprint(
            (self.hull.length / 2.0, self.hull.width / 2.0),
            (
                self.wheels.base / 2.0 + self.drive.wheel_radius,
                (separation - width) / 2.0,
                (separation + width) / 2.0,
            ),
        )


@lru_cache(maxsize=None)
def robot_file(name: str) -> Dict[str, Any]:
    """Content of config/robots/NAME.yaml.

    Raises:
        ConfigError: there is no robot of that name.
    """
    if name not in ROBOTS:
        raise ConfigError(f"robot '{name}' is not {' or '.join(ROBOTS)}")
    with (share_folder() / "config" / "robots" / f"{name}.yaml").open() as file:
        content: Dict[str, Any] = yaml.safe_load(file)
    return content


@lru_cache(maxsize=None)
def load_robot(name: str = "husky") -> Robot:
    """The robot of that name; ConfigError if there is none, or its file is wrong."""
    (robot,) = read_config(robot_file(name)["robot"], f"config/robots/{name}.yaml: robot/", Robot)
    return robot
