"""Stops the controller after the robot has hit something; README.md lists topics and parameters."""

from __future__ import annotations

import rospy
from sensor_msgs.msg import Imu

from husky_highlevel_controller import messages
from husky_highlevel_controller.config import read_config
from husky_highlevel_controller.nodes.starting import run_node
from husky_highlevel_controller.nodes.stopping import Guard, ServiceConfig
from husky_highlevel_controller.safety import CrashConfig, crashed


class CrashStopNode:
    """Feels every knock."""

    def __init__(self) -> None:
        service, self._config = read_config(
            rospy.get_param("~", {}), rospy.get_name() + "/", ServiceConfig, CrashConfig
        )
        self._guard = Guard(service)
        # none may be missed: a crash is in one sample
        rospy.Subscriber("imu/data", Imu, self._on_imu, queue_size=100, tcp_nodelay=True)

    def run(self) -> None:
        """Work until the node is shut down."""
        self._guard.run()

    def _on_imu(self, msg: Imu) -> None:
        sample = messages.imu_from_msg(msg)
        acceleration = crashed(sample, self._config)
        danger = None
        if acceleration is not None:
            danger = f"crash: {acceleration:.1f} m/s^2, more than {self._config.max_acceleration:g}"
        self._guard.judge(sample.stamp, danger)


def main() -> None:
    """Run the node."""
    run_node("crash_stop", CrashStopNode)
