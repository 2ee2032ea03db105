"""Drive of a submission: a ROS master, a simulator and a recorder of its own, and the recording."""

from __future__ import annotations

import hashlib
import signal
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Callable, Tuple

from husky_grading.drive.bring_up import START_PERIOD, BringUp
from husky_grading.drive.progress import settles
from husky_grading.drive.ros_graph import (
    listens_to,
    registered,
    robot_listened_to,
)
from husky_grading.drive.trials import Trial
from husky_grading.isolation.files import create, read_regular, write_whole
from husky_grading.isolation.forked import RECORDER
from husky_grading.isolation.process import Process, wait
from husky_grading.isolation.ros_network import START_DEADLINE, MarkingError, Network
from husky_grading.notes import Kind, Note
from husky_grading.recording import (
    RECORDING,
    Assignment,
    Closing,
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

STALL_DEADLINE = 90.0  # [s] of wall time in which simulated time must get on
PROGRESS_PERIOD = 0.2  # [s] of wall time between two looks at a drive; each costs the ROS master milliseconds
MAX_RECORDING = 500_000_000  # [bytes]
KEPT_OUTPUT = 20000  # letters of what a submission printed
RECORDER_NODE = "marking_recorder"  # its node's name


class OtherRobotError(HuskyError):
    """A submission that listens to the scans of another robot than it was started with."""

    def __init__(self, config: MarkingConfig) -> None:
        super().__init__(config.robot)
        self.config = config  # with its robot


def drive(
    submission: Submission,
    trial: Trial,
    config: MarkingConfig,
    bring_up: BringUp,
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
        bring_up: starts what it drives in.
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
        known = replace(not_begun(trial, config), uninitialised=chance, watched=submission.facts)
        task = Assignment(
            known, str(output), f"{private}/truth", str(status), str(closing), config.exercise,
            SIMULATOR_NODES, tuple(map(str, submission.workspace.packages)),
        )  # fmt: skip
        assignment.write_text(record_to_json(task))
        recorder = network.start("recorder", [RECORDER, str(assignment)])

        if not wait(status.exists, START_DEADLINE, START_PERIOD) or not recorder.running:
            raise MarkingError(f"the recorder does not start: {recorder.output.strip()[-500:]}")
        simulator = bring_up(network, trial, config, task.truth_socket)
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
            (*submission.own, *submission.parts.by_submission) if submission.own else (),
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
    command = starter(events, action, [submission.launchable], submission.parts, own)
    return network.start(SUBMISSION_FOLDER, command, submission.workspace), events


def _shortened(output: str) -> str:
    half = KEPT_OUTPUT // 2
    return output if len(output) <= KEPT_OUTPUT else f"{output[:half]}\n[...]\n{output[-half:]}"
