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
# cache: parameters and command-line arguments of the simulator, by the launch arguments from which they come
_SETUPS: Dict[Tuple[str, ...], Tuple[Dict[str, Any], List[str]]] = {}


class BringUp(Protocol):
    """Function that starts the simulator of a run, or the program in its place, and waits until it is up."""

    def __call__(
        self, network: Network, trial: Trial, config: MarkingConfig, truth_socket: str = ""
    ) -> Process:
        """Start the program. If `truth_socket` is not empty, it writes true poses to this socket."""


def simulate(network: Network, trial: Trial, config: MarkingConfig, truth_socket: str = "") -> Process:
    """Start our simulator with the world of a trial, and wait until it is up.

    With a `truth_socket` the simulator writes true poses to this socket, and runs in lockstep.

    Raises:
        MarkingError: the simulator does not start.
    """
    file = network.folder / "drive.world"
    file.write_text(trial_world(trial, config.robot_name))
    # a submission could infer the pillar's position from these parameters, so they are set to 0 after the
    # start
    start = {
        "world_name": str(file), "x": trial.start.x, "y": trial.start.y, "yaw": trial.start.yaw,
        "seed": trial.seed,
    }  # fmt: skip
    # in lockstep, simulated time stops after each scan until a command has come
    values = {**start, "real_time_factor": config.pace, "lockstep": bool(truth_socket)}
    # values of the simulator's parameters, by the full names of the parameters
    simulator_values = {f"{SIMULATOR_NODES[0]}/{name}": value for name, value in values.items()}
    arguments = set_robot_parameters(network, config)
    set_parameters(network.uri, simulator_values)
    simulator = network.start("simulator", [SIMULATOR, *arguments], HUSKY_TRUTH_SOCKET=truth_socket)
    once_up(simulator, lambda: has_service(network.uri, SIMULATOR_IS_UP))
    # the simulator has read these parameters; now they are set to 0, because they would help a submission to
    # find the pillar
    set_parameters(network.uri, {f"{SIMULATOR_NODES[0]}/{name}": 0 for name in start})
    return simulator


def set_robot_parameters(network: Network, config: MarkingConfig) -> List[str]:
    """Set the parameters of the simulator's launch file, and return the simulator's arguments.

    The launch file is read once for the same launch arguments.

    Raises:
        MarkingError: the launch file cannot be read.
    """
    launch_arguments = config.simulator_arguments
    if launch_arguments not in _SETUPS:
        # these arguments replace the defaults from environment variables: no RViz, and the lidar on its tower
        fixed = ["rviz:=false", "laser_enabled:=true", "laser_tower:=true"]
        process = network.start(
            "simulator_setup", [SIMULATOR_SETUP, str(SIMULATOR_LAUNCH), *fixed, *launch_arguments]
        )
        wait_and_kill(process, START_DEADLINE)
        try:
            # the result is the last line of the output; ROS may print other lines before it
            setup = json.loads(process.output.splitlines()[-1])
        except (ValueError, IndexError):
            raise MarkingError(f"the simulator does not start: {process.output.strip()[-500:]}") from None
        _SETUPS[launch_arguments] = setup["parameters"], setup["arguments"]
    # parameters for the ROS master, and arguments for the simulator's command line
    parameters, arguments = _SETUPS[launch_arguments]
    set_parameters(network.uri, {"/run_id": "marking", **parameters})
    return arguments


def once_up(simulator: Process, is_up: Callable[[], bool]) -> Process:
    """Wait until the simulator, or the program in its place, is up, and return it.

    Raises:
        MarkingError: the program does not start.
    """
    up = wait(lambda: is_up() or not simulator.running, START_DEADLINE, START_PERIOD)
    if not up or not simulator.running:
        raise MarkingError(f"the simulator does not start: {simulator.output.strip()[-500:]}")
    return simulator
