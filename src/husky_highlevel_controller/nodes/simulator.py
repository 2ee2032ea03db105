"""The simulated Husky as a ROS node; README.md lists its topics, services and parameters."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Callable, List

import rospy
from std_srvs.srv import Empty, EmptyResponse, Trigger, TriggerResponse

from husky_highlevel_controller.camera import CameraSetup
from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.datatypes import HuskyError, Pose2D
from husky_highlevel_controller.description import share_folder
from husky_highlevel_controller.drive import CommandError
from husky_highlevel_controller.nodes.commands import Commands
from husky_highlevel_controller.nodes.depth_camera import FRAME, DepthCamera
from husky_highlevel_controller.nodes.lockstep import Lockstep
from husky_highlevel_controller.nodes.outputs import Outputs
from husky_highlevel_controller.nodes.requests import Requests
from husky_highlevel_controller.nodes.starting import run_node
from husky_highlevel_controller.nodes.world_display import WorldDisplay
from husky_highlevel_controller.nodes.world_services import WorldServices, ask
from husky_highlevel_controller.pacing import Pacer
from husky_highlevel_controller.robot import RobotModel, robot_model
from husky_highlevel_controller.simulation import Simulation, SimulatorConfig, steps_per
from husky_highlevel_controller.srv import StepWorld, StepWorldRequest, StepWorldResponse
from husky_highlevel_controller.world import find_world, load_world

MOST_STEPS = 100_000  # in one request
PAUSE_PERIOD = 0.05  # [s] of wall time between two looks at whether the pause is over


@dataclass(frozen=True)
class StartConfig:
    """Where and how the simulation starts."""

    world_name: str = field(default="", metadata={"help": "a .world file"})
    x: float = field(default=0.0, metadata={"min": -1e4, "max": 1e4, "help": "start pose in the world [m]"})
    y: float = field(default=0.0, metadata={"min": -1e4, "max": 1e4, "help": "start pose in the world [m]"})
    yaw: float = field(default=0.0, metadata={"min": -7.0, "max": 7.0, "help": "start heading [rad]"})
    seed: int = field(default=0, metadata={"min": 0, "max": 2**31 - 1, "help": "of all noise"})
    laser_frame: str = field(default="front_laser", metadata={"help": "where the lidar's beams start"})
    real_time_factor: float = field(
        default=1.0, metadata={"min": 0.0, "max": 1000.0, "help": "pace; 0 = as fast as it goes"}
    )
    paused: bool = field(default=False, metadata={"help": "wait for gazebo/unpause_physics"})
    lockstep: bool = field(default=False, metadata={"help": "wait for the command that answers a scan"})
    kinect_enabled: bool = field(default=False, metadata={"help": "with a depth camera"})


class SimulatorNode:
    """Owns the engine in the thread that calls `run`; callbacks only leave notes for it."""

    def __init__(self) -> None:
        start, config, camera = read_config(
            rospy.get_param("~", {}), rospy.get_name() + "/", StartConfig, SimulatorConfig, CameraSetup
        )
        self._start, self._paused = start, start.paused
        self._outputs = Outputs(config)
        world = load_world(find_world(start.world_name, _world_folders()))
        robot = robot_model(self._robot_description(), start.laser_frame)
        self._simulation = Simulation(world, robot, config, Pose2D(start.x, start.y, start.yaw), start.seed)
        self._camera = self._make_camera(camera, robot, config) if start.kinect_enabled else None
        self._lockstep = Lockstep(start.lockstep)
        self._commands = Commands(self._lockstep.answer)
        self._requests = Requests()
        self._offer_services()
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

    def _make_camera(self, setup: CameraSetup, robot: RobotModel, config: SimulatorConfig) -> DepthCamera:
        if FRAME not in robot.fixed_poses:
            raise ConfigError(
                f"{rospy.get_name()}/kinect_enabled = True, but robot_description has no '{FRAME}'"
            )
        steps = steps_per(setup.camera_rate, config.physics_rate, "camera_rate")
        return DepthCamera(setup.camera, robot.fixed_poses[FRAME], steps, self._start.lockstep)

    def run(self) -> None:
        """Simulate until the node is shut down."""
        outputs, simulation = self._outputs, self._simulation
        # the scans' listener answers, that of the joint states sends the robot's frames
        needed, others = [outputs.scan, outputs.joints], [outputs.clock, outputs.transforms]

        def meanwhile() -> None:
            self._requests.serve()
            outputs.publish_clock(simulation.stamp)

        self._lockstep.wait_for_partner(needed, self._commands.main, others, meanwhile)
        self._pacer = Pacer(self._start.real_time_factor, simulation.stamp, time.monotonic())
        while not rospy.is_shutdown():
            self._requests.serve(PAUSE_PERIOD if self._paused else 0.0)
            if self._paused:
                outputs.publish_clock(simulation.stamp)  # whoever joins now still learns the time
                self._pacer.restart(simulation.stamp, time.monotonic())
                self._display.refresh()
            else:
                self._advance()
                self._keep_pace()
        if self._camera:
            self._camera.close()
        simulation.close()

    def _advance(self) -> None:
        """One step of the physics, and its messages."""
        for twist in self._commands.take(self._simulation.stamp):
            try:
                self._simulation.command(twist)
            except CommandError as error:
                rospy.logwarn_throttle(1.0, f"{rospy.resolve_name('cmd_vel')}: {error}")
        snapshot = self._simulation.step()
        self._lockstep.expect_answer()
        self._outputs.publish(snapshot)
        self._display.update(snapshot.stamp)
        if self._camera:
            self._camera.update(self._simulation, snapshot)
        if snapshot.scan is not None:
            send = partial(self._outputs.publish_scan, snapshot.scan)
            self._lockstep.wait_for_answer(self._requests.serve, ask_again=send)

    def _keep_pace(self) -> None:
        if not self._outputs.clock_was_published:
            return
        stamp, now = self._simulation.stamp, time.monotonic()
        reached = self._pacer.lag(stamp, now)
        if reached is not None:
            rospy.logwarn_throttle(
                10.0,
                f"this machine is too slow for real_time_factor {self._start.real_time_factor:g}: "
                f"reached {reached:.2f}; nothing is dropped, simulated time just passes more slowly",
            )
        delay = self._pacer.delay(stamp, now)
        if delay > 0.0:
            time.sleep(delay)

    # ------------------------------------------------------------------ services

    def _offer_services(self) -> None:
        self._world_services = WorldServices(self._simulation, self._requests)
        self._display = WorldDisplay(self._simulation, self._requests)
        for name, gazebo_name, work in (
            ("pause", "pause_physics", self._pause),
            ("resume", "unpause_physics", self._resume),
            ("reset", "reset_simulation", self._reset),
            ("reset_world", "reset_world", self._put_back),
        ):
            # Gazebo's answer with nothing; ours with a sentence
            rospy.Service(f"gazebo/{gazebo_name}", Empty, partial(self._on_empty, work))
            rospy.Service(f"~{name}", Trigger, partial(self._on_trigger, work))
        rospy.Service("~step", StepWorld, self._on_step)

    def _pause(self) -> str:
        self._paused = True
        return f"paused at {self._simulation.stamp:.3f} s"

    def _resume(self) -> str:
        self._paused = False
        return f"running from {self._simulation.stamp:.3f} s"

    def _reset(self) -> str:
        self._simulation.reset()
        self._outputs.reset()
        self._commands.forget()
        return f"the world is as it was at the start; time runs on from {self._simulation.stamp:.3f} s"

    def _put_back(self) -> str:
        self._simulation.put_back()
        return "the robot and every object stand where they were put first"

    def _step(self, steps: int) -> str:
        if not self._paused:
            raise HuskyError("the world is running; pause it before you step it")
        if not 1 <= steps <= MOST_STEPS:
            raise HuskyError(f"steps = {steps} is not within 1..{MOST_STEPS}")
        for _ in range(steps):
            if rospy.is_shutdown():
                raise HuskyError("the simulator ends")
            self._advance()
        return f"{steps} steps; it is now {self._simulation.stamp:.3f} s"

    def _on_empty(self, work: Callable[[], str], _request: Any) -> EmptyResponse:
        ask(self._requests, work)
        return EmptyResponse()

    def _on_trigger(self, work: Callable[[], str], _request: Any) -> TriggerResponse:
        return TriggerResponse(*ask(self._requests, work))

    def _on_step(self, request: StepWorldRequest) -> StepWorldResponse:
        return StepWorldResponse(*ask(self._requests, lambda: self._step(request.steps)))


def _world_folders() -> List[Path]:
    """Where a world without an absolute path is looked for: here, then where Gazebo looks."""
    share = share_folder()
    gazebo = os.environ.get("GAZEBO_RESOURCE_PATH", "").split(os.pathsep)
    return [share / "worlds", share, *(Path(folder) for folder in gazebo if folder)]


def main() -> None:
    """Run the node."""
    # commands come in on threads of their own; as fast as it goes, Python's 5 ms are 0.15 s of simulated time
    sys.setswitchinterval(0.0005)
    run_node("husky_simulator", SimulatorNode, listen_to_clock=False)
