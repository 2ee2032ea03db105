"""The bag of exercise 4: a drive of the simulated robot, written by one process without a ROS master.

In: robot, ground, seed, folder. Out: NAME_navigation.bag with the sensors, and NAME_navigation_truth.bag with
the true poses. The same arguments give the same bytes.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack, closing
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any, Iterable, Iterator, Sequence, Tuple

import rosbag
import rospy

from husky_highlevel_controller.datatypes import STOP, HuskyError, Pose2D, Snapshot, Twist2D
from husky_highlevel_controller.geometry import wrap_angle, yaw_from_quat
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.clouds import points_to_msg
from husky_highlevel_controller.simulator.models.description import robot_description
from husky_highlevel_controller.simulator.models.robot_model import RobotModel, robot_model
from husky_highlevel_controller.simulator.models.sdf_world import load_world
from husky_highlevel_controller.simulator.profile import GROUNDS, RobotProfile
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import (
    ODOMETRY_RATE,
    SimulatorConfig,
    simulator_config,
)

WORLD_FILE = share_folder() / "compat" / "husky_gazebo" / "worlds" / "clearpath_playpen.world"
DURATION = 90.0  # [s] length of the drive, with the times for which the robot stands
MAX_SEED = 2**31 - 1  # largest seed that the simulator accepts
STANDING_TIME = 3.0  # [s] time for which the robot stands before and after it drives
SPEED = 0.33  # [m/s]
STEERING_GAIN = 2.0  # [1/s]
IMU_RATE = 50  # [Hz]
# [Hz] point clouds are rare, because one cloud is as large as all other messages of ten seconds
POINTS_RATE = 1
COMMAND_PERIOD = 0.1  # [s]
WORLD, ODOM, BASE = "world", "odom", "base_link"  # frames
# topics of the point cloud and the IMU, with the same names as in the bags of the ETH and ENSTA courses
POINTS_TOPIC, IMU_TOPIC = "/rslidar_points", "/imu/data"
TRUTH_TOPIC = "/ground_truth/odom"  # topic of the true path, which is in the second bag


def command_at(stamp: float, yaw: float) -> Twist2D:
    """Return the command at a time of the drive, which is a figure of eight.

    The robot drives one lap to the left and one lap to the right, and stands before and after them.

    Args:
        stamp: simulated time [s].
        yaw: true heading of the robot [rad]. The command corrects its difference from the planned heading.
    """
    if not STANDING_TIME <= stamp < DURATION - STANDING_TIME:
        return STOP
    middle = DURATION / 2.0  # [s] time at which the second lap begins
    lap_time = middle - STANDING_TIME  # [s]
    turn_direction = 1.0 if stamp < middle else -1.0
    planned_rate = 2.0 * pi / lap_time * turn_direction  # [rad/s]
    # [rad] in the middle of the drive, after one whole turn, the robot has its first heading 0 again
    planned_yaw = planned_rate * (stamp - middle)
    return Twist2D(SPEED, planned_rate + STEERING_GAIN * wrap_angle(planned_yaw - yaw))


def _equip(name: str, ground: str) -> Tuple[SimulatorConfig, RobotModel]:
    """Return configuration and model of a robot, with the real robot's drivers if they can be simulated.

    `name` is one of ROBOTS, and `ground` is one of GROUNDS.
    """
    config = replace(simulator_config(name), imu_rate=IMU_RATE, points_rate=POINTS_RATE)
    # the last profile is "robot" if the drivers of the real robot can be simulated
    profile = config.robot.profiles[-1]
    if profile == "robot":
        config = replace(config, real=RobotProfile().on(ground))
    # the description has no meshes, because nothing is drawn
    return config, robot_model(robot_description(name, meshes="", profile=profile), config.robot)


def messages_of_drive(
    name: str, ground: str, seed: int, duration: float
) -> Iterator[Tuple[Snapshot, str, Any]]:
    """Simulate the drive of exercise 4, and yield its messages in the order of time.

    Args:
        name: name of the robot, one of ROBOTS.
        ground: one of GROUNDS; it matters only for a robot whose real drivers are simulated, as the Husky's.
        seed: random seed of all noise.
        duration: simulated time after which the messages end [s].

    Yields:
        Snapshot from which the message was made, topic, and message.
    """
    config, robot = _equip(name, ground)
    rate = config.physics_rate  # [Hz]
    # [Hz] the base of a real robot reports its wheels less often than Gazebo
    wheel_rate = config.real.base.control_rate if config.real else ODOMETRY_RATE
    # number of physics steps from one message to the next of the same kind, or from one command to the next
    truth_steps = rate // ODOMETRY_RATE
    points_steps = rate // POINTS_RATE
    wheel_steps = rate // wheel_rate
    command_steps = round(rate * COMMAND_PERIOD)
    wheel_topic, imu_frame = f"/{config.robot.topics.wheel_odometry}", config.robot.imu_mount.frame
    with closing(Simulation(load_world(WORLD_FILE), robot, config, Pose2D(), seed)) as simulation:
        for _ in range(round(duration * rate)):
            snapshot = simulation.step()
            stamp, step, odometry = snapshot.stamp, snapshot.step, snapshot.odometry
            if step == 1:
                yield snapshot, "/tf_static", conversions.tree_to_msg(robot.fixed_joints, stamp)
            if step % command_steps == 0:
                true_yaw = yaw_from_quat(snapshot.robot.pose_in_world.quat_xyzw)
                simulation.command(command_at(stamp, true_yaw))
            # a snapshot with a scan also has odometry, but messages are written only at their own rates
            if odometry is not None:
                if step % truth_steps == 0:
                    yield snapshot, TRUTH_TOPIC, conversions.truth_to_msg(snapshot.robot, stamp, WORLD, BASE)
                if step % wheel_steps == 0:
                    yield snapshot, "/joint_states", conversions.wheels_to_msg(odometry.wheels, stamp)
                    from_wheels = conversions.odometry_to_msg(odometry.from_wheels, stamp, ODOM, BASE)
                    yield snapshot, wheel_topic, from_wheels
            if snapshot.imu is not None:
                yield snapshot, IMU_TOPIC, conversions.imu_to_msg(snapshot.imu, imu_frame)
            if step % points_steps == 0:
                cloud = points_to_msg(simulation.points(), stamp, robot.laser_frame)
                yield snapshot, POINTS_TOPIC, cloud


def record(name: str, ground: str, seed: int, folder: Path) -> None:
    """Write both bags of a drive into a folder, which is made if it does not exist.

    If the recording is interrupted, both bags are deleted. Otherwise the next call would refuse to write,
    because it replaces no file.

    Raises:
        HuskyError: a file is there already, or cannot be written.
    """
    paths = [folder / f"{name}_navigation{kind}.bag" for kind in ("", "_truth")]
    for path in paths:
        if path.exists():
            raise HuskyError(f"{path} already exists; move it, or choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write(paths, messages_of_drive(name, ground, seed, DURATION))
    # Ctrl-C raises KeyboardInterrupt, which is not an Exception; then, too, the unfinished bags are deleted
    except BaseException as error:
        for path in paths:
            path.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise HuskyError(f"{error.filename or folder}: {error.strerror or error}") from None
        raise
    for path in paths:
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB", flush=True)


def _write(paths: Sequence[Path], messages: Iterable[Tuple[Snapshot, str, Any]]) -> None:
    """Write the bag of the sensors and the bag of the true poses."""
    with ExitStack() as stack:
        sensors, truth = (
            stack.enter_context(rosbag.Bag(str(path), "w", compression=rosbag.Compression.BZ2))
            for path in paths
        )
        for snapshot, topic, msg in messages:
            header = {
                "topic": topic,
                "type": msg._type,
                "md5sum": msg._md5sum,
                "message_definition": msg._full_text,
                "callerid": "/husky_simulator",
                # /tf_static is latched, so rosbag play keeps its message for late subscribers
                "latching": str(int(topic == "/tf_static")),
            }
            stamp = conversions.time_to_msg(snapshot.stamp)
            bag = truth if topic == TRUTH_TOPIC else sensors
            bag.write(topic, msg, stamp, connection_header=header)


def main() -> None:
    """Write the bags; exit with 1 if that fails, and with 2 for a wrong argument."""
    parser = argparse.ArgumentParser(
        prog="record_bag", description="Write the bag of exercise 4, and a second bag with the true poses."
    )
    parser.add_argument("--robot", choices=ROBOTS, default="husky", help="robot (default: husky)")
    parser.add_argument(
        "--ground", choices=GROUNDS, default="hard", help="ground under the Husky (default: hard)"
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed of all noise (default: 0)")
    parser.add_argument(
        "--folder", type=Path, default=Path(), help="output folder for the bags (default: the current folder)"
    )
    options = parser.parse_args(rospy.myargv()[1:])
    if not 0 <= options.seed <= MAX_SEED:
        parser.error(f"argument --seed: {options.seed} is not in 0..{MAX_SEED}")
    try:
        record(options.robot, options.ground, options.seed, options.folder)
    except HuskyError as error:
        print(f"record_bag: {error}", file=sys.stderr)
        sys.exit(1)
