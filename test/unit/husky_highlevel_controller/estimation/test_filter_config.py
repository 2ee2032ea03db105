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
    ],
)
def test_a_parameter_is_refused_with_its_value_and_the_reason_unless_it_is_false(name, value, reason):
    with pytest.raises(ConfigError) as refusal:
        read_filter_config({**LEAST, name: value}, "/ekf/")
    assert str(refusal.value).startswith(f"/ekf/{name} = {value!r} is not supported: ")
    assert reason in str(refusal.value)
    assert read_filter_config({**LEAST, name: False}, "/ekf/")[1] == []
