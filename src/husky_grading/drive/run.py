"""Run of a submission: a ROS master, a simulator and a recorder of its own, and the recording."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, Optional, Tuple

from husky_grading.drive.bring_up import START_PERIOD, BringUp
from husky_grading.drive.progress import wait_while_active
from husky_grading.drive.recorder_channel import (
    Abandoned,
    Assignment,
    GoOn,
    HandOver,
    RecorderChannel,
)
from husky_grading.drive.robot_choice import RobotChoice
from husky_grading.drive.ros_graph import read_registrations, robot_listened_to
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

STALL_DEADLINE = 90.0  # [s] a run ends if simulated time has not advanced for this wall time
# [s] wall time between two checks whether a run is over
PROGRESS_PERIOD = 0.2
RECORDER_NODE = "marking_recorder"


@dataclass(frozen=True)
class Driven:
    """Result of a run; there is no recording if the wrong robot was simulated."""

    # robot that was simulated; without a recording, robot with which the run must be repeated
    robot: RobotChoice
    recording: Optional[Recording] = None

    @property
    def moved(self) -> bool:
        """Return whether the robot has moved."""
        return self.recording is not None and bool(self.recording.moving.any())


def drive_submission(
    submission: Submission,
    trial: Trial,
    robot: RobotChoice,
    bring_up: BringUp,
    folder: Path,
    unwritten_variable: str = "",
    on_time: Callable[[float], None] = lambda _: None,
) -> Driven:
    """Let a submission drive once, and write recording.json.

    If the robot is a guess and the submission subscribes to another robot's scans, the run ends at once, and
    nothing is written. The result then has the robot with which the caller must repeat the run.

    Args:
        submission: submission to start.
        trial: start and pillar.
        robot: robot to simulate.
        bring_up: function that starts the simulator, or a program in its place, such as the bag player.
        folder: folder for the recording and logs.
        unwritten_variable: sentence on a variable that is read before it is written; empty if there is none.
        on_time: function that is called with simulated times [s].

    Raises:
        MarkingError: the network, the simulator or the recorder does not work.
    """
    # the socket for the true poses is in a folder that the submission does not see
    with Network(folder) as network, tempfile.TemporaryDirectory(prefix="husky_") as private:
        truth_socket = f"{private}/truth"
        task = _assignment(submission, trial, robot, unwritten_variable, truth_socket)
        recorder = _start_recorder(network, task)
        simulator = bring_up(network, trial, robot.config, truth_socket)
        submitted, events_file = start_submission(network, submission)
        # settings with the robot whose scans the submission receives
        right_config = _wait_until_it_takes_part(network, recorder, submission, submitted, robot)
        if right_config != robot.config:  # the guess was wrong
            return Driven(robot.after_hearing(right_config))
        # reason why the run must be cut off; None if the recorder itself has ended the run
        cut_off = _follow(recorder, submitted, simulator, robot.config, on_time)
        if recorder.subscribed:  # the submission has subscribed to the scans of the simulated robot
            robot = robot.confirmed()
        # The process is observed now, because the end of the network will end the submission, too. Then the
        # ends of its nodes would look like faults.
        closing = _observations(submission, submitted, events_file, robot, cut_off)
        # the recorder sends its recording by itself only if it has ended the run
        if cut_off:
            recorder.send(HandOver())
        wait(lambda: recorder.update().recording is not None or not recorder.is_open, START_DEADLINE)
    if recorder.recording is None:
        raise MarkingError(f"the recorder sent no recording: {recorder.process.output.strip()[-500:]}")
    recording = closed(recorder.recording, closing)
    write_whole(folder / RECORDING, recording_to_json(recording))
    return Driven(robot, recording)


def _assignment(
    submission: Submission, trial: Trial, robot: RobotChoice, unwritten_variable: str, truth_socket: str
) -> Assignment:
    """Return the task of the recorder, with a recording to which it adds the run.

    The recording already has the facts that the exercise has found in the submission's files.
    """
    initial = replace(
        not_begun(trial, robot.config), uninitialised=unwritten_variable, watched=submission.facts
    )
    packages = tuple(map(str, submission.workspace.packages))
    return Assignment(initial, truth_socket, robot.config.exercise, ours=SIMULATOR_NODES, packages=packages)


def _start_recorder(network: Network, task: Assignment) -> RecorderChannel:
    """Start the recorder of a run, and wait until it is ready.

    Raises:
        MarkingError: the recorder does not start.
    """
    recorder = RecorderChannel(network, task)
    # `update` takes in the messages that have come, and returns the recorder itself
    wait(lambda: recorder.update().ready or not recorder.is_open, START_DEADLINE, START_PERIOD)
    if not recorder.ready:
        raise MarkingError(f"the recorder does not start: {recorder.process.output.strip()[-500:]}")
    return recorder


def _observations(
    submission: Submission, submitted: Process, events_file: Path, robot: RobotChoice, cut_off: Optional[Note]
) -> Closing:
    """Return what the recorder does not know of a run: notes, output of the submission, reason of a cut-off.

    Args:
        submission: submission that was started.
        submitted: process of the submission.
        events_file: file with the events of the submission.
        robot: robot that was simulated, with the reason for its choice.
        cut_off: reason why the run must be cut off; None if the recorder has ended the run.
    """
    output = submitted.output
    # packages whose nodes count as the student's work, such as robot_localization in exercise 4; empty if the
    # student's packages are unknown
    own_packages = (*submission.own, *submission.parts.by_submission) if submission.own else ()
    notes = notes_on(read_events(events_file), output, own_packages)
    if robot.why:  # the first note gives the reason for the choice of the robot
        notes.insert(0, Note(Kind.ROBOT, robot.why))
    # a problem means that a limit, such as the limit of memory, has ended the submission
    if submitted.problem:
        notes.append(Note(Kind.LIMIT, submitted.problem))
    return Closing(tuple(notes), cut_off, output)


def _wait_until_it_takes_part(
    network: Network,
    recorder: RecorderChannel,
    submission: Submission,
    submitted: Process,
    robot: RobotChoice,
) -> MarkingConfig:
    """Wait until the submission takes part in the run, and return the settings with the robot that fits it.

    A submission normally takes part as soon as it subscribes to the scans and has a publisher of commands.
    Simulated time begins only then, so a slow start costs no points. If the submission is not active any more
    before that, simulated time begins without it. The result has another robot than `robot` only if `robot`
    is a guess, and the submission subscribes to the scans of the other robot. The caller then starts the run
    again with the other robot.

    Args:
        network: ROS network of the run.
        recorder: recorder, which finds out whether the submission takes part.
        submission: submission that was started.
        submitted: process of the submission.
        robot: robot that is simulated.
    """
    our_nodes = (f"/{RECORDER_NODE}", *SIMULATOR_NODES)  # nodes that do not belong to the submission
    # also true if the recorder has ended; `drive_submission` then raises an error, because no recording comes
    has_joined = wait_while_active(
        submitted,
        node_count=len(submission.nodes),
        condition=lambda: recorder.update().joined or not recorder.is_open,
        read_graph=lambda: read_registrations(network.uri, our_nodes),
    )
    if has_joined:
        return robot.config
    if robot.is_guess:
        heard_config = robot_listened_to(network.uri, our_nodes, robot.config)
        if heard_config is not None and heard_config != robot.config:
            return heard_config
    recorder.send(GoOn())  # simulated time begins, although the submission does not take part
    return robot.config


def _follow(
    recorder: RecorderChannel,
    submitted: Process,
    simulator: Process,
    config: MarkingConfig,
    on_time: Callable[[float], None],
) -> Optional[Note]:
    """Wait until a run is over. Return why it must be cut off, or None if the recorder has ended the run.

    The recorder ends a run when the exercise is done, for example when the robot stands at the pillar. A run
    is cut off after its limit of wall time, if simulated time stands still for STALL_DEADLINE, or if the
    simulator ends. `on_time` gets the simulated times [s].
    """
    # [s] latest simulated time; wall time at which simulated time last advanced
    latest, advanced_at = 0.0, time.monotonic()
    # true if the recorder already knows that the submission has ended
    is_end_reported = False

    def is_over() -> bool:
        """Take in the messages of the recorder, and return whether the wait is over."""
        nonlocal latest, advanced_at, is_end_reported
        now = recorder.update().now
        on_time(now)
        if now > latest:
            latest, advanced_at = now, time.monotonic()
        if not submitted.running and not is_end_reported:
            recorder.send(Abandoned())
            is_end_reported = True
        stalled = time.monotonic() - advanced_at > STALL_DEADLINE
        return stalled or recorder.over or not recorder.is_open or not simulator.running

    if not wait(is_over, config.wall_limit, PROGRESS_PERIOD):
        return Note(Kind.SLOW, f"it took longer than {config.wall_limit:.0f} s of wall time")
    if recorder.over or not recorder.is_open:
        return None
    if simulator.running:
        return Note(Kind.STALLED, f"the simulation made no progress for {STALL_DEADLINE:g} s")
    return Note(Kind.STALLED, "the simulator ended")


def not_begun(trial: Trial, config: MarkingConfig) -> Recording:
    """Return the recording of a run that has not begun: only start, pillar, deadline and robot are known."""
    return Recording(
        trial.start, trial.pillar, config.deadline, robot=config.robot_name, simulated=config.robot,
        scan_topic=config.scan_topic,
    )  # fmt: skip


def start_submission(network: Network, submission: Submission, action: str = "run") -> Tuple[Process, Path]:
    """Start a submission in a ROS network, and return its process and the file of its events.

    An event is, for example, the end of a node. The action is "run", or "memcheck" to run the submission in
    valgrind.
    """
    events_file = network.folder_of(SUBMISSION_FOLDER) / "events.jsonl"
    create(events_file).close()  # a new file, which has only the events of this start
    command = starter(
        events_file,
        action,
        [submission.launchable],
        robot_packages=submission.parts,
        visible_code=submission.workspace.own,
    )
    return network.start(SUBMISSION_FOLDER, command, submission.workspace), events_file
