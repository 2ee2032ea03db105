"""Publishes the controller's status on /diagnostics about once a simulated second."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, List, Optional, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from husky_highlevel_controller.controller.behaviour import State
from husky_highlevel_controller.ros.node import NewSubscribers, publish

PERIOD = 1.0  # [s] of ROS time
OLD, TOO_OLD = 0.5, 2.0  # [s], age of a scan or of odom's transform that is worth a warning, an error


@dataclass(frozen=True)
class Health:
    """Figures that the status is judged by."""

    scan_age: Optional[float]  # [s], None before the first scan
    scan_rate: Optional[float]  # [Hz], by the stamps of the last scans; None for fewer than two
    tf_age: Optional[float]  # [s], of the latest odom -> base_link; None where there is none
    mounted: bool  # does TF know where the lidar is?
    state: State
    pillar: str  # "seen", "remembered" or "unknown"


def judge(health: Health) -> Tuple[int, str]:
    """Level of the status, and a message with the remedy."""
    if health.scan_age is None or health.scan_age > TOO_OLD:
        return DiagnosticStatus.ERROR, "no scans: is the lidar on, and ~scan_topic_name its topic?"
    if not health.mounted:
        return (
            DiagnosticStatus.ERROR,
            "no transform from lidar to base_link: is robot_state_publisher on?",
        )
    if health.tf_age is None or health.tf_age > TOO_OLD:
        return DiagnosticStatus.ERROR, "no transform from odom to base_link: is odometry on?"
    if health.scan_age > OLD:
        return DiagnosticStatus.WARN, "scans come late"
    if health.tf_age > OLD:
        return DiagnosticStatus.WARN, "odometry comes late"
    if health.pillar == "unknown" and health.state is not State.STOPPED:
        return DiagnosticStatus.WARN, f"{health.state.value}: no pillar"
    return DiagnosticStatus.OK, health.state.value


class Diagnostics:
    """Publisher of the status; polled, since a rospy.Timer would wake at every message on /clock."""

    def __init__(self, examine: Callable[[], Health]) -> None:
        self._examine = examine
        self._new_subscribers = NewSubscribers()
        self._publisher = rospy.Publisher(
            "/diagnostics", DiagnosticArray, self._new_subscribers, queue_size=10
        )
        self._published_at = 0.0

    def update(self) -> None:
        """Publish if a period is over or a node has subscribed; to be called several times a period."""
        now = rospy.get_time()
        is_early = 0.0 <= now - self._published_at < PERIOD  # less: the simulator was started again
        if not self._new_subscribers.take() and is_early:
            return
        self._published_at = now
        if self._publisher.get_num_connections():
            self._publish()

    def _publish(self) -> None:
        health = self._examine()
        level, message = judge(health)
        status = DiagnosticStatus(
            level=level, name=rospy.get_name().strip("/"), message=message, hardware_id="husky"
        )
        status.values = _values(health)
        array = DiagnosticArray(status=[status])
        array.header.stamp = rospy.Time.now()
        publish(self._publisher, array)


def _values(health: Health) -> List[KeyValue]:
    def number(value: Optional[float], unit: str) -> str:
        return "none" if value is None else f"{value:.3f} {unit}"

    return [
        KeyValue("scan age", number(health.scan_age, "s")),
        KeyValue("scan rate", number(health.scan_rate, "Hz")),
        KeyValue("TF age", number(health.tf_age, "s")),
        KeyValue("state", health.state.value),
        KeyValue("pillar", health.pillar),
    ]
