"""Rollout of simulator and controller in one process, without ROS.

In: a `Scenario`, the controller's parameters. Out: a `Trace`. Simulator and controller meet only here.

Each scan is answered at once, and the command takes effect at the next physics step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from husky_evaluation.scenarios import Scenario
from husky_highlevel_controller.controller.behaviour import (
    ControllerState,
    ControlOutput,
    Observation,
    State,
    decide,
)
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.datatypes import Pose2D, Scan, Snapshot, Twist2D
from husky_highlevel_controller.geometry import advance, pose_to_2d
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.simulator.models.description import robot_description
from husky_highlevel_controller.simulator.models.robot_model import RobotModel, robot_model
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import SimulatorConfig, simulator_config

# function with the signature of `behaviour.decide`; in the first call of a run, the first argument is
# ControllerState()
Controller = Callable[
    [ControllerState, Observation, bool, ControlConfig, PillarConfig], Tuple[ControllerState, ControlOutput]
]

# arrays of a Trace, and the number of values in each of their rows; 0 means that a row is a single number
COLUMNS = {
    "times": 0, "poses": 3, "twists": 2, "estimates": 2, "pillars": 2,
    "distance_errors": 0, "bearing_errors": 0, "nearest": 0,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Trace:
    """Trace of a run, one row per scan (N scans); arrays are read-only."""

    times: np.ndarray  # (N,) [s] simulated time at which the scan came
    poses: np.ndarray  # (N, 3) [m, m, rad] true x, y and yaw of base_link in the world
    twists: np.ndarray  # (N, 2) [m/s, rad/s] commanded twist
    # (N, 2) [m] position in odom of the pillar that the controller remembers; nan while it remembers none
    estimates: np.ndarray
    pillars: np.ndarray  # (N, 2) [m] true centre of the pillar in the world
    # (N,) [m] distance that remains to the stop, as the controller computes it; nan without a target
    distance_errors: np.ndarray
    # (N,) [rad] bearing of the target, as the controller computes it; nan without a target
    bearing_errors: np.ndarray
    nearest: np.ndarray  # (N,) [m] shortest range in the scan; inf if no beam has a return
    states: Tuple[State, ...]  # state of the controller after each scan
    # time [s] of the first touch, and name of the body, for each touched body; touches by the wheels do not
    # count
    touches: Tuple[Tuple[float, str], ...]
    # time [s] of each change of the controller's state, and the new state with its reason
    events: Tuple[Tuple[float, str], ...]

    @property
    def arrived_at(self) -> Optional[float]:
        """Return the time of the final arrival [s]; None if the robot is not at the pillar in the end."""
        if not self.states or self.states[-1] is not State.ARRIVED:
            return None
        # the robot may arrive and leave again, so the search goes back from the end
        arrival_row = len(self.states) - 1
        while arrival_row > 0 and self.states[arrival_row - 1] is State.ARRIVED:
            arrival_row -= 1
        return float(self.times[arrival_row])

    @property
    def touched(self) -> Tuple[str, ...]:
        """Return the names of the touched bodies, in the order of the first touch."""
        return tuple(name for _, name in self.touches)


@lru_cache(maxsize=None)
def model_of(robot: Robot, profile: str = "gazebo") -> RobotModel:
    """Return the model of a robot with its lidar, without meshes, which only pictures need.

    `profile` decides where a Husky's centre of mass is: 85 mm to the right with "gazebo", as in the published
    model of Gazebo, or amidships with "robot".
    """
    return robot_model(robot_description(robot.name, meshes="", profile=profile), robot)


def rollout(
    scenario: Scenario,
    control: Optional[ControlConfig] = None,
    detector_config: Optional[PillarConfig] = None,
    simulator: Optional[SimulatorConfig] = None,
    seconds: float = 180.0,
    settle: float = 1.0,
    robot: Optional[RobotModel] = None,
    controller: Controller = decide,
) -> Trace:
    """Run a scenario until the robot has arrived, or time is up.

    Args:
        scenario: world, start pose, and seed of the noise.
        control: gains and limits; None for the defaults.
        detector_config: parameters of the pillar detection; None for the defaults.
        simulator: parameters of the simulation and its robot; None for the Husky of Gazebo.
        seconds: simulated time limit [s].
        settle: simulated time for which the run continues after the arrival [s].
        robot: another model of the robot, such as one with an upright lidar; None for the robot's own.
        controller: decision function that answers each scan with a command.

    Raises:
        HuskyError: the world cannot be simulated.
    """
    control, detector_config = control or ControlConfig(), detector_config or PillarConfig()
    simulator = simulator or simulator_config()
    # `simulator.real` has the data of a real Husky, and is None for Gazebo's robot
    profile = "robot" if simulator.real else "gazebo"
    robot = robot or model_of(simulator.robot, profile)
    simulation = Simulation(scenario.world, robot, simulator, scenario.start, scenario.seed)
    laser_in_base = robot.fixed_poses[robot.laser_frame]
    controller_state, arrived_at = ControllerState(), inf
    rows: List[_Row] = []
    touches: Dict[str, float] = {}  # [s] time of the first touch of each body; the key is the body's name
    try:
        while simulation.stamp < min(seconds, arrived_at + settle):
            snapshot = simulation.step()
            for name in snapshot.contacts:
                touches.setdefault(name, snapshot.stamp)  # keeps the time of the first touch
            scan = snapshot.scan
            if scan is None:  # no new scan in this physics step, so there is nothing to decide
                continue
            base_in_odom = _pose_at_begin_of_scan(scan, snapshot)
            observation = Observation(scan, laser_in_base, base_in_odom, simulator.robot.footprint)
            is_enabled = True  # the controller may move the robot
            controller_state, output = controller(
                controller_state, observation, is_enabled, control, detector_config
            )
            simulation.command(output.twist)
            pillar = simulation.pose_of(scenario.pillar).position[:2]
            rows.append(_row(snapshot, scan, output, pillar))
            # [s] time at which the robot has arrived; inf again if the robot leaves the pillar
            arrived_at = min(arrived_at, snapshot.stamp) if output.state is State.ARRIVED else inf
    finally:
        simulation.close()
    return _trace(rows, touches)


def _pose_at_begin_of_scan(scan: Scan, snapshot: Snapshot) -> Pose2D:
    """Return the odometry's pose of base_link in odom at the time of the first beam, which stamps the scan.

    The scan and the odometry come after the last beam, so the pose is moved back by the age of the scan.
    """
    assert snapshot.odometry is not None  # a scan never comes without odometry
    odometry = snapshot.odometry.filtered
    scan_age = snapshot.stamp - scan.stamp
    if scan_age <= 0.0:
        return odometry.pose_base_in_odom
    return advance(odometry.pose_base_in_odom, odometry.twist_in_base, -scan_age)


class _Row(NamedTuple):
    """Values of one scan of a run; values with the name of an array of COLUMNS become a row of this array."""

    times: float
    poses: Pose2D
    twists: Twist2D
    estimates: Tuple[float, ...]
    pillars: Tuple[float, ...]
    distance_errors: float
    bearing_errors: float
    nearest: float
    state: State
    sentence: str  # state of the controller, and the reason for the state


def _row(snapshot: Snapshot, scan: Scan, output: ControlOutput, pillar_in_world: Tuple[float, ...]) -> _Row:
    """Return the values of one scan; the fields of `Trace` describe them."""
    return _Row(
        times=snapshot.stamp,
        poses=pose_to_2d(snapshot.robot.pose_in_world),
        twists=output.twist,
        estimates=output.estimate[:2] if output.estimate else (np.nan, np.nan),
        pillars=pillar_in_world,
        distance_errors=output.distance_error,
        bearing_errors=output.bearing_error,
        nearest=float(np.min(scan.ranges, where=scan.valid, initial=inf)),
        state=output.state,
        sentence=f"{output.state.value}: {output.reason}",
    )


def _trace(rows: Sequence[_Row], touches: Mapping[str, float]) -> Trace:
    """Return the trace of a run.

    Args:
        rows: values of each scan; empty if the run had no scan.
        touches: time of the first touch [s] by body.
    """
    arrays = {}
    for name, width in COLUMNS.items():
        column = np.array([getattr(row, name) for row in rows], dtype=float)
        # the shape is (N, width), or (N,) if the width is 0; it is set here, because N may be 0
        array = column.reshape((-1, width) if width else -1)
        array.setflags(write=False)
        arrays[name] = array
    # a sentence is an event only if it differs from the sentence of the scan before
    events: List[Tuple[float, str]] = []
    for row in rows:
        if not events or row.sentence != events[-1][1]:
            events.append((row.times, row.sentence))
    states = tuple(row.state for row in rows)
    first_touches = tuple((stamp, name) for name, stamp in touches.items())
    return Trace(states=states, touches=first_touches, events=tuple(events), **arrays)
