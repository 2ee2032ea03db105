"""Parameters of the filter: each that is refused is refused for its own reason."""

import pytest

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.estimation.filter_config import read_filter_config

LEAST = {"two_d_mode": True, "odom0": "odom", "odom0_config": [False] * 6 + [True] + [False] * 8}


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("pose0", "p", "inputs are odometry (odom0 ...) and IMU (imu0 ...)"),
        ("twist1_config", [True], "inputs are odometry (odom0 ...) and IMU (imu0 ...)"),
        ("odom0_twist_rejection_threshold", 2, "takes every measurement"),
        ("imu0_pose_rejection_threshold", 0.8, "takes every measurement"),
        ("odom0_pose_use_child_frame", True, "the pose of base_link_frame"),
        ("use_control", True, "has no model of commands"),
        ("smooth_lagged_data", True, "in the order of their stamps"),
        ("dynamic_process_noise_covariance", True, "the same at every speed"),
        ("publish_acceleration", True, "publishes pose and velocity only"),
        ("invert_tf", True, "from odom_frame to base_link_frame"),
        ("disabled_at_startup", True, "works from its start"),
        ("initial_state", [1.0, 0.0], "begins at the origin"),
        ("transform_time_offset", 0.1, "has the time of the estimate"),
        ("odom0_twist_rejection_threshold", 0, "takes every measurement"),
    ],
)
def test_a_parameter_is_refused_with_its_value_and_the_reason_unless_it_is_false(name, value, reason):
    with pytest.raises(ConfigError) as refusal:
        read_filter_config({**LEAST, name: value}, "/ekf/")
    assert str(refusal.value).startswith(f"/ekf/{name} = {value!r} is not supported: ")
    assert reason in str(refusal.value)
    assert read_filter_config({**LEAST, name: False}, "/ekf/")[1] == []


@pytest.mark.parametrize(
    ("name", "value"), [("use_control", 0), ("transform_time_offset", 0.0), ("initial_state", [0.0] * 15)]
)
def test_a_value_of_a_template_that_switches_a_missing_function_off_is_taken(name, value):
    assert read_filter_config({**LEAST, name: value}, "/ekf/")[1] == []
