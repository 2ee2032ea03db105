"""Drive of a submission: a ROS master, a simulator and a recorder of its own, and the recording."""

from __future__ import annotations

import json
import re
import signal
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

from husky_highlevel_controller.grading.drive.call_plan import BAG
from husky_highlevel_controller.grading.drive.plan import (
    SIMULATOR_LAUNCH,
    SIMULATOR_NODES,
    Submission,
    notes_on,
    read_events,
    start,
)
from husky_highlevel_controller.grading.drive.progress import settles
from husky_highlevel_controller.grading.drive.robot_version import check_robot
from husky_highlevel_controller.grading.drive.ros_graph import (
    has_service,
    is_up,
    set_parameters,
)
from husky_highlevel_controller.grading.drive.trials import Trial, trial_world
from husky_highlevel_controller.grading.isolation.files import write_whole
from husky_highlevel_controller.grading.isolation.forked import (
    BAG_PLAYER,
    RECORDER,
    SIMULATOR,
    SIMULATOR_SETUP,
)
from husky_highlevel_controller.grading.isolation.process import Process, wait
from husky_highlevel_controller.grading.isolation.ros_network import START_DEADLINE, MarkingError, Network
from husky_highlevel_controller.grading.notes import Kind, Note
from husky_highlevel_controller.grading.recording import (
    CUT_OFF,
    RECORDING,
    Assignment,
    ExchangedError,
    Recording,
    RecordingError,
    empty_recording,
    load,
    to_json,
)
from husky_highlevel_controller.grading.records import MarkingConfig
from husky_highlevel_controller.grading.records import to_json as record_to_json
from husky_highlevel_controller.robot import load_robot

STALL_DEADLINE = 90.0  # [s] of wall time in which simulated time must get on
PROGRESS_PERIOD = 0.2  # [s] of wall time between two looks at a drive; each costs the ROS master milliseconds
START_PERIOD = 0.05  # [s] of wall time between two looks at a program of ours that starts
FLOOD = 300.0  # commands a simulated second; 50 answer the scans
KEPT_OUTPUT = 20000  # letters of what a submission printed
RECORDER_NODE = "marking_recorder"  # its node's name
_SETUPS: Dict[Tuple[str, ...], Tuple[Dict[str, Any], List[str]]] = {}  # by launch arguments
SIMULATOR_IS_UP = "/husky_simulator/step"  # the last service that it offers


def simulate(
    network: Network,
    world: str,
    trial: Trial,
    config: MarkingConfig,
    pace: float,
    truth_socket: str = "",
) -> Process:
    """Start our simulator with a world, and wait until it is up.

    With a socket it writes true poses there, and runs in lockstep; `pace` is its real-time factor.

    Raises:
        MarkingError: it does not start.
    """
    file = network.folder / "drive.world"
    file.write_text(world)
    parameters, arguments = _simulator_setup(network, config.simulator_arguments)
    values = {
        "world_name": str(file), "x": trial.start.x, "y": trial.start.y, "yaw": trial.start.yaw,
        "seed": trial.seed, "real_time_factor": pace, "lockstep": bool(truth_socket),
    }  # fmt: skip
    simulator_values = {f"{SIMULATOR_NODES[0]}/{name}": value for name, value in values.items()}
    set_parameters(network.uri, {"/run_id": "marking", **parameters, **simulator_values})
    simulator = network.start("simulator", [SIMULATOR, *arguments], HUSKY_TRUTH_SOCKET=truth_socket)
    return _once_up(simulator, lambda: has_service(network.uri, SIMULATOR_IS_UP))


def _once_up(simulator: Process, is_up: Callable[[], bool]) -> Process:
    up = wait(lambda: is_up() or not simulator.running, START_DEADLINE, START_PERIOD)
    if not up or not simulator.running:
        raise MarkingError(f"the simulator does not start: {simulator.output.strip()[-500:]}")
    return simulator


def play(network: Network, trial: Trial, config: MarkingConfig, truth_socket: str) -> Process:
    """Start the player of the bag in the simulator's place; a signal SIGUSR1 lets it begin.

    Raises:
        MarkingError: it does not start.
    """
    parameters, _ = _simulator_setup(network, config.simulator_arguments)
    set_parameters(network.uri, {"/run_id": "marking", **parameters})
    numbers = map(str, (trial.seed, config.pace, config.deadline))
    command = [BAG_PLAYER, config.robot_name, *numbers]
    player = network.start("simulator", command, HUSKY_TRUTH_SOCKET=truth_socket)
    return _once_up(player, lambda: bool(_told(player, "ready")))


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
        wait(lambda: not process.running, START_DEADLINE, START_PERIOD)
        process.kill()
        try:
            setup = json.loads(process.output.splitlines()[-1])
        except (ValueError, IndexError):
            raise MarkingError(f"the simulator does not start: {process.output.strip()[-500:]}") from None
        _SETUPS[arguments] = setup["parameters"], setup["arguments"]
    return _SETUPS[arguments]


def drive(
    submission: Submission,
    trial: Trial,
    config: MarkingConfig,
    folder: Path,
    on_time: Callable[[float], None] = lambda _: None,
    is_guess: bool = False,
) -> Recording:
    """Let the submission drive once, and bring back what was seen; `on_time` gets simulated times [s].

    Raises:
        MarkingError: our own part of it does not work.
        OtherRobotError: the robot is a guess, and it listens to another one's scans; it has not driven.
    """
    with Network(folder) as network, tempfile.TemporaryDirectory(prefix="husky_") as private:
        output, assignment = folder / RECORDING, folder / "assignment.json"
        topic, plays = config.scan_topic, trial.driver == BAG
        if plays:
            topic = f"/{load_robot(config.robot_name).topics.wheel_odometry}"
        task = Assignment(
            str(output), f"{private}/truth", trial.start, trial.pillar, config.deadline, topic,
            config.robot_name, trial.driver, trial.ends_at_pillar, SIMULATOR_NODES,
            tuple(map(str, submission.workspace.packages)),
        )  # fmt: skip
        assignment.write_text(record_to_json(task))
        recorder = network.start("recorder", [RECORDER, str(assignment)])

        def told(word: str) -> bool:
            return not recorder.running or bool(_told(recorder, word))

        wait(lambda: told("recording"), START_DEADLINE, START_PERIOD)
        if not recorder.running:
            raise MarkingError(f"the recorder does not start: {recorder.output.strip()[-500:]}")
        if plays:
            simulator = play(network, trial, config, task.truth_socket)
        else:
            world = trial_world(trial, config.robot_name)
            simulator = simulate(network, world, trial, config, config.pace, task.truth_socket)
        submitted, events = start(network, submission)
        our_nodes = (f"/{RECORDER_NODE}", *SIMULATOR_NODES)
        joined = settles(submitted, lambda: told("joined"), lambda: is_up(network.uri, our_nodes))
        if is_guess and not joined:
            check_robot(network.uri, our_nodes, config.scan_topic)
        if recorder.running and not joined:
            recorder.popen.send_signal(signal.SIGUSR1)  # lockstep would wait for the submission
        if plays:
            simulator.popen.send_signal(signal.SIGUSR1)

        reached, since = 0.0, time.monotonic()

        def is_over() -> bool:
            nonlocal reached, since
            now = float(["0", *_told(recorder, r"now ([\d.]+)")][-1])
            on_time(now)
            if now > reached:
                reached, since = now, time.monotonic()
            stalled = time.monotonic() - since > STALL_DEADLINE
            if not submitted.running:
                recorder.popen.send_signal(signal.SIGUSR2)  # no node is left to drive it
            return stalled or not (recorder.running and simulator.running)

        ended = None
        if not wait(is_over, config.wall_limit, PROGRESS_PERIOD):
            ended = Note(Kind.SLOW, f"it took longer than {config.wall_limit:.0f} s")
        elif recorder.running and simulator.running:
            ended = Note(Kind.STALLED, f"the simulation made no progress for {STALL_DEADLINE:g} s")
        elif recorder.running:
            ended = Note(Kind.STALLED, "the simulator was ended")
        if ended:
            recorder.interrupt()
            wait(lambda: not recorder.running, START_DEADLINE)
        notes = notes_on(read_events(events), submitted.output)
        notes += [Note(Kind.LIMIT, submitted.problem)] * bool(submitted.problem)
    recording = _finish(output, recorder, trial, config, notes, ended, submitted.output)
    write_whole(output, to_json(recording))
    return recording


def _told(recorder: Process, line: str) -> List[str]:
    """Lines of the recorder that match, or the group in them."""
    return re.findall(rf"^{line}$", recorder.output, re.MULTILINE)


def _finish(
    path: Path,
    recorder: Process,
    trial: Trial,
    config: MarkingConfig,
    notes: Sequence[Note],
    ended: Optional[Note],
    output: str,
) -> Recording:
    """The recording that the recorder wrote, with notes, the end, and what was printed."""
    try:
        recording = load(path, "".join(_told(recorder, r"sha256 (\w{64})")))
    except ExchangedError as error:
        recording = empty_recording(trial.pillar, config.deadline, (Note(Kind.CUT_OFF, str(error)),))
        recording = replace(recording, violations=(str(error),))
    except RecordingError as error:
        raise MarkingError(f"{error}; the recorder said: {recorder.output.strip()[-500:]}") from error
    if len(output) > KEPT_OUTPUT:
        output = output[: KEPT_OUTPUT // 2] + "\n[...]\n" + output[-KEPT_OUTPUT // 2 :]
    died = any(note.kind in (Kind.NODE_ENDED, Kind.NODE_FAILED) for note in notes)
    notes = [*notes, *([] if died else recording.notes)]
    seconds = max(float(recording.times[-1]), 1.0) if len(recording.times) else 1.0
    if recording.command_count / seconds > FLOOD:
        words = f"it floods cmd_vel: {recording.command_count} commands in {seconds:.0f} s"
        notes.append(Note(Kind.FLOOD, words))
    if ended or recording.ended == CUT_OFF:
        why = ended.text if ended else "the recorder was ended"
        notes.append(Note(Kind.CUT_OFF, f"the drive was cut off at {seconds:.2f} s: {why}", seconds))
    return replace(recording, notes=tuple(notes), ended=ended or recording.ended, output=output)
