"""Node that ends with the drive, for CI: exit code 0 at the pillar, 1 with the reason without arrival."""

from __future__ import annotations

import time
from dataclasses import dataclass

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Bool

from husky_highlevel_controller.config import number, read_config
from husky_highlevel_controller.controller.behaviour import State
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.ros.node import run_node

CONTROLLER = "husky_highlevel_controller"  # its node's name, in this node's namespace
POLL_PERIOD = 0.02  # [s] of wall time: half a simulated second of a fast simulation


@dataclass(frozen=True)
class ExitConfig:
    """End of a drive that does not arrive."""

    deadline: float = number(0.1, 1e6, "simulated time until the drive has failed [s]", default=120.0)


class ArrivalExit:
    """Waits for the arrival that the controller announces."""

    def __init__(self) -> None:
        (self._config,) = read_config(rospy.get_param("~", {}), rospy.get_name() + "/", ExitConfig)
        self._arrived = False
        self._starts_enabled = rospy.get_param(f"{CONTROLLER}/start_enabled", True)
        self._state, self._status = "", "nothing heard of the controller"
        rospy.Subscriber(f"{CONTROLLER}/arrived", Bool, self._on_arrived)
        rospy.Subscriber("/diagnostics", DiagnosticArray, self._on_diagnostics)

    def run(self) -> None:
        """Return at arrival; HuskyError at the deadline, or where the controller is stopped on its way."""
        while not (self._arrived or rospy.is_shutdown()):
            if self._starts_enabled and self._state == State.STOPPED.value:
                raise HuskyError(
                    f"stopped on its way after {rospy.get_time():.1f} s, by a guard or its service"
                )
            if rospy.get_time() > self._config.deadline:
                raise HuskyError(
                    f"no arrival within {self._config.deadline:g} s of simulated time; last: {self._status}"
                )
            time.sleep(POLL_PERIOD)

    def _on_arrived(self, message: Bool) -> None:
        self._arrived = message.data

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == rospy.resolve_name(CONTROLLER).strip("/"):
                self._state = next((item.value for item in status.values if item.key == "state"), "")
                self._status = status.message


def main() -> None:
    """Run the node."""
    run_node("arrival_exit", ArrivalExit)
