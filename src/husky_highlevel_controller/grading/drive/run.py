"""Runs a submission: a master, a simulator and a recorder of its own for each drive.

In: what to start, where the robot and the pillar stand. Out: `Recording`s. Talks to ROS by its programs only.
Must not know: points.
"""

from __future__ import annotations

import contextlib
import json
import re
import signal
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.grading.drive.recording import (
    CUT_OFF,
    ExchangedError,
    Recording,
    RecordingError,
    empty_recording,
    load,
)
from husky_highlevel_controller.grading.drive.ros_master import has_parameter, has_service, number
from husky_highlevel_controller.grading.drive.trials import Trial, trial_world
from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_text
from husky_highlevel_controller.grading.isolation.process import Process, end_all, wait
from husky_highlevel_controller.grading.isolation.ros_network import START_DEADLINE, MarkingError, Network
from husky_highlevel_controller.grading.isolation.sandbox import Workspace
from husky_highlevel_controller.paths import share_folder

LOAD_DEADLINE = 120.0  # [s] of wall time for a launch file to be read
JOIN_DEADLINE = 50.0  # [s] of wall time for a submission to be up; after that the world goes on without it
WALL_BASE, WALL_SLOWNESS = 300.0, 20.0  # [s] of wall time a drive may take, and how much slower than its pace
STALL_DEADLINE = 90.0  # [s] of wall time in which simulated time must get on
PROGRESS_PERIOD = 0.2  # [s] of wall time between two looks at a drive; each costs the ROS master milliseconds
FLOOD = 300.0  # commands a simulated second; 50 answer the scans
KEPT_OUTPUT = 20000  # letters of what a submission printed
# topic of the scans, and launch arguments of the simulator, of each robot that submissions are written for
ROBOT_VERSIONS = {
    "husky": ("/front/scan", ("robot:=husky", "laser_topic:=front/scan", "laser_prefix:=front")),
    "husky_melodic": ("/scan", ("robot:=husky", "laser_topic:=scan", "laser_prefix:=base")),
    "smb": ("/scan", ("robot:=smb", "laser_topic:=scan")),
}
RECORDER = "marking_recorder"  # its node's name
SIMULATOR_IS_UP = "/husky_simulator/step"  # the last service that it offers
NODES = Path(__file__).parents[2] / "ros" / "grading"
SIMULATOR = share_folder() / "launch" / "simulator.launch"
SIMULATOR_NODES = ("/husky_simulator",)  # of that launch file; another node of this name would end ours


@dataclass(frozen=True)
class Submission:
    """What somebody handed in."""

    what: Tuple[str, ...]  # --launch PACKAGE FILE [ARGUMENTS] or --node PACKAGE TYPE [ARGUMENTS]
    workspace: Workspace = field(default_factory=Workspace)  # what it runs in
    title: str = ""  # of the result; empty: the words above

    @property
    def words(self) -> str:
        """What is started, to be read."""
        return self.title or " ".join(self.what)


@dataclass(frozen=True)
class GradingConfig:
    """The same for every submission."""

    exercise: int = 3
    robot: str = "husky"  # of ROBOT_VERSIONS
    deadline: float = 120.0  # [s], simulated, for each drive
    pace: float = 5.0  # simulated seconds a second, at most

    @property
    def scan_topic(self) -> str:
        """Where scans are."""
        return ROBOT_VERSIONS[self.robot][0]


@dataclass(frozen=True)
class Plan:
    """What a submission would start."""

    nodes: Tuple[str, ...] = ()  # package/type
    left_out: Tuple[str, ...] = ()  # package/type
    rviz: Tuple[Dict[str, Any], ...] = ()  # name, args and remaps of its rviz nodes
    package_path: str = ""  # folder of its package; empty: there is none
    notes: Tuple[str, ...] = ()  # what is wrong with it


# ---------------------------------------------------------------------------- what it starts


def starter(events: Path, action: str, submission: Submission) -> List[str]:
    """The command that reads its launch file, and with the action `run` starts it."""
    # by its path: a package of the submission may have this package's name
    run = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='__main__')"
    path = str(NODES / "submission.py")
    return [
        sys.executable,
        "-c",
        run,
        path,
        str(events),
        action,
        json.dumps(SIMULATOR_NODES),
        *submission.what,
    ]


def plan(submission: Submission, folder: Path) -> Plan:
    """Read its launch file, or look its node up, without starting anything."""
    folder.mkdir(parents=True, exist_ok=True)
    events = folder / "plan.jsonl"
    events.write_text("")
    nowhere = "http://127.0.0.1:1"  # no master is needed to read a launch file
    env = {**submission.workspace.env, "ROS_MASTER_URI": nowhere, "PYTHONUNBUFFERED": "1"}
    env.update(ROS_LOG_DIR=str(folder / "log"), ROS_HOME=str(folder / "ros_home"), HOME=str(folder))
    env["DISPLAY"] = ":0"  # a launch file may start RViz only where there is a screen; nothing is started now
    command = starter(events, "describe", submission)
    process = Process(command, folder / "plan.log", env, folder, submission.workspace)
    try:
        in_time = wait(lambda: not process.running, LOAD_DEADLINE)
    finally:
        end_all([process])
    told = _read_events(events)
    notes = _notes(told, "")
    planned = next((event for event in told if event["event"] == "plan"), {})
    if not planned and not notes:
        words = process.output.strip()[-300:] if in_time else f"no end after {LOAD_DEADLINE:g} s"
        notes = [f"the launch file cannot be read: {words}"]
    if planned and not planned["nodes"]:
        notes.append("it starts no node of its own")
    package = next((str(event["path"]) for event in told if event["event"] == "package"), "")
    nodes, left_out, rviz = (tuple(planned.get(key, ())) for key in ("nodes", "left_out", "rviz"))
    return Plan(nodes, left_out, rviz, package, tuple(notes))


def _read_events(path: Path) -> List[Dict[str, Any]]:
    """What submission.py wrote down; lines that it did not write are left out."""
    events = []
    with contextlib.suppress(UnreadableFileError):
        for line in read_text(path).splitlines():
            with contextlib.suppress(ValueError, RecursionError):
                event = json.loads(line)
                if _is_event(event):
                    events.append(event)
    return events


def _is_event(event: Any) -> bool:
    """Whether an event has what is read of it; a submission can write anything into the file."""
    if not isinstance(event, dict):
        return False
    kind, code = event.get("event"), event.get("exit_code")
    if not isinstance(kind, str):
        return False
    if kind == "died":
        in_range = code is None or (type(code) is int and abs(code) < 256)
        return isinstance(event.get("node"), str) and "exit_code" in event and in_range
    if kind == "plan":
        named = all(_are_words(event.get(key)) for key in ("nodes", "left_out"))
        return named and isinstance(event.get("rviz"), list) and all(map(_is_rviz_node, event["rviz"]))
    words = {
        "unloadable": ("error",),
        "prefix": ("node", "prefix"),
        "missing": ("package", "tag"),
        "package": ("path",),
    }
    return kind in ("started", "left_out") or (
        kind in words and all(isinstance(event.get(key), str) for key in words[kind])
    )


def _is_rviz_node(node: Any) -> bool:
    return (
        isinstance(node, dict)
        and all(isinstance(node.get(key), str) for key in ("name", "args"))
        and isinstance(node.get("remap"), list)
        and all(_are_words(pair) and len(pair) == 2 for pair in node["remap"])
    )


def _are_words(words: Any) -> bool:
    return isinstance(words, list) and all(isinstance(word, str) for word in words)


def _notes(events: Sequence[Dict[str, Any]], output: str) -> List[str]:
    """What went wrong, in sentences, the same one once."""
    notes = [f"the launch file cannot be loaded: {e['error']}" for e in events if e["event"] == "unloadable"]
    for event in events:
        if event["event"] == "missing":
            notes.append(
                f"package '{event['package']}' is missing; the <{event['tag']}> that needs it is left out"
            )
    for event in events:
        if event["event"] == "prefix":
            notes.append(f"launch-prefix '{event['prefix']}' of node {event['node']} is dropped")
    for node in re.findall(r"ERROR: cannot launch node of type \[([^\]]+)\]", output):
        notes.append(f"node {node} cannot be started: no such package or program, or it is not executable")
    errors = re.findall(r"^\W*((?:\w+\.)*\w*(?:Error|Exception)\b.*)$", output, re.MULTILINE)
    for event in events:
        if event["event"] == "died":
            code = event["exit_code"]
            if code is not None and code < 0:
                how = f"signal {-code}" + (f", {signal.Signals(-code).name}" if -code < 32 else "")
            else:
                how = f"exit code {code}"
            why = f": {errors[-1][:200]}" if errors and code else ""
            notes.append(f"node {event['node']} ends during the drive ({how}){why}")
    return list(dict.fromkeys(notes))


# ---------------------------------------------------------------------------- one drive


def simulate(
    network: Network,
    world: str,
    start: Pose2D,
    seed: int,
    config: GradingConfig,
    *arguments: str,
    truth_socket: str = "",
) -> Process:
    """Start our simulator with a world, and wait until it is up; it writes true poses to the socket."""
    file = network.folder / "drive.world"
    file.write_text(world)
    place = [f"x:={start.x}", f"y:={start.y}", f"yaw:={start.yaw}", f"seed:={seed}"]
    simulator = network.start(
        "simulator",
        ["roslaunch", str(SIMULATOR), f"world_name:={file}", "rviz:=false",
         "laser_enabled:=true", "laser_tower:=true", *place, *ROBOT_VERSIONS[config.robot][1],
         *arguments],
        HUSKY_TRUTH_SOCKET=truth_socket,
    )  # fmt: skip
    up = wait(
        lambda: has_service(network.uri, SIMULATOR_IS_UP) or not simulator.running,
        START_DEADLINE,
        PROGRESS_PERIOD,
    )
    if not up or not simulator.running:
        raise MarkingError(f"the simulator does not start: {simulator.output.strip()[-500:]}")
    return simulator


def drive(
    submission: Submission,
    trial: Trial,
    config: GradingConfig,
    folder: Path,
    on_time: Callable[[float], None] = lambda _: None,
) -> Recording:
    """Let the submission drive once, and bring back what was seen; `on_time` gets simulated times [s].

    Raises:
        MarkingError: our own part of it does not work.
    """
    wall_limit = WALL_BASE + WALL_SLOWNESS * config.deadline / config.pace
    with Network(folder) as network, tempfile.TemporaryDirectory(prefix="husky_") as private:
        output, assignment = folder / "recording.json", folder / "assignment.json"
        truth_socket = f"{private}/truth"
        task = {
            "output": str(output), "truth_socket": truth_socket, "start": trial.start,
            "pillar": trial.pillar, "deadline": config.deadline, "scan_topic": config.scan_topic,
            "robot": config.robot.partition("_")[0], "exercise": config.exercise, "ours": SIMULATOR_NODES,
        }  # fmt: skip
        assignment.write_text(json.dumps(task))
        recorder = network.start(
            "recorder",
            [sys.executable, "-m", "husky_highlevel_controller.ros.grading.recorder", str(assignment)],
        )
        if not _reaches(network, recorder, "recording", START_DEADLINE):
            raise MarkingError(f"the recorder does not start: {recorder.output.strip()[-500:]}")
        simulator = simulate(
            network,
            trial_world(trial, config.robot.partition("_")[0]), trial.start, trial.seed, config,
            "lockstep:=true", f"real_time_factor:={config.pace}", truth_socket=truth_socket,
        )  # fmt: skip
        events = network.folder_of("submission") / "events.jsonl"
        events.write_text("")
        theirs = network.start("submission", starter(events, "run", submission), submission.workspace)
        joined = _reaches(network, recorder, "joined", JOIN_DEADLINE, also=theirs)
        if recorder.running and not joined:
            recorder.popen.send_signal(signal.SIGUSR1)  # lockstep would wait for the submission

        reached, since = 0.0, time.monotonic()

        def over() -> bool:
            nonlocal reached, since
            now = number(network.uri, f"/{RECORDER}/now")
            on_time(now)
            if now > reached:
                reached, since = now, time.monotonic()
            stalled = time.monotonic() - since > STALL_DEADLINE
            if not theirs.running:
                recorder.popen.send_signal(signal.SIGUSR2)  # no node is left to drive it
            return stalled or not (recorder.running and simulator.running)

        ended = "" if wait(over, wall_limit, PROGRESS_PERIOD) else f"{wall_limit:.0f} s of wall time passed"
        if not ended and recorder.running and simulator.running:
            ended = f"simulated time stood still for {STALL_DEADLINE:g} s of wall time"
        if recorder.running:
            ended = ended or "the simulator was ended"
            recorder.interrupt()
            wait(lambda: not recorder.running, START_DEADLINE)
        notes = _notes(_read_events(events), theirs.output) + [theirs.problem] * bool(theirs.problem)
    return _with_story(output, recorder, trial, config, notes, ended, theirs.output)


def _reaches(
    network: Network, recorder: Process, state: str, seconds: float, also: Optional[Process] = None
) -> bool:
    """Whether the recorder sets this private parameter in time; the processes must go on meanwhile."""
    name = f"/{RECORDER}/{state}"

    def decided() -> bool:
        running = recorder.running and (also is None or also.running)
        return not running or has_parameter(network.uri, name)

    wait(decided, seconds, PROGRESS_PERIOD)
    return recorder.running and has_parameter(network.uri, name)


def _with_story(
    path: Path,
    recorder: Process,
    trial: Trial,
    config: GradingConfig,
    notes: Sequence[str],
    ended: str,
    output: str,
) -> Recording:
    digest = re.search(r"^sha256 (\w{64})$", recorder.output, re.MULTILINE)
    try:
        recording = load(path, digest.group(1) if digest else "")
    except ExchangedError as error:
        recording = empty_recording(trial.pillar, config.deadline, (str(error),))
        recording = replace(recording, violations=(str(error),))
    except RecordingError as error:
        raise MarkingError(f"{error}; the recorder said: {recorder.output.strip()[-500:]}") from error
    if len(output) > KEPT_OUTPUT:
        output = output[: KEPT_OUTPUT // 2] + "\n[...]\n" + output[-KEPT_OUTPUT // 2 :]
    died = any("ends during" in note for note in notes)
    notes = [*notes, *([] if died else recording.notes)]
    seconds = max(float(recording.times[-1]), 1.0) if len(recording.times) else 1.0
    if recording.command_count / seconds > FLOOD:
        notes.append(
            f"it floods cmd_vel: {recording.command_count} commands in {seconds:.0f} simulated seconds"
        )
    if ended or recording.ended == CUT_OFF:
        notes.append(f"the drive was cut off at {seconds:.2f} s: {ended or 'somebody ended the recorder'}")
    return replace(recording, notes=tuple(notes), ended=ended or recording.ended, output=output)
