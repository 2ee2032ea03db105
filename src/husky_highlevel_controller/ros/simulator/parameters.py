"""Parameters of the simulator node.

In: the parameter server. Out: typed records, checked.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Tuple

import rospy

from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.simulator.profile import GROUNDS, RobotProfile
from husky_highlevel_controller.simulator.sensors.depth_camera import CameraSetup
from husky_highlevel_controller.simulator.simulator_config import SimulatorConfig


@dataclass(frozen=True)
class StartConfig:
    """World, start pose, seed and pace of the simulation."""

    laser_frame: str = field(metadata={"help": "where the lidar's beams start"})
    world_name: str = field(default="", metadata={"help": "a .world file"})
    x: float = field(default=0.0, metadata={"min": -1e4, "max": 1e4, "help": "start pose in the world [m]"})
    y: float = field(default=0.0, metadata={"min": -1e4, "max": 1e4, "help": "start pose in the world [m]"})
    yaw: float = field(default=0.0, metadata={"min": -7.0, "max": 7.0, "help": "start heading [rad]"})
    seed: int = field(default=0, metadata={"min": 0, "max": 2**31 - 1, "help": "of all noise"})
    real_time_factor: float = field(
        default=1.0, metadata={"min": 0.0, "max": 1000.0, "help": "pace; 0 = as fast as it goes"}
    )
    paused: bool = field(default=False, metadata={"help": "wait for gazebo/unpause_physics"})
    lockstep: bool = field(default=False, metadata={"help": "wait for the command that answers a scan"})
    kinect_enabled: bool = field(default=False, metadata={"help": "with a depth camera"})
    profile: str = field(default="gazebo", metadata={"help": "whose drivers: gazebo or robot"})
    ground: str = field(default="hard", metadata={"help": "with profile robot: hard or soft"})

    @property
    def pose(self) -> Pose2D:
        """Start pose of the robot in the world."""
        return Pose2D(self.x, self.y, self.yaw)


def read_parameters() -> Tuple[StartConfig, SimulatorConfig, CameraSetup]:
    """Private parameters of the node. Raises ConfigError for one that is missing or out of range."""
    values, source = dict(rospy.get_param("~", {})), rospy.get_name() + "/"
    profile = values.pop("robot_profile", {}) if values.get("profile") == "robot" else {}
    described = values.pop("robot", None)
    if not isinstance(described, dict):
        raise ConfigError(
            f"{source}robot is missing; load config/robots/husky.yaml or config/robots/smb.yaml"
        )
    (robot,) = read_config(described, source + "robot/", Robot)
    values.setdefault("laser_frame", robot.lidar_mount.frame)
    start, config, camera = read_config(values, source, StartConfig, SimulatorConfig, CameraSetup)
    config = replace(config, robot=robot)
    for name, choices in (("profile", robot.profiles), ("ground", GROUNDS)):
        if getattr(start, name) not in choices:
            raise ConfigError(f"{source}{name} = '{getattr(start, name)}' is not {' or '.join(choices)}")
    if start.profile == "robot":
        (real,) = read_config(profile, source + "robot_profile/", RobotProfile)
        config = replace(config, real=real.on(start.ground))
    return start, config, camera


def read_robot_description() -> str:
    """URDF text of the robot. Raises ConfigError where there is none."""
    name = rospy.search_param("robot_description")
    if name is None:
        raise ConfigError(f"{rospy.resolve_name('robot_description')} is missing (URDF text of the robot)")
    return str(rospy.get_param(name))
