"""Setup of a run except its scenario: gains, detector, simulator; parameters of all three by name.

In: names and values, of a command line or a YAML file. Out: `Setup` and `Axis` records.

The name of a simulator parameter is its path in config/robots/husky.yaml, such as lidar/noise.
"""

from __future__ import annotations

import argparse
import math
import re
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Tuple

import numpy as np
import yaml

from husky_highlevel_controller.config import ConfigError, replace_parameters
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.simulator.profile import GROUNDS, PROFILES, RobotProfile
from husky_highlevel_controller.simulator.simulator_config import SimulatorConfig, simulator_config
from husky_evaluation.tasks.command import add_old_name, add_worker_options, positive, seed_value

COURSE_GAINS = ControlConfig(p_gain_vel=0.1, p_gain_ang=0.4)
# control of the real Husky: the gains of config/robot.yaml, with the default limits
ROBOT_GAINS = ControlConfig(p_gain_vel=0.6, p_gain_ang=1.0)
ROBOT_DETECTOR = PillarConfig(range_noise=0.012)
# parameters of the controller's ROS node that have no effect on a run without ROS
NODE_ONLY = ("start_stop_service_name", "start_enabled", "scan_topic_name", "scan_topic_queue_size")
MAX_VALUES = 1000  # largest number of values of one axis


@dataclass(frozen=True)
class Setup:
    """Setup of a run: everything on which it depends except its scenario."""

    control: ControlConfig = field(default_factory=ControlConfig)
    detector: PillarConfig = field(default_factory=PillarConfig)
    simulator: SimulatorConfig = field(default_factory=simulator_config)

    def with_values(self, values: Mapping[str, Any], source: str = "") -> Setup:
        """Return another setup, with some parameters changed by name.

        Raises:
            ConfigError: a name is not a parameter, or has no effect on this robot, or a value is not allowed.
                The message begins with `source`.
        """
        current = parameter_values(self)
        for name in values:
            if name not in current:
                raise ConfigError(f"{source}{name} is not a parameter; there are: {', '.join(sorted(current))}")
            # the lidar of a real Husky has parameters of its own, which cannot be changed by name
            if self.simulator.real and name.startswith("lidar/"):
                raise ConfigError(f"{source}{name} has no effect with --profile robot; use --profile gazebo")
        changed = {}
        for item in fields(self):  # control, detector, simulator
            record = getattr(self, item.name)
            names = [name for name, _, _ in _parameters(record)]
            changes = {name: values[name] for name in names if name in values}
            changed[item.name] = replace_parameters(record, changes, source)
        return Setup(**changed)

    def with_gains(self, gains: ControlConfig) -> Setup:
        """Return another setup, with the two gains of another control; this setup's limits stay."""
        control = replace(self.control, p_gain_vel=gains.p_gain_vel, p_gain_ang=gains.p_gain_ang)
        return replace(self, control=control)


@dataclass(frozen=True)
class Axis:
    """Values that a parameter takes in turn."""

    name: str
    values: Tuple[float, ...]
    # true if neighbouring values have a constant ratio; false if they have a constant difference
    is_geometric: bool = False

    @property
    def label(self) -> str:
        """Return name and unit."""
        return f"{self.name} {unit_of(self.name)}".strip()


def setup_of(profile: str = "gazebo", ground: str = "hard", robot: str = "husky") -> Setup:
    """Return the setup of a robot with the default parameters of its controller.

    Args:
        profile: profile of sensors and drivetrain: those of Gazebo, or those of a real robot.
        ground: ground under a real robot.
        robot: one of ROBOTS.

    Raises:
        ConfigError: the robot has no such profile.
    """
    simulator = simulator_config(robot)
    if profile not in simulator.robot.profiles:
        there_are = ", ".join(simulator.robot.profiles)
        raise ConfigError(f"the {simulator.robot.title} has no profile '{profile}'; there are: {there_are}")
    if profile == "gazebo":
        # the file has only the parameters that differ from the Husky's controller; the others keep their
        # defaults
        file = share_folder() / "config" / f"{robot}.yaml"
        setup = Setup(simulator=simulator)
        return load_setup(file, setup) if file.is_file() else setup
    # the profile of a real robot; only the Husky has it, so gains and detector are those of the real Husky
    return Setup(ROBOT_GAINS, ROBOT_DETECTOR, replace(simulator, real=RobotProfile().on(ground)))


def add_profile_options(parser: argparse.ArgumentParser) -> None:
    """Add --robot, --profile and --ground, which `setup_of` takes."""
    parser.add_argument("--robot", choices=ROBOTS, default="husky", help="robot (default: husky)")
    parser.add_argument("--profile", choices=PROFILES, default="gazebo", help="profile of sensors and drivetrain")
    parser.add_argument("--ground", choices=GROUNDS, default="hard", help="ground with --profile robot")


def add_seed_option(parser: argparse.ArgumentParser) -> None:
    """Add --seed."""
    parser.add_argument("--seed", type=seed_value, default=0, help="random seed (default: 0)")


def add_starts_option(parser: argparse.ArgumentParser, starts: int) -> argparse.Action:
    """Add --starts, and return it, so that the caller can add an old name of this option."""
    return parser.add_argument(
        "--starts", type=positive, default=starts, help=f"number of random starts (default: {starts})"
    )


def add_drive_options(parser: argparse.ArgumentParser, command: str, starts: int) -> None:
    """Add the options of a command that drives from random starts and keeps its results in a folder."""
    add_old_name(parser, "--scenes", add_starts_option(parser, starts))
    add_seed_option(parser)
    add_profile_options(parser)
    parser.add_argument(
        "--out", type=Path, default=Path(command), help=f"folder of results (default: ./{command})"
    )
    add_worker_options(parser)


def parameter_values(setup: Setup) -> Dict[str, Any]:
    """Return the values of all parameters of control, detector and simulator by their names."""
    values = {}
    for record in vars(setup).values():
        for name, value, _ in _parameters(record):
            values[name] = value
    return values


def _parameters(record: Any, prefix: str = "") -> Iterator[Tuple[str, Any, Mapping[str, Any]]]:
    """Yield name, value and metadata of each parameter of a record, and of the records in it.

    A field without metadata is not a parameter. `prefix` is the beginning of each name, such as "lidar/" for
    the record in the field `lidar`.
    """
    for item in fields(record):
        value = getattr(record, item.name)
        if not item.metadata:
            continue
        if is_dataclass(value):
            yield from _parameters(value, f"{prefix}{item.name}/")
        else:
            yield prefix + item.name, value, item.metadata


# min, max and help of every parameter; the key is the parameter's name
METADATA = {
    name: metadata for record in vars(Setup()).values() for name, _, metadata in _parameters(record)
}


def unit_of(name: str) -> str:
    """Return the unit of a parameter in brackets, from the end of its help text; empty if it has none."""
    unit = re.search(r"\[[^]]+\]$", METADATA[name]["help"])
    return unit.group() if unit else ""


def help_line(name: str) -> str:
    """Return range, default and help of a numeric parameter."""
    metadata, default = METADATA[name], parameter_values(Setup())[name]
    return f"{metadata['min']:g}..{metadata['max']:g}, default {default:g}: {metadata['help']}"


def numeric_parameters() -> List[str]:
    """Return the names of all numeric parameters."""
    return [name for name, value in parameter_values(Setup()).items() if type(value) in (int, float)]


def parse_axis(text: str) -> Axis:
    """Return an axis from NAME=FIRST:LAST:COUNT or NAME=VALUE,VALUE,...

    The COUNT values have equal distances, or with the suffix :log equal ratios.

    Raises:
        ConfigError: the text has none of these forms, or a value is not allowed.
    """
    name, equals, grid = text.partition("=")  # `equals` is empty if the text contains no "="
    defaults = parameter_values(Setup())
    if name not in defaults:
        raise ConfigError(f"{name} is not a parameter; there are: {', '.join(sorted(defaults))}")
    kind = type(defaults[name])
    if kind not in (int, float):
        raise ConfigError(f"{name} is not a numeric parameter ({METADATA[name]['help']})")
    if not equals:
        raise ConfigError(f"{name} needs values, such as {name}=FIRST:LAST:COUNT; {help_line(name)}")
    is_geometric = grid.endswith(":log")
    try:
        values = _numbers(grid[: -len(":log")] if is_geometric else grid, is_geometric)
    except ValueError as error:
        raise ConfigError(f"{name} = '{grid}' is not FIRST:LAST:COUNT or VALUE,VALUE: {error}") from None
    if kind is int:
        values = [int(round(value)) for value in values]
    # the values without repetitions, because rounding may make several values equal
    different_values = tuple(dict.fromkeys(values))
    for value in different_values:
        Setup().with_values({name: value})  # only a check: it raises an error if the value is not allowed
    return Axis(name, different_values, is_geometric)


def _numbers(grid: str, is_geometric: bool) -> List[float]:
    """Return the sorted numbers of FIRST:LAST:COUNT, with equal distances or ratios, or of VALUE,VALUE.

    Raises:
        ValueError: the text has another form, or the numbers do not fit it.
    """
    has_count = ":" in grid  # FIRST:LAST:COUNT
    if has_count:
        *texts, count = grid.split(":")
    else:
        texts, count = grid.split(","), ""
    numbers = [float(text) for text in texts]
    if not all(map(math.isfinite, numbers)):
        raise ValueError("every value must be a finite number")
    if not has_count:
        return sorted(numbers)
    first, last = numbers  # Python raises a ValueError if there are fewer or more than two
    if not 1 <= int(count) <= MAX_VALUES:
        raise ValueError(f"COUNT = {count} is not in 1..{MAX_VALUES}")
    if is_geometric and not (first > 0.0 and last > 0.0):
        raise ValueError("equal ratios need numbers above 0")
    space = np.geomspace if is_geometric else np.linspace
    # rounded to six digits, which are easy to read and to type
    return sorted(float(f"{value:.6g}") for value in space(first, last, int(count)))


def load_setup(path: Path, base: Setup) -> Setup:
    """Return a setup with the controller's parameters in a YAML file.

    Raises:
        ConfigError: the file cannot be read, or has other content.
    """
    try:
        values = yaml.safe_load(path.read_text())
    except (OSError, UnicodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: {' '.join(str(error).split())}") from None
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: it has no parameters; write lines such as 'p_gain_vel: 0.5'")
    # the file may also have parameters of the ROS node, such as topic names, which have no effect here
    driving = {str(name): value for name, value in values.items() if name not in NODE_ONLY}
    return base.with_values(driving, f"{path}: ")


def tuned_to_yaml(values: Mapping[str, float], title: str) -> str:
    """Return the text of a YAML file of the controller's parameters, each with its help as a comment."""
    lines = [f"{name}: {value!r}  # {METADATA[name]['help']}" for name, value in values.items()]
    return "\n".join([f"# {title}", *lines]) + "\n"
