"""Parameters of the simulation: physics, sensors, and the robot that they are on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import isclose
from typing import Optional

from husky_highlevel_controller.config import number, read_config, setting
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.robot import Robot, load_robot, robot_file
from husky_highlevel_controller.simulator.profile import RobotProfile
from husky_highlevel_controller.simulator.sensors.gps import GpsConfig
from husky_highlevel_controller.simulator.sensors.imu import ImuConfig
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig
from husky_highlevel_controller.simulator.sensors.point_lidar import PointsConfig
from husky_highlevel_controller.simulator.traction import TractionConfig

ODOMETRY_RATE = 50  # [Hz] rate of the odometry; in addition, each scan comes with new odometry


@dataclass(frozen=True)
class SimulatorConfig:
    """Rates and sensors of the simulation."""

    physics_rate: int = number(50, 2000, "physics steps per second [Hz]")
    scan_rate: int = number(1, 200, "scans per second [Hz]")
    lidar: LidarConfig = setting("the lidar")
    imu_rate: int = number(1, 1000, "IMU samples per second [Hz]")
    imu: ImuConfig = setting("the inertial measurement unit")
    gps_rate: int = number(0, 200, "position fixes per second; 0 means no receiver [Hz]")
    gps: GpsConfig = setting("the satellite receiver")
    points_rate: int = number(0, 50, "point clouds per second; 0 means no 3D lidar [Hz]")
    points: PointsConfig = setting("the 3D lidar")
    robot: Robot = field(default_factory=load_robot)
    traction: TractionConfig = field(default_factory=TractionConfig)
    # drivers, battery and ground of a real Husky; None for Gazebo's robot
    real: Optional[RobotProfile] = None


@lru_cache(maxsize=None)
def simulator_config(robot: str = "husky") -> SimulatorConfig:
    """Read config/robots/NAME.yaml of one of ROBOTS. Raises ConfigError if the file is wrong."""
    # `load_robot` reads the section `robot`
    values = {name: value for name, value in robot_file(robot).items() if name != "robot"}
    (config,) = read_config(values, f"config/robots/{robot}.yaml: ", SimulatorConfig)
    return replace(config, robot=load_robot(robot))


def steps_per(rate: float, physics_rate: float, name: str) -> int:
    """Return the number of physics steps in a period of `rate` [Hz]. Raises HuskyError if it is not whole."""
    ratio = physics_rate / rate
    if round(ratio) < 1 or not isclose(ratio, round(ratio), rel_tol=1e-9):
        raise HuskyError(
            f"{name} = {rate} Hz does not divide physics_rate = {physics_rate} Hz; "
            "choose a rate whose period is a whole number of physics steps"
        )
    return round(ratio)
