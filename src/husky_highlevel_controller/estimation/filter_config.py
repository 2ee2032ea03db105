"""Parameters of the planar filter, by the names of robot_localization's ekf_localization_node.

In: the node's private parameters. Out: `FilterConfig`, and sentences about those that have no effect.
What this filter does not do is refused by name and value.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.config import ConfigError, from_plain

VARIABLES = (
    15  # x, y, z, roll, pitch, yaw, their velocities, and three accelerations: of every `odom0_config`
)
PLANAR = [0, 1, 5, 6, 7, 11, 12, 13]  # the states of `planar_ekf` among them
INPUT = re.compile(r"((?:odom|imu)\d+)(?:_(\w+))?")
REFUSED = {  # unless false
    re.compile(r"(pose|twist)\d+\w*"): "inputs are odometry and IMU",
    re.compile(r"\w+_rejection_threshold"): "no measurement is rejected for its distance",
    re.compile(r"\w+_pose_use_child_frame"): "poses are base_link's",
    re.compile("use_control"): "commands are no measurements here",
    re.compile("smooth_lagged_data"): "measurements are taken in the order of their stamps",
    re.compile("dynamic_process_noise_covariance"): "the process noise is constant",
    re.compile("publish_acceleration"): "only odometry is published",
    re.compile("invert_tf"): "base_link is a child of odom",
    re.compile("disabled_at_startup"): "there is no service that starts the filter",
}
WITHOUT_EFFECT = re.compile(
    r"print_diagnostics|debug\w*|transform_t\w+|silent_tf_failure|permit_corrected_publication|\w+_nodelay"
    r"|reset_on_time_jump|history_length|stamped_control|control_\w+|(ac|de)celeration_\w+|map_frame"
)


@dataclass(frozen=True)
class InputConfig:
    """A topic of measurements: the parameter odomN or imuN and those that begin with its name."""

    topic: str = field(metadata={"help": "of nav_msgs/Odometry or sensor_msgs/Imu"})
    config: Tuple[bool, ...] = field(
        default=(),
        metadata={"help": "whether x, y, z, roll, pitch, yaw, their velocities, ax, ay, az are measured"},
    )
    differential: bool = field(default=False, metadata={"help": "a pose counts as velocity since the last"})
    relative: bool = field(default=False, metadata={"help": "poses count from the first one on"})
    queue_size: int = field(default=1, metadata={"min": 0, "max": 100000, "help": "messages"})
    remove_gravitational_acceleration: bool = field(
        default=False, metadata={"help": "the acceleration contains gravity"}
    )

    def __post_init__(self) -> None:
        if self.config and len(self.config) != VARIABLES:
            raise ValueError(f"config has {len(self.config)} entries, not {VARIABLES}")


@dataclass(frozen=True)
class FilterOptions:
    """Parameters without a number or a matrix in them."""

    frequency: float = field(default=30.0, metadata={"min": 0.1, "max": 1000.0, "help": "of estimates [Hz]"})
    sensor_timeout: Optional[float] = field(
        default=None,
        metadata={"min": 0.0, "max": 1e6, "help": "without a measurement, before it predicts [s]"},
    )
    two_d_mode: bool = field(default=False, metadata={"help": "true"})
    predict_to_current_time: bool = field(
        default=False, metadata={"help": "an estimate is of its own time, not of the last measurement's"}
    )
    publish_tf: bool = field(default=True, metadata={"help": "odom_frame to base_link_frame"})
    odom_frame: str = field(default="odom", metadata={"help": "where the path begins"})
    base_link_frame: str = field(default="base_link", metadata={"help": "of the robot"})
    base_link_frame_output: str = field(
        default="", metadata={"optional": True, "help": "its name in what is published"}
    )
    world_frame: str = field(default="", metadata={"optional": True, "help": "odom_frame"})
    gravitational_acceleration: float = field(
        default=9.80665, metadata={"min": 0.0, "max": 100.0, "help": "[m/s^2]"}
    )

    def __post_init__(self) -> None:
        if not self.two_d_mode:
            raise ValueError("two_d_mode = False is not supported: the filter is planar")
        if self.world_frame not in ("", self.odom_frame):
            raise ValueError(f"world_frame = {self.world_frame!r} is not supported: it is odom_frame")


class FilterConfig(NamedTuple):
    """Parameters of the filter."""

    options: FilterOptions
    inputs: Dict[str, InputConfig]  # by name, such as odom0
    process_noise: Optional[np.ndarray]  # (8, 8), growth of the covariance a second; None: the default
    initial_covariance: Optional[np.ndarray]  # (8, 8); None: the default


def read_filter_config(values: Mapping[str, Any], source: str) -> Tuple[FilterConfig, List[str]]:
    """The filter's parameters, and a sentence about each that is left aside.

    Args:
        values: parameter names and values.
        source: where they come from, for error texts: a namespace ending in '/'.

    Raises:
        ConfigError: a parameter asks for what this filter does not do, or has a value that is not allowed.
    """
    options: Dict[str, Any] = {}
    by_input: Dict[str, Dict[str, Any]] = {}
    remarks: List[str] = []
    known = FilterOptions.__dataclass_fields__
    matrices: Dict[str, Optional[np.ndarray]] = {
        "process_noise_covariance": None,
        "initial_estimate_covariance": None,
    }
    for key, value in sorted(values.items()):
        reason = next((text for pattern, text in REFUSED.items() if pattern.fullmatch(key)), None)
        of_input = INPUT.fullmatch(key)
        if reason and value is not False:
            raise ConfigError(f"{source}{key} = {value!r} is not supported: {reason}")
        if reason or WITHOUT_EFFECT.fullmatch(key):
            continue
        if key in matrices:
            matrices[key] = _matrix(key, value, source, remarks)
        elif of_input:
            by_input.setdefault(of_input[1], {})[of_input[2] or "topic"] = value
        elif key in known:
            options[key] = value
        else:
            remarks.append(
                f"{source}{key} is not a parameter; there are: {', '.join(known)}, odom0, imu0 ..."
            )
    for name, entries in by_input.items():
        if not isinstance(entries.get("topic"), str) or not entries["topic"]:
            raise ConfigError(f"{source}{name} = {entries.get('topic')!r} is not a topic")
    inputs = {
        name: from_plain(InputConfig, entries, f"{source}{name}_") for name, entries in by_input.items()
    }
    for name, item in inputs.items():
        if not any(item.config):
            remarks.append(f"{source}{name}_config has nothing that is true: {item.topic} is not used")
    inputs = {name: item for name, item in inputs.items() if any(item.config)}
    if not inputs:
        raise ConfigError(f"{source} has no input, as odom0 and odom0_config: is localization.yaml loaded?")
    return FilterConfig(from_plain(FilterOptions, options, source), inputs, *matrices.values()), remarks


def _matrix(key: str, value: Any, source: str, remarks: List[str]) -> Optional[np.ndarray]:
    """The plane's part of a covariance of all variables, (8, 8); None, with a remark, if it is none."""
    count, fault = VARIABLES**2, ""
    numbers = np.zeros(0)
    try:
        numbers = np.array(value, dtype=float).ravel()
    except (TypeError, ValueError):
        fault = "is not a list of numbers"
    if not fault and len(numbers) != count:
        fault = f"has {len(numbers)} numbers, not {count}"
    if not fault and not (np.isfinite(numbers).all() and (numbers[:: VARIABLES + 1] >= 0.0).all()):
        fault = "has NaN, infinity or a negative variance"
    if fault:
        remarks.append(f"{source}{key} {fault}: the default counts")
        return None
    return numbers.reshape(VARIABLES, VARIABLES)[np.ix_(PLANAR, PLANAR)]
