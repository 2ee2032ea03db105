"""Drive of a submission: a ROS master, a simulator and a recorder of its own, and the recording."""

from __future__ import annotations

import hashlib
import json
import re
import signal
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

from husky_grading.drive.call_plan import BAG
from husky_grading.drive.progress import settles
from husky_grading.drive.ros_graph import (
    has_service,
    listens_to,
    registered,
    robot_listened_to,
    set_parameters,
)
from husky_grading.drive.trials import Trial, trial_world
from husky_grading.isolation.files import create, read_regular, write_whole
from husky_grading.isolation.forked import (
    BAG_PLAYER,
    RECORDER,
    SIMULATOR,
    SIMULATOR_SETUP,
)
from husky_grading.isolation.process import Process, ends, wait
from husky_grading.isolation.ros_network import START_DEADLINE, MarkingError, Network
from husky_grading.notes import Kind, Note
from husky_grading.recording import (
    RECORDING,
    Assignment,
    Closing,
    Playback,
    Recording,
    Status,
    to_json,
)
from husky_grading.records import MarkingConfig
from husky_grading.submission import (
    SIMULATOR_NODES,
    SUBMISSION_FOLDER,
    Submission,
    notes_on,
    read_events,
    starter,
)
from husky_highlevel_controller.config import load
from husky_highlevel_controller.config import to_json as record_to_json
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.robot import load_robot

SIMULATOR_LAUNCH = share_folder() / "launch" / "simulator.launch"
STALL_DEADLINE = 90.0  # [s] of wall time in which simulated time must get on
PROGRESS_PERIOD = 0.2  # [s] of wall time between two looks at a drive; each costs the ROS master milliseconds
START_PERIOD = 0.05  # [s] of wall time between two looks at a program of ours that starts
MAX_RECORDING = 500_000_000  # [bytes]
KEPT_OUTPUT = 20000  # letters of what a submission printed
RECORDER_NODE = "marking_recorder"  # its node's name
_SETUPS: Dict[Tuple[str, ...], Tuple[Dict[str, Any], List[str]]] = {}  # by launch arguments
SIMULATOR_IS_UP = "/husky_simulator/step"  # the last service that it offers


def simulate(
    network: Network,
    trial: Trial,
    config: MarkingConfig,
    pace: float,
    truth_socket: str = "",
) -> Process:
    """Start our simulator with the world of a trial, and wait until it is up.

    With a socket it writes true poses there, and runs in lockstep; `pace` is its real-time factor.

    Raises:
        MarkingError: it does not start.
    """
    file = network.folder / "drive.world"
    file.write_text(trial_world(trial, config.robot_name))
    parameters, arguments = _simulator_setup(network, config.simulator_arguments)
    start = {
        "world_name": str(file), "x": trial.start.x, "y": trial.start.y, "yaw": trial.start.yaw,
        "seed": trial.seed,
    }  # fmt: skip
    values = {**start, "real_time_factor": pace, "lockstep": bool(truth_socket)}
    simulator_values = {f"{SIMULATOR_NODES[0]}/{name}": value for name, value in values.items()}
    set_parameters(network.uri, {"/run_id": "marking", **parameters, **simulator_values})
    simulator = network.start("simulator", [SIMULATOR, *arguments], HUSKY_TRUTH_SOCKET=truth_socket)
    _once_up(simulator, lambda: has_service(network.uri, SIMULATOR_IS_UP))
    # a submission could draw from them where the pillar is
    set_parameters(network.uri, {f"{SIMULATOR_NODES[0]}/{name}": 0 for name in start})
    return simulator


def _once_up(simulator: Process, is_up: Callable[[], bool]) -> Process:
    up = wait(lambda: is_up() or not simulator.running, START_DEADLINE, START_PERIOD)
    if not up or not simulator.running:
        raise MarkingError(f"the simulator does not start: {simulator.output.strip()[-500:]}")
    return simulator


def play(network: Network, trial: Trial, config: MarkingConfig, pace: float, truth_socket: str) -> Process:
    """Start the player of the bag in the simulator's place.

    Raises:
        MarkingError: it does not start.
    """
    parameters, _ = _simulator_setup(network, config.simulator_arguments)
    set_parameters(network.uri, {"/run_id": "marking", **parameters})
    numbers = map(str, (trial.seed, pace, config.deadline))
    command = [BAG_PLAYER, config.robot_name, *numbers]
    player = network.start("simulator", command, HUSKY_TRUTH_SOCKET=truth_socket)
    return _once_up(player, lambda: bool(_lines(player, "ready")))


def _simulator_setup(network: Network, arguments: Tuple[str, ...]) -> Tuple[Dict[str, Any], List[str]]:
    """The simulator's parameters by its launch file, read once, and its arguments.

    Raises:
        MarkingError: the launch file cannot be read.
    """
    if arguments not in _SETUPS:
        fixed = ["rviz:=false", "laser_enabled:=true", "laser_tower:=true"]
        process = network.start(
            "simulator_setup", [SIMULATOR_SETUP, str(SIMULATOR_LAUNCH), *fixed, *arguments]
        )
        ends(process, START_DEADLINE)
        try:
            setup = json.loads(process.output.splitlines()[-1])
        except (ValueError, IndexError):
            raise MarkingError(f"the simulator does not start: {process.output.strip()[-500:]}") from None
        _SETUPS[arguments] = setup["parameters"], setup["arguments"]
    return _SETUPS[arguments]


class OtherRobotError(HuskyError):
    """A submission that listens to the scans of another robot than it was started with."""

    def __init__(self, config: MarkingConfig) -> None:
        super().__init__(config.robot)
        self.config = config  # with its robot


def drive(
    submission: Submission,
    trial: Trial,
    config: MarkingConfig,
    folder: Path,
    note: str = "",
    chance: str = "",
    on_time: Callable[[float], None] = lambda _: None,
    is_guess: bool = False,
) -> bool:
    """Let a submission drive once, and write recording.json; whether it moved.

    Args:
        submission: what to start.
        trial: start and pillar.
        config: with its robot.
        folder: for the recording and logs.
        note: on the robot.
        chance: a variable that is read before it is written, in a sentence.
        on_time: gets simulated times [s].
        is_guess: the robot is one.

    Raises:
        MarkingError: our own part of it does not work.
        OtherRobotError: the robot is a guess, and it listens to another one's scans; it has not driven.
    """
    with Network(folder) as network, tempfile.TemporaryDirectory(prefix="husky_") as private:
        output, assignment = folder / RECORDING, folder / "assignment.json"
        status, closing = Path(private, "status"), Path(private, "closing")
        known, plays = replace(not_begun(trial, config), uninitialised=chance), trial.driver == BAG
        if plays:
            topic = f"/{load_robot(config.robot_name).topics.wheel_odometry}"
            played = Playback(players=submission.players, curves=submission.curves)
            known = replace(known, scan_topic=topic, playback=played)
        task = Assignment(
            known, str(output), f"{private}/truth", str(status), str(closing), trial.driver,
            trial.ends_at_pillar, SIMULATOR_NODES, tuple(map(str, submission.workspace.packages)),
        )  # fmt: skip
        assignment.write_text(record_to_json(task))
        recorder = network.start("recorder", [RECORDER, str(assignment)])

        if not wait(status.exists, START_DEADLINE, START_PERIOD) or not recorder.running:
            raise MarkingError(f"the recorder does not start: {recorder.output.strip()[-500:]}")
        bring_up = play if plays else simulate
        simulator = bring_up(network, trial, config, config.pace, task.truth_socket)
        submitted, events = start(network, submission)
        our_nodes = (f"/{RECORDER_NODE}", *SIMULATOR_NODES)

        def told() -> Status:
            return load(Status, status)

        def has_joined() -> bool:
            return not recorder.running or told().joined

        def has_ended() -> bool:
            return not recorder.running or told().over

        nodes = len(submission.nodes)
        joined = settles(submitted, nodes, has_joined, lambda: registered(network.uri, our_nodes))
        if is_guess and not joined:
            listened = robot_listened_to(network.uri, our_nodes, config) or config
            if listened != config:
                raise OtherRobotError(listened)
        if recorder.running and not joined:
            recorder.popen.send_signal(signal.SIGUSR1)  # lockstep would wait for the submission

        reached, since = 0.0, time.monotonic()

        def is_over() -> bool:
            nonlocal reached, since
            now = told().now
            on_time(now)
            if now > reached:
                reached, since = now, time.monotonic()
            stalled = time.monotonic() - since > STALL_DEADLINE
            if not submitted.running:
                recorder.popen.send_signal(signal.SIGUSR2)  # no node is left to drive it
            return stalled or has_ended() or not simulator.running

        ended = None
        if not wait(is_over, config.wall_limit, PROGRESS_PERIOD):
            ended = Note(Kind.SLOW, f"it took longer than {config.wall_limit:.0f} s")
        elif not has_ended() and simulator.running:
            ended = Note(Kind.STALLED, f"the simulation made no progress for {STALL_DEADLINE:g} s")
        elif not has_ended():
            ended = Note(Kind.STALLED, "the simulator was ended")
        if is_guess and told().subscribed:
            note = listens_to(config)
        notes = [Note(Kind.ROBOT, note)] * bool(note) + notes_on(
            read_events(events),
            submitted.output,
            (*submission.own, *submission.kept) if submission.own else (),
        )
        notes += [Note(Kind.LIMIT, submitted.problem)] * bool(submitted.problem)
        write_whole(closing, record_to_json(Closing(tuple(notes), ended, _shortened(submitted.output))))
        if ended:
            recorder.interrupt()
        wait(lambda: not recorder.running, START_DEADLINE)
        digest = told().sha256
    if not output.is_file():
        raise MarkingError(f"no recording; the recorder said: {recorder.output.strip()[-500:]}")
    if was_exchanged(output, digest):
        violation = f"{RECORDING} was exchanged after the drive"
        exchanged = replace(not_begun(trial, config), violations=(violation,))
        write_whole(output, to_json(replace(exchanged, notes=(Note(Kind.CUT_OFF, violation),))))
        return False
    return bool(load(Recording, output).moving.any())


def not_begun(trial: Trial, config: MarkingConfig) -> Recording:
    """Recording of a drive that has not begun."""
    return Recording(
        trial.start, trial.pillar, config.deadline, robot=config.robot_name, simulated=config.robot,
        scan_topic=config.scan_topic,
    )  # fmt: skip


def was_exchanged(path: Path, digest: str) -> bool:
    """Whether a file is not the one whose SHA-256 its writer told, if it told one."""
    return bool(digest) and hashlib.sha256(read_regular(path, MAX_RECORDING)).hexdigest() != digest


def start(network: Network, submission: Submission, action: str = "run") -> Tuple[Process, Path]:
    """Start a submission in a network; the program, and the file of its events."""
    events = network.folder_of(SUBMISSION_FOLDER) / "events.jsonl"
    create(events).close()
    own = submission.workspace.own
    command = starter(events, action, [submission.launchable], submission.kept, own)
    return network.start(SUBMISSION_FOLDER, command, submission.workspace), events


def _lines(program: Process, line: str) -> List[str]:
    """Lines of a program that match, or the group in them."""
    return re.findall(rf"^{line}$", program.output, re.MULTILINE)


def _shortened(output: str) -> str:
    half = KEPT_OUTPUT // 2
    return output if len(output) <= KEPT_OUTPUT else f"{output[:half]}\n[...]\n{output[-half:]}"
