"""Drive of a submission: a ROS master, a simulator and a recorder of its own, and the recording."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, Optional, Tuple

from husky_grading.drive.bring_up import START_PERIOD, BringUp
from husky_grading.drive.progress import settles
from husky_grading.drive.recorder_channel import (
    Abandoned,
    Assignment,
    GoOn,
    HandOver,
    RecorderChannel,
)
from husky_grading.drive.robot_choice import RobotChoice
from husky_grading.drive.ros_graph import registered, robot_listened_to
from husky_grading.drive.trials import Trial
from husky_grading.isolation.files import create, write_whole
from husky_grading.isolation.process import Process, wait
from husky_grading.isolation.ros_network import START_DEADLINE, MarkingError, Network
from husky_grading.notes import Kind, Note
from husky_grading.recording import RECORDING, Closing, Recording, closed, recording_to_json
from husky_grading.records import MarkingConfig
from husky_grading.submission import (
    SIMULATOR_NODES,
    SUBMISSION_FOLDER,
    Submission,
    notes_on,
    read_events,
    starter,
)

STALL_DEADLINE = 90.0  # [s] of wall time in which simulated time must get on
PROGRESS_PERIOD = 0.2  # [s] of wall time between two looks at a drive; each costs the ROS master milliseconds
KEPT_OUTPUT = 20000  # letters of what a submission printed
RECORDER_NODE = "marking_recorder"  # its node's name


@dataclass(frozen=True)
class Driven:
    """End of a drive."""

    robot: RobotChoice  # that was simulated; without a recording: that is to be
    recording: Optional[Recording] = None  # None: the submission listens to another robot and has not driven

    @property
    def moved(self) -> bool:
        """Whether the robot has moved."""
        return self.recording is not None and bool(self.recording.moving.any())


def drive_submission(
    submission: Submission,
    trial: Trial,
    robot: RobotChoice,
    bring_up: BringUp,
    folder: Path,
    chance: str = "",
    on_time: Callable[[float], None] = lambda _: None,
) -> Driven:
    """Let a submission drive once, and write recording.json, unless it listens to another robot than a guess.

    Args:
        submission: what to start.
        trial: start and pillar.
        robot: that is simulated.
        bring_up: starts what it drives in.
        folder: for the recording and logs.
        chance: a variable that is read before it is written, in a sentence.
        on_time: gets simulated times [s].

    Raises:
        MarkingError: our own part of it does not work.
    """
    with Network(folder) as network, tempfile.TemporaryDirectory(prefix="husky_") as private:
        truth_socket, packages = f"{private}/truth", tuple(map(str, submission.workspace.packages))
        known = replace(not_begun(trial, robot.config), uninitialised=chance, watched=submission.facts)
        task = Assignment(known, truth_socket, robot.config.exercise, SIMULATOR_NODES, packages)
        recorder = RecorderChannel(network, task)
        wait(lambda: recorder.update().ready or not recorder.is_open, START_DEADLINE, START_PERIOD)
        if not recorder.ready:
            raise MarkingError(f"the recorder does not start: {recorder.process.output.strip()[-500:]}")
        simulator = bring_up(network, trial, robot.config, truth_socket)
        submitted, events = start(network, submission)
        listened = _await_joining(network, recorder, submission, submitted, robot)
        if listened != robot.config:
            return Driven(robot.after_hearing(listened))
        ended = _follow(recorder, submitted, simulator, robot.config, on_time)
        if recorder.subscribed:
            robot = robot.after_hearing(robot.config)
        notes = notes_on(
            read_events(events),
            submitted.output,
            (*submission.own, *submission.parts.by_submission) if submission.own else (),
        )
        if robot.why:
            notes.insert(0, Note(Kind.ROBOT, robot.why))
        if submitted.problem:
            notes.append(Note(Kind.LIMIT, submitted.problem))
        closing = Closing(tuple(notes), ended, _shortened(submitted.output))
        if ended:
            recorder.tell(HandOver())
        wait(lambda: recorder.update().recording is not None or not recorder.is_open, START_DEADLINE)
    if recorder.recording is None:
        raise MarkingError(f"no recording; the recorder said: {recorder.process.output.strip()[-500:]}")
    recording = closed(recorder.recording, closing)
    write_whole(folder / RECORDING, recording_to_json(recording))
    return Driven(robot, recording)


def _await_joining(
    network: Network,
    recorder: RecorderChannel,
    submission: Submission,
    submitted: Process,
    robot: RobotChoice,
) -> MarkingConfig:
    """Wait until the submission takes part, or is not going to; the settings of the robot it listens to.

    These are those of `robot`, unless that is a guess. Without the submission the recorder takes part.
    """
    our_nodes = (f"/{RECORDER_NODE}", *SIMULATOR_NODES)
    joined = settles(
        submitted,
        len(submission.nodes),
        lambda: recorder.update().joined or not recorder.is_open,
        lambda: registered(network.uri, our_nodes),
    )
    if joined:
        return robot.config
    if robot.is_guess:
        listened = robot_listened_to(network.uri, our_nodes, robot.config)
        if listened is not None and listened != robot.config:
            return listened
    recorder.tell(GoOn())
    return robot.config


def _follow(
    recorder: RecorderChannel,
    submitted: Process,
    simulator: Process,
    config: MarkingConfig,
    on_time: Callable[[float], None],
) -> Optional[Note]:
    """Wait until a drive is over; why it has to be cut off, or None."""
    reached, since, told = 0.0, time.monotonic(), False

    def is_over() -> bool:
        nonlocal reached, since, told
        now = recorder.update().now
        on_time(now)
        if now > reached:
            reached, since = now, time.monotonic()
        if not submitted.running and not told:
            recorder.tell(Abandoned())
            told = True
        stalled = time.monotonic() - since > STALL_DEADLINE
        return stalled or recorder.over or not recorder.is_open or not simulator.running

    if not wait(is_over, config.wall_limit, PROGRESS_PERIOD):
        return Note(Kind.SLOW, f"it took longer than {config.wall_limit:.0f} s")
    if recorder.over or not recorder.is_open:
        return None
    if simulator.running:
        return Note(Kind.STALLED, f"the simulation made no progress for {STALL_DEADLINE:g} s")
    return Note(Kind.STALLED, "the simulator was ended")


def not_begun(trial: Trial, config: MarkingConfig) -> Recording:
    """Recording of a drive that has not begun."""
    return Recording(
        trial.start, trial.pillar, config.deadline, robot=config.robot_name, simulated=config.robot,
        scan_topic=config.scan_topic,
    )  # fmt: skip


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
