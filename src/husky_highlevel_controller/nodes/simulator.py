"""The simulated Husky as a ROS node; README.md lists its topics, services and parameters."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Deque, List

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, LaserScan
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse
from tf2_msgs.msg import TFMessage

from husky_highlevel_controller import messages
from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.datatypes import Pose2D, Snapshot
from husky_highlevel_controller.description import share_folder
from husky_highlevel_controller.drive import CommandError
from husky_highlevel_controller.geometry import pose_from_2d
from husky_highlevel_controller.nodes.lockstep import Lockstep
from husky_highlevel_controller.nodes.starting import publish, run_node
from husky_highlevel_controller.pacing import Pacer
from husky_highlevel_controller.robot import robot_model
from husky_highlevel_controller.simulation import Simulation, SimulatorConfig, steps_per
from husky_highlevel_controller.world import find_world, load_world

WORLD, ODOM, BASE = "world", "odom", "base_link"
STATE_RATE = 50  # [Hz] of odometry, TF and joint states, as on the Husky
CLOCK_RATE = 100  # [Hz]
QUEUE = 200  # messages kept for a subscriber that is busy; one that hangs must not hold the world
PAUSE_PERIOD = 0.05  # [s] of wall time between two looks at whether the pause is over


@dataclass(frozen=True)
class StartConfig:
    """Where and how the simulation starts."""

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


class SimulatorNode:
    """Owns the engine in the thread that calls `run`; callbacks only leave notes for it."""

    def __init__(self) -> None:
        start, config = read_config(
            rospy.get_param("~", {}), rospy.get_name() + "/", StartConfig, SimulatorConfig
        )
        if start.kinect_enabled:
            raise ConfigError(
                f"{rospy.get_name()}/kinect_enabled = True: there is no depth camera yet; "
                "launch with kinect_enabled:=false"
            )
        self._start = start
        self._state_steps = steps_per(STATE_RATE, config.physics_rate, "the rate of odometry")
        self._clock_steps = steps_per(CLOCK_RATE, config.physics_rate, "the rate of /clock")
        world = load_world(find_world(start.world_name, _world_folders()))
        robot = robot_model(self._robot_description())
        self._simulation = Simulation(world, robot, config, Pose2D(start.x, start.y, start.yaw), start.seed)
        self._running = threading.Event()
        if not start.paused:
            self._running.set()
        self._commands: Deque[Twist] = deque(maxlen=1000)

        self._clock = rospy.Publisher("/clock", Clock, queue_size=QUEUE)
        self._scan = rospy.Publisher("front/scan", LaserScan, queue_size=QUEUE)
        self._joints = rospy.Publisher("joint_states", JointState, queue_size=QUEUE)
        self._imu = rospy.Publisher("imu/data", Imu, queue_size=QUEUE)
        self._odometry = rospy.Publisher("odometry/filtered", Odometry, queue_size=QUEUE)
        self._truth = rospy.Publisher("ground_truth/odom", Odometry, queue_size=QUEUE)
        self._transforms = rospy.Publisher("/tf", TFMessage, queue_size=QUEUE)
        self._lockstep = Lockstep(start.lockstep)
        self._input = rospy.Subscriber("cmd_vel", Twist, self._on_command, queue_size=10, tcp_nodelay=True)
        rospy.Service("gazebo/pause_physics", Empty, self._pause)
        rospy.Service("gazebo/unpause_physics", Empty, self._unpause)
        rospy.loginfo(
            "simulating '%s' with %d things, physics at %d Hz%s",
            world.name, len(world.things), config.physics_rate, ", paused" if start.paused else "",
        )  # fmt: skip

    @staticmethod
    def _robot_description() -> str:
        name = rospy.search_param("robot_description")
        if name is None:
            raise ConfigError(
                f"{rospy.resolve_name('robot_description')} is missing (URDF text of the robot)"
            )
        return str(rospy.get_param(name))

    def run(self) -> None:
        """Simulate until the node is shut down."""
        stamp = self._simulation.stamp
        # the scans' listener answers, that of the joint states sends the robot's frames
        needed, others = [self._scan, self._joints], [self._clock, self._transforms]
        self._lockstep.wait_for_partner(needed, self._input, others, lambda: self._publish_clock(stamp))
        pacer = Pacer(self._start.real_time_factor, stamp, time.monotonic())
        step = 0
        while not rospy.is_shutdown():
            if not self._running.is_set():
                self._publish_clock(stamp)  # whoever joins now still learns the time
                self._running.wait(PAUSE_PERIOD)
                pacer.restart(stamp, time.monotonic())
                continue
            self._take_commands()
            snapshot = self._simulation.step()
            stamp, step = snapshot.stamp, step + 1
            self._publish(snapshot, step)
            if step % self._clock_steps == 0:
                self._keep_pace(pacer, stamp)
        self._simulation.close()

    def _on_command(self, msg: Twist) -> None:
        self._commands.append(msg)
        self._lockstep.answer()

    def _take_commands(self) -> None:
        while self._commands:
            try:
                self._simulation.command(messages.twist_from_msg(self._commands.popleft()))
            except CommandError as error:
                rospy.logwarn_throttle(1.0, f"{rospy.resolve_name('cmd_vel')}: {error}")

    def _publish(self, snapshot: Snapshot, step: int) -> None:
        stamp = snapshot.stamp
        if step % self._clock_steps == 0:
            self._publish_clock(stamp)
        if step % self._state_steps == 0:
            base_in_odom = pose_from_2d(snapshot.odometry.pose_base_in_odom)
            _offer(self._transforms, messages.tree_to_msg, base_in_odom, stamp, ODOM, BASE)
            _offer(self._joints, messages.wheels_to_msg, snapshot.wheels, stamp)
            _offer(self._odometry, messages.odometry_to_msg, snapshot.odometry, stamp, ODOM, BASE)
            _offer(self._truth, messages.truth_to_msg, snapshot.robot, stamp, WORLD, BASE)
        if snapshot.imu is not None:
            _offer(self._imu, messages.imu_to_msg, snapshot.imu, BASE)
        if snapshot.scan is not None:
            self._lockstep.expect_answer()
            _offer(self._scan, messages.scan_to_msg, snapshot.scan)
            self._lockstep.wait_for_answer()

    def _publish_clock(self, stamp: float) -> None:
        _offer(self._clock, lambda: Clock(messages.time_to_msg(stamp)))

    def _keep_pace(self, pacer: Pacer, stamp: float) -> None:
        now = time.monotonic()
        reached = pacer.lag(stamp, now)
        if reached is not None:
            rospy.logwarn_throttle(
                10.0,
                f"this machine is too slow for real_time_factor {self._start.real_time_factor:g}: "
                f"reached {reached:.2f}; nothing is dropped, simulated time just passes more slowly",
            )
        time.sleep(pacer.delay(stamp, now))

    def _pause(self, _request: EmptyRequest) -> EmptyResponse:
        self._running.clear()
        return EmptyResponse()

    def _unpause(self, _request: EmptyRequest) -> EmptyResponse:
        self._running.set()
        return EmptyResponse()


def _world_folders() -> List[Path]:
    """Where a world without an absolute path is looked for: here, then where Gazebo looks."""
    share = share_folder()
    gazebo = os.environ.get("GAZEBO_RESOURCE_PATH", "").split(os.pathsep)
    return [share / "worlds", share, *(Path(folder) for folder in gazebo if folder)]


def _offer(publisher: rospy.Publisher, make: Callable[..., Any], *args: Any) -> None:
    """Publish what somebody listens to; do not even make what nobody does."""
    if publisher.get_num_connections():
        publish(publisher, make(*args))


def main() -> None:
    """Run the node."""
    run_node("husky_simulator", SimulatorNode)
