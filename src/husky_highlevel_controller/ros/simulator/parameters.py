"""Parameters of the simulator node.

In: the parameter server. Out: typed records, checked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Mapping, Tuple

import rospy

from husky_highlevel_controller.config import ConfigError, number, read_config, setting
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.simulator.profile import GROUNDS, RobotProfile
from husky_highlevel_controller.simulator.sensors.depth_camera import CameraSetup
from husky_highlevel_controller.simulator.simulator_config import SimulatorConfig, simulator_config


@dataclass(frozen=True)
class StartConfig:
    """World, start pose, seed and pace of the simulation."""

    laser_frame: str = setting("origin of the lidar beams")
    world_name: str = setting("a .world file", default="")
    x: float = number(-1e4, 1e4, "start pose in the world [m]", default=0.0)
    y: float = number(-1e4, 1e4, "start pose in the world [m]", default=0.0)
    z: float = number(
        -1e4, 1e4, "height from which to search for the floor, or from which the robot falls [m]", default=0.0
    )
    yaw: float = number(-7.0, 7.0, "start heading [rad]", default=0.0)
    seed: int = number(0, 2**31 - 1, "random seed of all noise", default=0)
    real_time_factor: float = number(0.0, 1000.0, "maximum real-time factor; 0 means unlimited", default=1.0)
    paused: bool = setting("wait for gazebo/unpause_physics", default=False)
    wait_for_rviz: bool = setting("hold time until the RViz of the same launch draws", default=True)
    lockstep: bool = setting("wait for a command after each scan", default=False)
    kinect_enabled: bool = setting("add a depth camera", default=False)
    profile: str = setting("drivers to simulate, gazebo or robot", default="gazebo")
    ground: str = setting("ground for profile robot, hard or soft", default="hard")

    @property
    def pose(self) -> Pose2D:
        """Start pose of the robot in the world."""
        return Pose2D(self.x, self.y, self.yaw)

    @property
    def has_unlimited_speed(self) -> bool:
        """Return whether the simulation runs as fast as the machine can, without regard to wall time."""
        return self.real_time_factor == 0.0


def _read_robot(values: Any, source: str) -> Robot:
    """Return the robot from the parameter robot, which the launch file loads from a file of config/robots/.

    `source` is the beginning of the names of parameters in errors.
    """
    if not isinstance(values, dict):
        raise ConfigError(
            f"{source}robot is missing; load config/robots/husky.yaml or config/robots/smb.yaml"
        )
    (robot,) = read_config(values, source + "robot/", Robot)
    return robot


def _with_drivers(
    config: SimulatorConfig, values: Mapping[str, Any], ground: str, source: str
) -> SimulatorConfig:
    """Return a configuration with the drivers of a real robot in place of Gazebo's plugins.

    Args:
        config: configuration for Gazebo's plugins.
        values: parameters of the drivers, one for each field of RobotProfile.
        ground: ground under the robot, one of GROUNDS.
        source: beginning of the names of parameters in errors and in a warning.
    """
    profile: RobotProfile
    (profile,) = read_config(values, source + "robot_profile/", RobotProfile)
    # the profile has the simulated lidar, so a changed lidar of Gazebo's plugins is probably a mistake
    if config.lidar != simulator_config(config.robot.name).lidar:
        rospy.logwarn(f"{source}lidar has no effect with profile:=robot; set {source}robot_profile/lidar")
    return replace(config, real=profile.on(ground))


def read_parameters() -> Tuple[StartConfig, SimulatorConfig, CameraSetup]:
    """Return the private parameters of the node as three records: start, simulator and depth camera.

    Raises:
        ConfigError: a parameter is missing, unknown or not allowed.
    """
    values = dict(rospy.get_param("~", {}))
    source = rospy.get_name() + "/"  # beginning of the names of parameters in errors
    # The profile "robot" simulates the drivers of the real robot, whose parameters are in robot_profile. With
    # any other profile, robot_profile stays in `values`, so that `read_config` rejects it as unknown.
    driver_values = {}
    if values.get("profile") == "robot":
        driver_values = values.pop("robot_profile", {})
    robot = _read_robot(values.pop("robot", None), source)
    # the robot's frame of the lidar is the default of this parameter
    values.setdefault("laser_frame", robot.lidar_mount.frame)
    start, config, camera = read_config(values, source, StartConfig, SimulatorConfig, CameraSetup)
    config = replace(config, robot=robot)
    for name, value, choices in (
        ("profile", start.profile, robot.profiles),
        ("ground", start.ground, GROUNDS),
    ):
        if value not in choices:
            raise ConfigError(f"{source}{name} = '{value}' is not {' or '.join(choices)}")
    if start.profile == "robot":
        config = _with_drivers(config, driver_values, start.ground, source)
    return start, config, camera


def read_robot_description() -> str:
    """Return the URDF text of the robot; ConfigError if the parameter robot_description is not set."""
    # this finds the parameter in the namespace of the node, or in a namespace above it
    name = rospy.search_param("robot_description")
    if name is None:
        raise ConfigError(
            f"{rospy.resolve_name('robot_description')} is missing; load the robot's URDF into it"
        )
    return str(rospy.get_param(name))
