"""Contestants of a comparison (parameters, a function, a launch file), and one drive of each.

In: texts of a command line, scenes. Out: `Outcome`s.

All kinds are judged by the true poses alone, for a launch file tells nothing else.
"""

from __future__ import annotations

import importlib
import importlib.util
import shlex
import sys
import tempfile
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf
from pathlib import Path
from types import ModuleType
from typing import Any, Optional, Tuple

import numpy as np

from husky_highlevel_controller.config import load
from husky_highlevel_controller.controller.behaviour import decide
from husky_highlevel_controller.course import PILLAR_POSITION, PILLAR_RADIUS, REACHED, STANDS, TOUCH
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.evaluation import metrics
from husky_highlevel_controller.evaluation.rollout import Controller
from husky_highlevel_controller.evaluation.scenarios import Scenario
from husky_highlevel_controller.evaluation.setup import Setup, load_setup
from husky_highlevel_controller.grading.drive.run import drive
from husky_highlevel_controller.grading.drive.trials import Trial
from husky_highlevel_controller.grading.hand_in.plan import plan
from husky_highlevel_controller.grading.isolation.sandbox import Workspace
from husky_highlevel_controller.grading.notes import texts
from husky_highlevel_controller.grading.recording import RECORDING, Recording
from husky_highlevel_controller.grading.records import Launchable, MarkingConfig
from husky_highlevel_controller.grading.submission import Submission
from husky_highlevel_controller.robot import Robot, load_robot

PACKAGE = __name__.split(".")[0]
LAUNCH_PACE, LAUNCH_DEADLINE = 5.0, metrics.DRIVE_SECONDS  # simulated seconds a second; [s], simulated
DRAWN_POSES = 300  # of a drive, that are kept for its picture


@dataclass(frozen=True)
class Contestant:
    """Side of a comparison, A or B."""

    name: str
    setup: Setup
    function: str = ""  # what decides in place of `behaviour.decide`; empty: that does
    module: str = ""  # the function's, if it is this package's
    source: str = ""  # text of the function's file, else: it is sent to where it drives
    launch: Optional[Launchable] = None  # None: it drives in process


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of one drive."""

    scene: str
    arrived_at: float  # [s], from when on it stands at the pillar; inf: it does not in the end
    nearest: float  # [m], smallest gap between outline and pillar
    poses: np.ndarray  # (N, 3) [m, m, rad], evenly thinned
    pillar: Tuple[float, float]  # [m], where it stood at first
    notes: Tuple[str, ...] = ()  # what went wrong with its nodes, in sentences

    @property
    def success(self) -> bool:
        """Whether the robot stands at the pillar, and has not touched it."""
        return self.arrived_at < inf and self.nearest > TOUCH

    @property
    def summary(self) -> str:
        """End of the drive as text."""
        touched = ", touched the pillar" if self.nearest <= TOUCH else ""
        notes = f" ({'; '.join(self.notes)})" if self.notes else ""
        is_there = self.arrived_at < inf
        end = f"at the pillar after {self.arrived_at:.2f} s" if is_there else "not at the pillar in the end"
        return end + touched + notes


def contestant(text: str, base: Setup) -> Contestant:
    """Contestant of a text: FILE.yaml, FILE.py:FUNCTION, MODULE:FUNCTION or PACKAGE/FILE.launch [ARGUMENTS].

    Raises:
        HuskyError: none of these, or it cannot be read.
    """
    first, *arguments = shlex.split(text) or [""]
    if first.endswith((".yaml", ".yml")):
        return Contestant(text, load_setup(Path(first), base))
    if first.endswith(".launch") and first.count("/") == 1:
        package, file = first.split("/")
        return Contestant(text, base, launch=Launchable("launch", package, file, tuple(arguments)))
    place, colon, function = first.rpartition(":")
    if not colon or not function.isidentifier() or arguments:
        kinds = "FILE.yaml, FILE.py:FUNCTION, MODULE:FUNCTION and PACKAGE/FILE.launch"
        raise HuskyError(f"'{text}' is none of {kinds}")
    if place.split(".")[0] == PACKAGE:
        contestant = Contestant(text, base, function, module=place)
    else:
        contestant = Contestant(text, base, function, source=_source(place))
    controller_of(contestant)  # now, and not in the middle of many drives
    return contestant


def _source(place: str) -> str:
    try:
        path = Path(place)
        if path.suffix != ".py":
            spec = importlib.util.find_spec(place)
            path = Path(spec.origin or "") if spec else path
        return path.read_text()
    except (OSError, ValueError, ImportError) as error:
        raise HuskyError(f"{place}: no such Python file or module: {error}") from None


def controller_of(contestant: Contestant) -> Controller:
    """The function that decides; HuskyError where its file cannot be run, or has no such function."""
    if not contestant.function:
        return decide
    try:
        name = contestant.module
        module: Any = importlib.import_module(name) if name else _module(contestant.source)
        controller: Controller = getattr(module, contestant.function)
    except Exception as error:  # anything may be in a file
        raise HuskyError(f"{contestant.name}: {type(error).__name__}: {error}") from None
    if not callable(controller):
        raise HuskyError(f"{contestant.name}: {contestant.function} is not a function")
    return controller


@lru_cache(maxsize=4)
def _module(source: str) -> ModuleType:
    module = ModuleType(f"contestant_{abs(hash(source))}")
    sys.modules[module.__name__] = module  # dataclasses look their module up
    exec(compile(source, module.__name__, "exec"), vars(module))
    return module


def drive_scene(item: Tuple[Contestant, Scenario]) -> Outcome:
    """Drive a scene, as a task for `Workers.map`; HuskyError where the function or ROS fails."""
    contestant, scenario = item
    if contestant.launch is not None:
        return _launched(contestant, contestant.launch, scenario)
    setup = contestant.setup
    try:
        trace = metrics.drive(setup, scenario, controller_of(contestant))
    except HuskyError:
        raise
    except Exception as error:
        failure = f"{type(error).__name__}: {error}"
        raise HuskyError(f"{contestant.name} fails in {scenario.name}: {failure}") from error
    x, y = trace.pillars[0]
    return outcome(scenario.name, trace.times, trace.poses, (float(x), float(y)), setup.simulator.robot)


def _launched(contestant: Contestant, launch: Launchable, scenario: Scenario) -> Outcome:
    _check(contestant.name, launch)
    trial = Trial(1, scenario.start, PILLAR_POSITION, scenario.seed)
    config = MarkingConfig(robot="husky", deadline=LAUNCH_DEADLINE, pace=LAUNCH_PACE)
    with tempfile.TemporaryDirectory(prefix="husky_compare_") as folder:
        drive(Submission(launch), trial, config, Path(folder))
        recording: Recording = load(Recording, Path(folder, RECORDING))
    if not len(recording.times):
        why = "; ".join(texts(recording.notes)) or "no drive"
        raise HuskyError(f"{contestant.name} in {scenario.name}: {why}")
    judged = outcome(scenario.name, recording.times, recording.poses, trial.pillar, load_robot())
    return replace(judged, notes=tuple(texts(recording.notes)))


@lru_cache(maxsize=4)
def _check(name: str, launch: Launchable) -> None:
    """Refuse a launch file that starts no node, with a HuskyError."""
    with tempfile.TemporaryDirectory(prefix="husky_compare_") as folder:
        planned = plan(launch, Workspace(), Path(folder))
    if not planned.nodes:
        raise HuskyError(f"{name}: {'; '.join(texts(planned.notes)) or 'it starts no node'}")


def outcome(
    scene: str, times: np.ndarray, poses: np.ndarray, pillar: Tuple[float, float], robot: Robot
) -> Outcome:
    """Outcome of a drive: times (N,) [s], true poses (N, 3) [m, m, rad], the pillar's centre at first [m]."""
    gap = robot.footprint.gaps(poses, np.array(pillar), PILLAR_RADIUS)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2]).T)
    speeds = steps / np.maximum(np.diff(times, prepend=times[0] - 1.0), 1e-9)
    away = np.flatnonzero((speeds > STANDS) | (gap > REACHED))
    arrived = int(away[-1]) + 1 if len(away) else 0
    arrived_at = float(times[arrived]) if arrived < len(times) else inf
    return Outcome(scene, arrived_at, float(gap.min()), poses[:: len(poses) // DRAWN_POSES + 1], pillar)
