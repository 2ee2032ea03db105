"""Start of the simulator for a run: its launch file, with the world of a trial."""

from __future__ import annotations

import json
from typing import Any, Callable, Dict, List, Protocol, Tuple

from husky_grading.drive.ros_graph import has_service, set_parameters
from husky_grading.drive.trials import Trial, trial_world
from husky_grading.isolation.forked import SIMULATOR, SIMULATOR_SETUP
from husky_grading.isolation.process import Process, wait, wait_and_kill
from husky_grading.isolation.ros_network import START_DEADLINE, MarkingError, Network
from husky_grading.records import MarkingConfig
from husky_grading.submission import SIMULATOR_NODES
from husky_highlevel_controller.paths import share_folder

SIMULATOR_LAUNCH = share_folder() / "launch" / "simulator.launch"
START_PERIOD = 0.05  # [s] wall time between two checks whether a started program is ready
# the simulator offers this service last, so the simulator is ready when the service exists
SIMULATOR_IS_UP = "/husky_simulator/step"
(SIMULATOR_NODE,) = SIMULATOR_NODES
# cache: parameters and command-line arguments of the simulator, by the launch arguments from which they come
_SETUPS: Dict[Tuple[str, ...], Tuple[Dict[str, Any], List[str]]] = {}


class BringUp(Protocol):
    """Function that starts the simulator, or in exercise 4 the bag player, and waits until it is up."""

    def __call__(
        self, network: Network, trial: Trial, config: MarkingConfig, truth_socket: str = ""
    ) -> Process:
        """Start the program. If `truth_socket` is not empty, it writes true poses to this socket."""


def simulate(network: Network, trial: Trial, config: MarkingConfig, truth_socket: str = "") -> Process:
    """Start our simulator with the world of a trial, and wait until it is up.

    With a `truth_socket`, the simulator writes true poses to this socket, and runs in lockstep: simulated
    time stops after each scan until a command has come.

    Raises:
        MarkingError: the simulator does not start.
    """
    file = network.folder / "drive.world"
    file.write_text(trial_world(trial, config.robot_name))
    # a submission could infer the pillar's position from these parameters, so they are set to 0 as soon as
    # the simulator has read them
    secret_values = {
        "world_name": str(file), "x": trial.start.x, "y": trial.start.y, "yaw": trial.start.yaw,
        "seed": trial.seed,
    }  # fmt: skip
    values = {**secret_values, "real_time_factor": config.pace, "lockstep": bool(truth_socket)}
    arguments = set_robot_parameters(network, config)
    set_parameters(network.uri, {f"{SIMULATOR_NODE}/{name}": value for name, value in values.items()})
    simulator = network.start("simulator", [SIMULATOR, *arguments], HUSKY_TRUTH_SOCKET=truth_socket)
    once_up(simulator, lambda: has_service(network.uri, SIMULATOR_IS_UP))
    set_parameters(network.uri, {f"{SIMULATOR_NODE}/{name}": 0 for name in secret_values})
    return simulator


def set_robot_parameters(network: Network, config: MarkingConfig) -> List[str]:
    """Set the parameters of simulator.launch, as roslaunch would, and return the simulator's arguments.

    The simulator is then forked, and not started by roslaunch. The program SIMULATOR_SETUP reads the launch
    file, once for all runs with the same launch arguments.

    Raises:
        MarkingError: the launch file cannot be read.
    """
    launch_arguments = config.simulator_arguments
    if launch_arguments not in _SETUPS:
        # without these arguments, environment variables decide about RViz and the lidar
        fixed = ["rviz:=false", "laser_enabled:=true", "laser_tower:=true"]
        process = network.start(
            "simulator_setup", [SIMULATOR_SETUP, str(SIMULATOR_LAUNCH), *fixed, *launch_arguments]
        )
        wait_and_kill(process, START_DEADLINE)
        try:
            # the program prints its result as JSON in the last line; ROS may print other lines before it
            setup = json.loads(process.output.splitlines()[-1])
        except (ValueError, IndexError):
            raise MarkingError(f"the simulator does not start: {process.output.strip()[-500:]}") from None
        _SETUPS[launch_arguments] = setup["parameters"], setup["arguments"]
    parameters, arguments = _SETUPS[launch_arguments]
    # roslaunch would also set /run_id, but to a new name in each run
    set_parameters(network.uri, {"/run_id": "marking", **parameters})
    return arguments


def once_up(simulator: Process, is_up: Callable[[], bool]) -> Process:
    """Wait until the simulator, or the bag player in its place, is up, and return it.

    The function `is_up` returns whether it is up.

    Raises:
        MarkingError: the program does not start.
    """
    up = wait(lambda: is_up() or not simulator.running, START_DEADLINE, START_PERIOD)
    if not up or not simulator.running:
        raise MarkingError(f"the simulator does not start: {simulator.output.strip()[-500:]}")
    return simulator
