"""Runs a submission: a master, a simulator and a recorder of its own for each drive.

In: what to start, where the robot and the pillar stand. Out: `Recording`s. Talks to ROS by its programs only.
Must not know: points.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Dict, List, Sequence, Tuple

from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.description import share_folder
from husky_highlevel_controller.network import START_DEADLINE, MarkingError, Network
from husky_highlevel_controller.processes import Process, end_all, wait
from husky_highlevel_controller.recording import CUT_OFF, Recording, RecordingError, load
from husky_highlevel_controller.trials import Trial, trial_world

LOAD_DEADLINE = 30.0  # [s] of wall time for a launch file to be read
JOIN_DEADLINE = 20.0  # [s] of wall time for a submission to be up; after that the world goes on without it
WALL_BASE, WALL_SLOWNESS = 60.0, 3.0  # [s] of wall time a drive may take, and how much slower than its pace
FLOOD = 300.0  # commands a simulated second; 50 answer the scans
KEPT_OUTPUT = 20000  # letters of what a submission printed
SCAN_TOPICS = {"noetic": "/front/scan", "melodic": "/scan"}
LASER = {
    "noetic": ["laser_topic:=front/scan", "laser_prefix:=front"],
    "melodic": ["laser_topic:=scan", "laser_prefix:=base"],
}  # launch arguments
NODES = Path(__file__).parent / "nodes"
SIMULATOR = share_folder() / "launch" / "simulator.launch"


@dataclass(frozen=True)
class Submission:
    """What somebody handed in."""

    what: Tuple[str, ...]  # --launch PACKAGE FILE [ARGUMENTS] or --node PACKAGE TYPE [ARGUMENTS]
    env: Dict[str, str] = field(default_factory=lambda: dict(os.environ))  # with its workspace sourced


@dataclass(frozen=True)
class Rules:
    """The same for every submission."""

    exercise: int = 3
    husky: str = "noetic"
    deadline: float = 120.0  # [s], simulated, for each drive
    pace: float = 5.0  # simulated seconds a second, at most

    @property
    def scan_topic(self) -> str:
        """Where scans are."""
        return SCAN_TOPICS[self.husky]


@dataclass(frozen=True)
class Plan:
    """What a submission would start."""

    nodes: Tuple[str, ...] = ()  # package/type
    left_out: Tuple[str, ...] = ()  # package/type
    rviz: Tuple[Dict[str, Any], ...] = ()  # name, args and remaps of its rviz nodes
    package_path: str = ""  # folder of its package; empty: there is none
    notes: Tuple[str, ...] = ()  # what is wrong with it


# ---------------------------------------------------------------------------- what it starts


@lru_cache(maxsize=1)
def our_nodes() -> Tuple[str, ...]:
    """Names of the nodes that our simulator's launch file starts: who else has one would end ours."""
    command = ["roslaunch", "--nodes", str(SIMULATOR), "rviz:=false"]
    asked = subprocess.run(command, capture_output=True, text=True, timeout=START_DEADLINE, check=False)
    if asked.returncode:
        raise MarkingError(f"the simulator's launch file cannot be read: {asked.stderr.strip()[-500:]}")
    return tuple(name for name in asked.stdout.split() if name.startswith("/"))


def _starter(events: Path, action: str, submission: Submission) -> List[str]:
    # by its path: a package of the submission may have this package's name
    run = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='__main__')"
    path = str(NODES / "submission.py")
    return [sys.executable, "-c", run, path, str(events), action, json.dumps(our_nodes()), *submission.what]


def plan(submission: Submission, folder: Path) -> Plan:
    """Read its launch file, or look its node up, without starting anything."""
    folder.mkdir(parents=True, exist_ok=True)
    events = folder / "plan.jsonl"
    events.write_text("")
    nowhere = f"http://127.0.0.1:1{folder.resolve()}"  # nobody listens; it tells whose processes these are
    env = {**submission.env, "ROS_MASTER_URI": nowhere, "PYTHONUNBUFFERED": "1"}
    env.update(ROS_LOG_DIR=str(folder / "log"), ROS_HOME=str(folder / "ros_home"))
    env["DISPLAY"] = ":0"  # a launch file may start RViz only where there is a screen; nothing is started now
    process = Process(
        _starter(events, "describe", submission), folder / "plan.log", env, folder, stranger=True
    )
    in_time = wait(lambda: not process.running, LOAD_DEADLINE)
    end_all([process], "ROS_MASTER_URI", nowhere)
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
    events = []
    for line in path.read_text(errors="replace").splitlines():
        try:
            event = json.loads(line)
        except ValueError:
            continue
        if isinstance(event, dict) and "event" in event:
            events.append(event)
    return events


def _notes(events: Sequence[Dict[str, Any]], output: str) -> List[str]:
    """What went wrong, in sentences, the same one once."""
    notes = [f"the launch file cannot be loaded: {e['error']}" for e in events if e["event"] == "unloadable"]
    for event in events:
        if event["event"] == "missing":
            notes.append(
                f"package '{event['package']}' is missing; the <{event['tag']}> that needs it is left out"
            )
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
    network: Network, world: str, start: Pose2D, seed: int, rules: Rules, *arguments: str
) -> Process:
    """Start our simulator with a world, and wait until it is up."""
    file = network.folder / "drive.world"
    file.write_text(world)
    place = [f"x:={start.x}", f"y:={start.y}", f"yaw:={start.yaw}", f"seed:={seed}"]
    simulator = network.start(
        "simulator",
        ["roslaunch", str(SIMULATOR), f"world_name:={file}", "rviz:=false",
         "laser_enabled:=true", "laser_tower:=true", *place, *LASER[rules.husky],
         *arguments],
    )  # fmt: skip
    up = wait(lambda: "simulating '" in simulator.output or not simulator.running, START_DEADLINE)
    if not up or not simulator.running:
        raise MarkingError(f"the simulator does not start: {simulator.output.strip()[-500:]}")
    return simulator


def drive(submission: Submission, trial: Trial, rules: Rules, folder: Path) -> Recording:
    """Let the submission drive once, and bring back what was seen.

    Raises:
        MarkingError: our own part of it does not work.
    """
    wall_limit = WALL_BASE + WALL_SLOWNESS * rules.deadline / rules.pace
    with Network(folder) as network:
        simulator = simulate(
            network,
            trial_world(trial), trial.start, trial.seed, rules,
            "lockstep:=true", f"real_time_factor:={rules.pace}",
        )  # fmt: skip
        output, assignment = folder / "recording.json", folder / "assignment.json"
        task = {
            "output": str(output), "start": trial.start, "pillar": trial.pillar,
            "deadline": rules.deadline, "scan_topic": rules.scan_topic, "exercise": rules.exercise,
            "ours": our_nodes(),
        }  # fmt: skip
        assignment.write_text(json.dumps(task))
        recorder = network.start(
            "recorder", [sys.executable, "-m", f"{__package__}.nodes.recorder", str(assignment)]
        )
        up = wait(lambda: "recording" in recorder.output or not recorder.running, START_DEADLINE)
        if not up or not recorder.running:
            raise MarkingError(f"the recorder does not start: {recorder.output.strip()[-500:]}")
        events = folder / "events.jsonl"
        events.write_text("")
        theirs = network.start(
            "submission", _starter(events, "run", submission), submission.env, stranger=True
        )
        wait(lambda: not recorder.running or not theirs.running or _joined(recorder), JOIN_DEADLINE)
        if recorder.running and not _joined(recorder):
            recorder.popen.send_signal(signal.SIGUSR1)  # lockstep would wait for the submission
        ended = "" if wait(lambda: not (recorder.running and simulator.running), wall_limit) else (
            f"{wall_limit:.0f} s of wall time passed"
        )  # fmt: skip
        if recorder.running:
            ended = ended or "the simulator was ended"
            recorder.interrupt()
            wait(lambda: not recorder.running, START_DEADLINE)
        notes = _notes(_read_events(events), theirs.output)
        if "running free from now on" in simulator.output and not any(
            "ends during" in note for note in notes
        ):
            notes.append("it does not answer every scan with a command, so simulated time ran on without it")
    return _with_story(output, recorder, trial, rules, notes, ended, theirs.output)


def _joined(recorder: Process) -> bool:
    return "joined" in recorder.output


def _with_story(
    path: Path, recorder: Process, trial: Trial, rules: Rules, notes: Sequence[str], ended: str, output: str
) -> Recording:
    try:
        recording = load(path)
    except RecordingError as error:
        raise MarkingError(f"{error}; the recorder said: {recorder.output.strip()[-500:]}") from error
    if len(output) > KEPT_OUTPUT:
        output = output[: KEPT_OUTPUT // 2] + "\n[...]\n" + output[-KEPT_OUTPUT // 2 :]
    notes, seconds = list(notes), max(float(recording.times[-1]), 1.0) if len(recording.times) else 1.0
    if recording.command_count / seconds > FLOOD:
        notes.append(
            f"it floods cmd_vel: {recording.command_count} commands in {seconds:.0f} simulated seconds"
        )
    if ended or recording.ended == CUT_OFF:
        notes.append(f"the drive was cut off at {seconds:.2f} s: {ended or 'somebody ended the recorder'}")
    return replace(recording, notes=tuple(notes), ended=ended or recording.ended, output=output)
