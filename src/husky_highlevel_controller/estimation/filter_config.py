"""Parameters of the planar filter, with the names of robot_localization's ekf_localization_node.

In: the node's private parameters. Out: `FilterConfig`, and sentences about parameters that have no effect.
A parameter that asks for an unsupported feature is rejected with its name and value.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from husky_highlevel_controller.config import ConfigError, from_plain, number, setting

# number of variables in each `odom0_config`: x, y, z, roll, pitch, yaw, their velocities, three accelerations
VARIABLES = 15
# indices of the variables that `planar_ekf` estimates: x, y, yaw, vx, vy, yaw rate, ax, ay
PLANAR = [0, 1, 5, 6, 7, 11, 12, 13]
INPUT = re.compile(r"((?:odom|imu)\d+)(?:_(\w+))?")
# patterns of names of parameters that are rejected, unless their value switches the feature off; the text
# gives the reason
REFUSED = {
    re.compile(r"(pose|twist)\d+\w*"): "inputs are odometry (odom0 ...) and IMU (imu0 ...)",
    re.compile(r"\w+_rejection_threshold"): "the filter takes every measurement, however far it is off",
    re.compile(r"\w+_pose_use_child_frame"): "a pose is the pose of base_link_frame",
    re.compile(r"use_control"): "the filter has no model of commands, only measurements",
    re.compile(r"smooth_lagged_data"): "measurements are taken in the order of their stamps without it",
    re.compile(r"dynamic_process_noise_covariance"): "process_noise_covariance is the same at every speed",
    re.compile(r"publish_acceleration"): "the filter publishes pose and velocity only",
    re.compile(r"invert_tf"): "the transform goes from odom_frame to base_link_frame",
    re.compile(r"disabled_at_startup"): "the filter works from its start",
    re.compile(r"initial_state"): "the path begins at the origin of odom_frame",
    re.compile(r"transform_time_offset"): "the transform has the time of the estimate",
}
WITHOUT_EFFECT = re.compile(
    r"print_diagnostics|debug\w*|transform_timeout|silent_tf_failure|permit_corrected_publication|\w+_nodelay"
    r"|reset_on_time_jump|history_length|stamped_control|control_\w+|(ac|de)celeration_\w+|map_frame"
)


@dataclass(frozen=True)
class InputConfig:
    """A topic of measurements: the parameter odomN or imuN and all that begin with its name."""

    topic: str = setting("topic of nav_msgs/Odometry or sensor_msgs/Imu")
    config: Tuple[bool, ...] = setting("whether each of the VARIABLES is measured", ())
    differential: bool = setting("a pose counts as velocity since the last", False)
    relative: bool = setting("poses count from the first one on", False)
    queue_size: int = number(0, 100000, "maximum number of messages that wait", 1)
    remove_gravitational_acceleration: bool = setting("the acceleration contains gravity", False)

    def __post_init__(self) -> None:
        """Raise ValueError if `config` has another length than VARIABLES."""
        if self.config and len(self.config) != VARIABLES:
            raise ValueError(f"config has {len(self.config)} entries, not {VARIABLES}")


FRAMES = ("odom_frame", "base_link_frame", "base_link_frame_output", "world_frame")  # options that are frames


@dataclass(frozen=True)
class FilterOptions:
    """Parameters that are not inputs and not matrices."""

    frequency: float = number(0.1, 1000.0, "rate of the estimates [Hz]", 30.0)
    sensor_timeout: Optional[float] = number(
        0.0, 1e6, "time until it predicts without measurements [s]", None
    )
    two_d_mode: bool = setting("planar filter; must be true", False)
    predict_to_current_time: bool = setting(
        "an estimate has the present time, not the time of a measurement", False
    )
    publish_tf: bool = setting("odom_frame to base_link_frame", True)
    odom_frame: str = setting("frame of the start of the path", "odom")
    base_link_frame: str = setting("frame of the robot", "base_link")
    base_link_frame_output: str = setting("name of the frame in published messages", "", optional=True)
    world_frame: str = setting("must be odom_frame, if it is given", "", optional=True)
    gravitational_acceleration: float = number(0.0, 100.0, "gravity [m/s^2]", 9.80665)

    def __post_init__(self) -> None:
        """Raise ValueError for a filter that is not planar, or a `world_frame` that is not `odom_frame`."""
        if not self.two_d_mode:
            raise ValueError("two_d_mode = False is not supported, because the filter is planar")
        if self.world_frame not in ("", self.odom_frame):
            raise ValueError(f"world_frame = {self.world_frame!r} is not supported; use odom_frame")


class FilterConfig(NamedTuple):
    """Parameters of the filter."""

    options: FilterOptions  # parameters that are not inputs and not matrices
    inputs: Dict[str, InputConfig]  # inputs by name, such as odom0
    process_noise: Optional[np.ndarray]  # (8, 8) growth of the covariance per second; None means the default
    # (8, 8) covariance before the first measurement; None means the default
    initial_covariance: Optional[np.ndarray]


def read_filter_config(values: Mapping[str, Any], source: str) -> Tuple[FilterConfig, List[str]]:
    """Return the filter's parameters, and a sentence about each ignored one.

    Parameters that change nothing in this filter (WITHOUT_EFFECT) get no sentence.

    Args:
        values: parameters of the node by name.
        source: origin of the values for error texts, such as a namespace ending in '/'.

    Raises:
        ConfigError: a parameter asks for an unsupported feature, or has a value that is not allowed.
    """
    options: Dict[str, Any] = {}
    values_by_input: Dict[str, Dict[str, Any]] = {}
    matrices: Dict[str, Any] = {"process_noise_covariance": None, "initial_estimate_covariance": None}
    remarks: List[str] = []
    option_names = FilterOptions.__dataclass_fields__
    for key, value in sorted(values.items()):
        of_input = INPUT.fullmatch(key)
        refusal = _reason_against(key)
        if refusal:
            # a value that switches the unsupported feature off asks for nothing, so it is accepted
            if not _is_off(key, value):
                raise ConfigError(f"{source}{key} = {value!r} is not supported: {refusal}")
        elif WITHOUT_EFFECT.fullmatch(key):
            continue
        elif key in matrices:
            try:
                matrices[key] = _matrix(value)
            except ValueError as error:
                remarks.append(f"{source}{key} {error}; using the default")
        elif of_input:
            # odom0_config is the field `config` of the input odom0; odom0 alone is its field `topic`
            input_name, field_name = of_input[1], of_input[2] or "topic"
            values_by_input.setdefault(input_name, {})[field_name] = value
        elif key in option_names:
            # as in robot_localization, frames may begin with a slash, which tf2 does not accept
            is_frame = key in FRAMES and isinstance(value, str)
            options[key] = value.lstrip("/") if is_frame else value
        else:
            names = ", ".join(option_names)
            remarks.append(f"{source}{key} is not a parameter; there are: {names}, odom0, imu0 ...")
    inputs = _read_inputs(values_by_input, source, remarks)
    config = FilterConfig(
        options=from_plain(FilterOptions, options, source),
        inputs=inputs,
        process_noise=matrices["process_noise_covariance"],
        initial_covariance=matrices["initial_estimate_covariance"],
    )
    return config, remarks


def _reason_against(key: str) -> str:
    """Return why this filter does not support a parameter of robot_localization; empty if it does."""
    for names, reason in REFUSED.items():
        if names.fullmatch(key):
            return reason
    return ""


def _is_off(key: str, value: Any) -> bool:
    """Return whether a value switches an unsupported feature off: false, 0 or a list of zeros.

    Such a value is accepted, because the filter then does what the value asks for. A rejection threshold of 0
    does not switch the feature off, because it would reject every measurement.
    """
    if key.endswith("_rejection_threshold"):
        return value is False
    # for Python, false is equal to the number 0, so false switches a feature off, too
    numbers = value if isinstance(value, list) else [value]
    return all(isinstance(number, (int, float)) and number == 0 for number in numbers)


def _read_inputs(
    values_by_input: Mapping[str, Dict[str, Any]], source: str, remarks: List[str]
) -> Dict[str, InputConfig]:
    """Return the inputs by name, such as odom0; an input that measures nothing becomes a remark.

    Args:
        values_by_input: for each input, the values of the fields of InputConfig.
        source: origin of the values for error texts.
        remarks: sentences about ignored parameters, which get one more for each ignored input.

    Raises:
        ConfigError: an input has no topic, a value is not allowed, or there is no input that measures.
    """
    inputs: Dict[str, InputConfig] = {}
    for name, values in values_by_input.items():
        topic = values.get("topic")
        if not isinstance(topic, str) or not topic:
            raise ConfigError(f"{source}{name} = {topic!r} is not a topic")
        config = from_plain(InputConfig, values, f"{source}{name}_")
        if any(config.config):
            inputs[name] = config
        else:
            remarks.append(f"{source}{name}_config measures nothing: {topic} is not used")
    if not inputs:
        raise ConfigError(f"{source} has no input such as odom0 with odom0_config; load localization.yaml")
    return inputs


def _matrix(value: Any) -> np.ndarray:
    """Return the planar part, (8, 8), of a covariance of all VARIABLES.

    Raises:
        ValueError: the value is not such a covariance. The text is the end of a sentence about the parameter.
    """
    try:
        numbers = np.array(value, dtype=float).ravel()
    except (TypeError, ValueError):
        raise ValueError("is not a list of numbers") from None
    if len(numbers) != VARIABLES**2:
        raise ValueError(f"has {len(numbers)} numbers, not {VARIABLES**2}")
    variances = numbers[:: VARIABLES + 1]  # diagonal of the matrix, whose rows lie one after another
    if not (np.isfinite(numbers).all() and (variances >= 0.0).all()):
        raise ValueError("has NaN, infinity or a negative variance")
    return numbers.reshape(VARIABLES, VARIABLES)[np.ix_(PLANAR, PLANAR)]
