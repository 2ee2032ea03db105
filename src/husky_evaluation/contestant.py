"""Contestants of a comparison (parameters or a function), and the outcome of one run of each.

In: texts of a command line, scenarios. Out: `Outcome` records.

Every contestant is judged only by the true poses of the robot, because nothing else is known of the
controller that a launch file starts. The class for launch files is in the grader, because the grader's
recorder follows their runs.
"""

from __future__ import annotations

import importlib
import importlib.util
import shlex
import sys
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from pathlib import Path
from types import ModuleType
from typing import Any, Optional, Protocol, Sequence, Tuple

import numpy as np

from husky_evaluation import metrics
from husky_evaluation.rollout import Controller
from husky_evaluation.scenarios import Scenario
from husky_evaluation.setup import Setup, load_setup
from husky_evaluation.tasks.fingerprint import OURS
from husky_highlevel_controller.controller.behaviour import decide
from husky_highlevel_controller.course import PILLAR_RADIUS, REACHED, STANDS, TOUCH
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.robot import Robot

DRAWN_POSES = 300  # largest number of poses of a run that are kept for its picture


class Contestant(Protocol):
    """Side of a comparison, A or B; it is sent to the worker that drives."""

    @property
    def name(self) -> str:
        """Return the text that names the contestant on the command line and in the report."""

    @property
    def starts_programs(self) -> bool:
        """Return whether a run starts other programs, such as ROS nodes.

        The results of such runs are not kept for the next call, because the programs may change until then.
        """

    def drive(self, scenario: Scenario) -> Outcome:
        """Drive a scenario with this controller, and return the outcome.

        Raises:
            HuskyError: the controller fails, or does not start.
        """


class LaunchKind(Protocol):
    """Maker of contestants that are launch files; only the grader has one, because it starts ROS."""

    def __call__(self, text: str, package: str, file: str, arguments: Sequence[str]) -> Contestant:
        """Return the contestant of PACKAGE/FILE.launch with arguments name:=value."""


@dataclass(frozen=True)
class FunctionContestant:
    """Controller that runs in the process of the simulation."""

    name: str
    setup: Setup
    function: str = ""  # name of the decision function; empty for `behaviour.decide`
    module: str = ""  # name of the function's module if it is a module of this project; otherwise empty
    source: str = ""  # source text of the file with the function if it is the user's file; otherwise empty
    folder: str = ""  # folder of this file, in which the file finds other files that it imports
    package: str = ""  # Python package of the user's module, for its relative imports; empty if it has none

    @property
    def starts_programs(self) -> bool:
        """Return False, because the run stays in this process."""
        return False

    @property
    def controller(self) -> Controller:
        """Return the decision function.

        Raises:
            HuskyError: the file cannot be run, or has no such function.
        """
        if not self.function:  # the contestant is a file of parameters for this project's controller
            return decide
        try:
            if self.module:
                module: Any = importlib.import_module(self.module)
            else:
                module = _module_from_text(self.source, self.folder, self.package)
            controller: Controller = getattr(module, self.function)
        # the code in the user's file may raise any error, and may call exit()
        except (Exception, SystemExit) as error:
            raise HuskyError(f"{self.name}: {type(error).__name__}: {error}") from None
        if not callable(controller):
            raise HuskyError(f"{self.name}: {self.function} is not a function")
        return controller

    def drive(self, scenario: Scenario) -> Outcome:
        """Drive a scenario with this function, and return the outcome.

        Raises:
            HuskyError: the function fails.
        """
        setup = self.setup
        try:
            trace = metrics.drive_scenario(setup, scenario, self.controller)
        except HuskyError:  # an error of the simulation or of `controller`, which already has a clear text
            raise
        except (Exception, SystemExit) as error:  # the user's function may raise any error, or call exit()
            failure = f"{type(error).__name__}: {error}"
            raise HuskyError(f"{self.name} fails in {scenario.name}: {failure}") from error
        x, y = trace.pillars[0]  # position at the start, because the robot may push the pillar later
        return outcome(scenario.name, trace.times, trace.poses, (float(x), float(y)), setup.simulator.robot)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of one run."""

    scene: str
    # [s] time from which the robot stands at the pillar until the end of the run; inf if it does not stand
    # there in the end
    arrived_at: float
    nearest: float  # [m] smallest gap between the robot's footprint and the pillar during the run
    poses: np.ndarray  # (N, 3) [m, m, rad] path of the robot, with at most DRAWN_POSES poses
    pillar: Tuple[float, float]  # [m] x and y of the pillar's centre in the world at the start of the run
    notes: Tuple[str, ...] = ()  # sentences on problems with the nodes of a launch file

    @property
    def success(self) -> bool:
        """Return whether the robot stands at the pillar and has not touched it."""
        return self.arrived_at < inf and self.nearest > TOUCH

    @property
    def summary(self) -> str:
        """Return the end of the run as text."""
        touched = ", touched the pillar" if self.nearest <= TOUCH else ""
        notes = f" ({'; '.join(self.notes)})" if self.notes else ""
        is_there = self.arrived_at < inf
        end = f"at the pillar after {self.arrived_at:.2f} s" if is_there else "not at the pillar in the end"
        return end + touched + notes


def contestant(text: str, base: Setup, launch_kind: Optional[LaunchKind] = None) -> Contestant:
    """Return the contestant FILE.yaml, FILE.py:FUNCTION, MODULE:FUNCTION or PACKAGE/FILE.launch [ARGUMENTS].

    Args:
        text: text of the command line, in one of these forms.
        base: setup of the run; a YAML file changes some parameters of its controller.
        launch_kind: function that makes a contestant of a launch file; None if there is no ROS.

    Raises:
        HuskyError: the text has none of these forms, its file cannot be read, or it names a launch file
            and there is no ROS.
    """
    try:
        words = shlex.split(text)
    except ValueError:  # the text has a single apostrophe, which the name of a file may have
        words = [text]
    first, *arguments = words or [""]
    if first.endswith(".launch") and first.count("/") == 1:
        if launch_kind is None:
            raise HuskyError(
                f"{text}: a launch file needs ROS; run rosrun husky_highlevel_controller compare"
            )
        package, file = first.split("/")
        return launch_kind(text, package, file, arguments)
    # the text names no launch file, so it has no arguments; the whole text is one name, which may have spaces
    if text.endswith((".yaml", ".yml")):
        return FunctionContestant(text, load_setup(Path(text), base))
    made = _function_contestant(text, base)
    # loads the function now, so that a wrong contestant causes an error before the first run
    _ = made.controller
    return made


def _function_contestant(text: str, base: Setup) -> FunctionContestant:
    """Return the contestant FILE.py:FUNCTION or MODULE:FUNCTION, with all that a worker needs to run it.

    A worker has the packages of this project, so it imports a module of them by name. It may not have the
    user's file, so it gets the text of the file.

    Raises:
        HuskyError: the text has another form, or the file cannot be read.
    """
    file_or_module, colon, function = text.rpartition(":")
    if not colon or not function.isidentifier():
        kinds = "FILE.yaml, FILE.py:FUNCTION, MODULE:FUNCTION or PACKAGE/FILE.launch"
        raise HuskyError(f"'{text}' is not a valid controller; give {kinds}")
    if file_or_module.split(".")[0] in OURS:
        return FunctionContestant(text, base, function, module=file_or_module)
    # the text may import other files of its folder, and by relative imports other modules of its package
    source, folder = _source(file_or_module)
    is_file = file_or_module.endswith(".py")  # a file belongs to no package
    package = "" if is_file else file_or_module.rpartition(".")[0]
    return FunctionContestant(text, base, function, source=source, folder=folder, package=package)


def _source(file_or_module: str) -> Tuple[str, str]:
    """Return the source text of a file, or of a module that Python finds by its name, and the file's folder.

    Raises:
        HuskyError: the text cannot be read.
    """
    try:
        path = Path(file_or_module)
        if path.suffix != ".py":
            # if the module is not found, or has no file, the path is not a file, so `read_text` below fails
            spec = importlib.util.find_spec(file_or_module)
            if spec is not None:
                path = Path(spec.origin or "")
        return path.read_text(), str(path.resolve().parent)
    except (OSError, ValueError, ImportError) as error:
        raise HuskyError(
            f"{file_or_module} is not a Python file or module that can be read: {error}"
        ) from None


@lru_cache(maxsize=4)
def _module_from_text(source: str, folder: str, package: str) -> ModuleType:
    """Execute the source text of a user's file, and return it as a module.

    A process asks for the same module in each of its runs, so the module is kept, and the text is executed
    only once.

    Args:
        source: the source text.
        folder: folder of the file, from which the text may import other files.
        package: package of the file, which the text needs for relative imports; empty if it has none.
    """
    if folder not in sys.path:
        sys.path.append(folder)  # installed modules come first, so no file of the folder replaces one
    module = ModuleType(f"contestant_{abs(hash(source))}")
    # needed if the source text has a dataclass, because a dataclass looks up its module in sys.modules
    sys.modules[module.__name__] = module
    module.__package__ = package
    exec(compile(source, module.__name__, "exec"), vars(module))
    return module


def drive_scene(item: Tuple[Contestant, Scenario]) -> Outcome:
    """Drive a scenario with a contestant; `Workers.map` needs a task with only one argument.

    Raises:
        HuskyError: the function or ROS fails.
    """
    competitor, scenario = item
    return competitor.drive(scenario)


def outcome(
    scene: str, times: np.ndarray, poses: np.ndarray, pillar: Tuple[float, float], robot: Robot
) -> Outcome:
    """Return the outcome of a run.

    Args:
        scene: name of the scenario.
        times: (N,) [s] simulated time of each pose.
        poses: (N, 3) [m, m, rad] true poses of base_link.
        pillar: x and y of the pillar's centre at the start [m].
        robot: robot of the run.
    """
    # (N,) [m] gap between footprint and pillar at each pose
    gaps = robot.footprint.gaps(poses, np.array(pillar), PILLAR_RADIUS)
    # (N,) distance [m] and time [s] from the pose before, and speed [m/s]. The first pose has no pose before,
    # so its distance is 0. Its time may have any value, such as 1 s, because its speed is 0 anyway.
    distances = np.hypot(*np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2]).T)
    durations = np.diff(times, prepend=times[0] - 1.0)
    speeds = distances / np.maximum(durations, 1e-9)  # two poses may have the same time
    # the robot arrives directly after the last pose at which it still moves or is too far from the pillar
    rows_not_there = np.flatnonzero((speeds > STANDS) | (gaps > REACHED))
    arrival_row = int(rows_not_there[-1]) + 1 if len(rows_not_there) else 0
    arrived_at = float(times[arrival_row]) if arrival_row < len(times) else inf
    step = len(poses) // DRAWN_POSES + 1  # only every `step`-th pose is kept, which gives at most DRAWN_POSES
    return Outcome(scene, arrived_at, float(gaps.min()), poses[::step], pillar)
