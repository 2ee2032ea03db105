"""Publishes the controller's status on /diagnostics every second of ROS time, and when the status changes."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Callable, List, Optional, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from husky_highlevel_controller.controller.behaviour import State
from husky_highlevel_controller.controller.sensor_faults import (
    MAX_OFFSET,
    clock_sentence,
    frame_sentence,
    zero_sentence,
)
from husky_highlevel_controller.ros.node import NewSubscribers, publish

PERIOD = 1.0  # [s] ROS time between two messages on /diagnostics
OUR_CLOCK = "this computer's clock"
OLD = 0.5  # [s] age of a scan, or of a transform of odom, that causes a warning
TOO_OLD = 2.0  # [s] age of a scan, or of a transform of odom, that causes an error
# simulated time counts as paused after this many calls of update() in a row without a change of ROS time
STILL_POLLS = 5


@dataclass(frozen=True)
class Health:
    """Data from which the status is made."""

    paused: bool  # true if simulated time stands still
    scan_silence: Optional[float]  # [s] time since the last scan came; None before the first
    scan_age: float  # [s] age of the last scan when it came, which is ROS time minus its stamp
    scan_stamp: float  # [s] stamp of the last scan
    # [Hz] rate of the last scans by their stamps; None if there are fewer than two scans
    scan_rate: Optional[float]
    scan_fault: str  # sentence on the fault of the last scan; empty if it was accepted
    scan_frame: str  # frame of the last scan
    has_lidar_transform: bool  # true if TF has a transform from the lidar to base_link
    # [s] time since the last new transform odom -> base_link came; None if TF has no such transform
    tf_silence: Optional[float]
    tf_age: float  # [s] age of the latest transform odom -> base_link, by its stamp
    scans_ahead: float  # [s] time by which the scans' clock is ahead of odometry's clock
    state: State  # state of the controller
    pillar: str  # state of the pillar: "seen", "remembered" or "unknown"
    reason: str = ""  # reason of the controller's last command
    disobedience: str = ""  # sentence on why the robot does not follow the commands; empty if it follows them
    scan_absence: str = ""  # sentence on why no scans come; empty if unknown


def level_and_message(health: Health) -> Tuple[int, str]:
    """Return the level of the status, and its message: the first problem with its remedy, or the state."""
    if health.paused:
        return DiagnosticStatus.OK, "simulated time stands still"
    # Only the first problem is reported, because it may be the cause of later ones. For example, no pillar is
    # found without scans. The order is: errors, clocks, delays, motion of the robot, reasons of the
    # controller.
    error = _error(health)
    if error is not None:
        return DiagnosticStatus.ERROR, error
    # `scans_ahead` is 0 unless the clocks of scans and odometry differ by more than a tolerance
    if health.scans_ahead > 0.0:
        return DiagnosticStatus.WARN, clock_sentence("scans are", health.scans_ahead, "odometry")
    # a stamp of 0 means that the driver of the lidar does not set stamps
    if health.scan_stamp == 0.0 and health.scan_age > OLD:
        return DiagnosticStatus.WARN, zero_sentence("scans are")
    # the stamp is in the future, so it comes from another clock
    if health.scan_age < -OLD:
        return DiagnosticStatus.WARN, clock_sentence("scans are", -health.scan_age, OUR_CLOCK)
    # `scan_silence` is not None here, because `_error` reports that no scan has come
    if health.scan_age > OLD or (health.scan_silence or 0.0) > OLD:
        return DiagnosticStatus.WARN, "scans come late"
    if health.tf_age > OLD:
        return DiagnosticStatus.WARN, "odometry comes late"
    if health.disobedience:
        return DiagnosticStatus.WARN, health.disobedience
    if health.state is State.WAITING and health.reason:
        return DiagnosticStatus.WARN, health.reason
    # a robot that was stopped needs no pillar
    if health.pillar == "unknown" and health.state is not State.STOPPED:
        return DiagnosticStatus.WARN, f"{health.state.value}: no pillar"
    return DiagnosticStatus.OK, health.state.value


def _error(health: Health) -> Optional[str]:
    """Return the first problem that keeps the robot from driving, with its remedy; None if there is none."""
    if health.scan_silence is None or health.scan_silence > TOO_OLD:
        return health.scan_absence or "no scans; check that the lidar is on and ~scan_topic_name is its topic"
    if health.scan_fault:
        return f"standing still: {health.scan_fault}; check the driver of the lidar"
    if not health.has_lidar_transform:
        return frame_sentence(health.scan_frame)
    if health.tf_silence is None or health.tf_silence > TOO_OLD:
        return "no transform from odom to base_link; check that odometry is running"
    if health.scans_ahead > MAX_OFFSET:
        return f"standing still: {clock_sentence('scans are', health.scans_ahead, 'odometry')}"
    # Scans come, because their silence was tested above. So a very old stamp is from another clock. A stamp 0
    # means that the driver sets no stamps, which causes only a warning. Below, the ages get a minus sign,
    # because `clock_sentence` expects the time by which stamps are ahead of a clock.
    if health.scan_age > TOO_OLD and health.scan_stamp != 0.0:
        return clock_sentence("scans are", -health.scan_age, OUR_CLOCK)
    if health.tf_age > TOO_OLD:
        return clock_sentence("odometry is", -health.tf_age, OUR_CLOCK)
    return None


class Diagnostics:
    """Publisher of the status.

    The node's main loop calls `update` often. A timer of rospy would cost more CPU time, because it wakes at
    every message on /clock.
    """

    def __init__(self, examine: Callable[[bool], Health]) -> None:
        """Advertise the topic; the status is made of the result of `examine`.

        The argument of `examine` says whether simulated time stands still.
        """
        self._examine = examine
        self._new_subscribers = NewSubscribers()
        self._publisher = rospy.Publisher(
            "/diagnostics", DiagnosticArray, self._new_subscribers, queue_size=10
        )
        self._published_at = 0.0  # [s] ROS time of the last message on /diagnostics
        self._last_time = 0.0  # [s] ROS time at the last call of `update`
        self._still_polls = 0  # number of calls of `update` in a row without a change of ROS time
        self._has_changed = threading.Event()  # set by `hasten`, cleared by the next `update`

    def hasten(self) -> None:
        """Let the next `update` publish the status, because it has changed; any thread may call this."""
        self._has_changed.set()

    def wait(self, period: float) -> None:
        """Wait until a period [s] of wall time is over, or the status has changed."""
        self._has_changed.wait(period)

    def update(self) -> None:
        """Publish if a period is over, the status has changed, or a node has subscribed. Call it often."""
        now = rospy.get_time()
        has_changed = self._has_changed.is_set()
        self._has_changed.clear()
        # the status says whether simulated time is paused, so it is published when a pause begins or ends
        was_paused = self._is_still
        self._count_still_polls(now, has_changed)  # may change `_is_still`
        has_pause_changed = self._is_still != was_paused
        is_due_at_once = self._new_subscribers.take() or has_changed or has_pause_changed
        # the difference is negative if the simulator was started again, because its time then goes back
        is_early = 0.0 <= now - self._published_at < PERIOD
        if is_early and not is_due_at_once:
            return
        self._published_at = now
        if self._publisher.get_num_connections():
            self._publish()

    def _count_still_polls(self, now: float, has_changed: bool) -> None:
        """Count the calls of `update` in a row without a change of ROS time; `now` is the ROS time [s].

        A call because of a changed status (`has_changed`) is not counted, because it comes so early that ROS
        time may not have advanced yet.
        """
        if now != self._last_time:
            self._still_polls = 0
        elif not has_changed:
            self._still_polls += 1
        self._last_time = now

    @property
    def _is_still(self) -> bool:
        """Return whether ROS time has not changed in the last STILL_POLLS calls of `update`."""
        return self._still_polls >= STILL_POLLS

    def _publish(self) -> None:
        """Examine the controller, and publish the result on /diagnostics."""
        # ROS time is 0 until the first message on /clock; until then, simulated time counts as paused
        is_paused = self._is_still or self._last_time == 0.0
        health = self._examine(is_paused)
        level, message = level_and_message(health)
        status = DiagnosticStatus(
            level=level, name=rospy.get_name().strip("/"), message=message, hardware_id="husky"
        )
        status.values = _values(health)
        array = DiagnosticArray(status=[status])
        array.header.stamp = rospy.Time.now()
        publish(self._publisher, array)


def _values(health: Health) -> List[KeyValue]:
    """Return the figures of the status as pairs of a name and a text with its unit."""

    def number(value: Optional[float], unit: str) -> str:
        return "none" if value is None else f"{value:.3f} {unit}"

    return [
        KeyValue("scan age", number(health.scan_age, "s")),
        KeyValue("since the last scan", number(health.scan_silence, "s")),
        KeyValue("scans ahead of odometry", number(health.scans_ahead, "s")),
        KeyValue("scan rate", number(health.scan_rate, "Hz")),
        KeyValue("TF age", number(health.tf_age, "s")),
        KeyValue("state", health.state.value),
        KeyValue("pillar", health.pillar),
    ]
