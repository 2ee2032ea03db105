"""The pillar controller as a ROS node; README.md lists its topics, services and parameters."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Deque, Optional, Tuple

import rosgraph.names
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped, Twist
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from husky_highlevel_controller import messages
from husky_highlevel_controller.behaviour import Decision, Memory, Phase, View, decide
from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.control import ControlConfig
from husky_highlevel_controller.datatypes import STOP, Pillar, Pose, Pose2D, Scan
from husky_highlevel_controller.geometry import pose_to_2d
from husky_highlevel_controller.nodes.diagnostics import Diagnostics, Health
from husky_highlevel_controller.nodes.display import BASE, ODOM, Display
from husky_highlevel_controller.nodes.starting import publish, run_node
from husky_highlevel_controller.nodes.tuning import Tuning
from husky_highlevel_controller.pillar import PillarConfig

LOG = logging.getLogger("rosout")  # rospy's own; asked before a line is made that hardly anybody reads
REPORT_PERIOD = 5.0  # [s] between two complaints about the same
PATIENCE = 50  # scans that may have to do without a transform before that is worth a word
START_PATIENCE = 4.0  # [s] of wall time that the first scan waits for TF
TF_PATIENCE = 2.0  # [s] of wall time that the transform of a scan's moment may be late
TF_GLANCE = 0.0001  # [s] of wall time between two looks for it
GLANCE = 0.1  # [s] of wall time between two looks at what is fixed, and at whether /diagnostics is due


@dataclass(frozen=True)
class ScanTopicConfig:
    """Where the scans come from."""

    scan_topic_name: str = field(default="/front/scan", metadata={"help": "topic of the lidar's scans"})
    scan_topic_queue_size: int = field(
        default=1, metadata={"min": 1, "max": 1000, "help": "scans kept while busy; an old scan is of no use"}
    )


@dataclass(frozen=True)
class StartStopConfig:
    """Who lets the robot drive."""

    start_stop_service_name: str = field(
        default="~start_stop", metadata={"help": "service that starts (true) and stops (false) the robot"}
    )
    start_enabled: bool = field(default=True, metadata={"help": "drive from the start, unasked"})


class ControllerNode:
    """Answers every scan with a velocity command, and shows what it makes of it."""

    def __init__(self, tunable: Any) -> None:
        """Read the parameters, join the network.

        Args:
            tunable: the module that catkin makes from cfg/Controller.cfg.
        """
        namespace = rospy.get_name() + "/"
        topic, switch, control, looks = read_config(
            rospy.get_param("~", {}), namespace, ScanTopicConfig, StartStopConfig, ControlConfig, PillarConfig
        )
        service = switch.start_stop_service_name
        if not rosgraph.names.is_legal_name(service):
            raise ConfigError(
                f"{namespace}start_stop_service_name = {service!r} is no ROS name; try '~start_stop'"
            )
        self._enabled = switch.start_enabled
        self._memory = Memory()
        self._deciding = threading.Lock()  # so that nothing but zero follows a stop
        self._arrived: Optional[bool] = None
        self._seen, self._reason = "unknown", ""
        self._scans_unplaced = 0
        self._given_up_at: Optional[rospy.Time] = None
        self._stamps: Deque[float] = deque(maxlen=PATIENCE)
        self._laser_frame = ""
        self._fixed: Optional[Tuple[str, Pose]] = None  # a lidar's frame, and where it is for good
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms, tcp_nodelay=True)
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self._announcement = rospy.Publisher("~arrived", Bool, queue_size=1, latch=True)
        self._display = Display()
        self._tuning = Tuning(tunable, control, looks)
        self._diagnostics = Diagnostics(self._examine)
        rospy.on_shutdown(self._stop)
        rospy.Service(service, SetBool, self._on_start_stop)
        rospy.Subscriber(
            topic.scan_topic_name,
            numpy_msg(LaserScan),
            self._on_scan,
            queue_size=topic.scan_topic_queue_size,
            tcp_nodelay=True,
        )
        rospy.loginfo("waiting for scans on %s", rospy.resolve_name(topic.scan_topic_name))
        if not self._enabled:
            rospy.loginfo(
                "standing still until told to start: rosservice call %s true", rospy.resolve_name(service)
            )

    def run(self) -> None:
        """Work until the node is shut down."""
        while not rospy.is_shutdown():
            self._diagnostics.update()
            self._fixed = None
            time.sleep(GLANCE)

    def _stop(self) -> None:
        publish(self._velocity, messages.twist_to_msg(STOP))

    def _on_start_stop(self, request: SetBoolRequest) -> SetBoolResponse:
        with self._deciding:
            already = self._enabled is request.data
            self._enabled = request.data
            if not request.data:
                self._stop()
        now = "driving to the pillar" if request.data else "standing still until told to start"
        message = f"{'already ' if already else ''}{now}"
        rospy.loginfo("%s: %s", "started" if request.data else "stopped", message)
        return SetBoolResponse(True, message)

    def _on_scan(self, msg: LaserScan) -> None:
        scan = messages.scan_from_msg(msg)
        if not self._stamps:
            self._wait_for_tf(scan.frame)
        view = View(scan, self._laser_in_base(scan.frame), self._base_in_odom(msg.header.stamp))
        with self._deciding:
            control, looks = self._tuning.records
            before = self._memory
            self._memory, decision = decide(before, view, self._enabled, control, looks)
            publish(self._velocity, messages.twist_to_msg(decision.twist))
        self._stamps.append(scan.stamp)
        self._tell(view, before, decision, control)
        self._announce(decision.at_pillar)
        self._display.show(view, decision, control.stop_distance)

    # ------------------------------------------------------------------------ TF

    def _wait_for_tf(self, frame: str) -> None:
        """Let TF get going before the first scan is answered: lockstep runs then all start alike."""
        end = time.monotonic() + START_PATIENCE
        while not (self._lookup(BASE, frame) and self._lookup(ODOM, BASE)) and time.monotonic() < end:
            time.sleep(TF_GLANCE)

    def _laser_in_base(self, frame: str) -> Optional[Pose]:
        self._laser_frame, fixed = frame, self._fixed
        if fixed is not None and fixed[0] == frame:
            return fixed[1]
        found = self._lookup(BASE, frame)
        self._scans_unplaced = 0 if found else self._scans_unplaced + 1
        if self._scans_unplaced > PATIENCE:
            rospy.logwarn_throttle(
                REPORT_PERIOD,
                f"no transform from '{frame}' to '{BASE}', so the robot stands still; "
                "is robot_state_publisher running?",
            )
        if found is None:
            return None
        pose = messages.pose_from_transform(found)
        if found.header.stamp.is_zero():  # only /tf_static has a say in it
            self._fixed = frame, pose
        return pose

    def _base_in_odom(self, moment: rospy.Time) -> Optional[Pose2D]:
        """Where the robot was at a scan's moment; TF travels by another road and may come a little later.

        Waited for by the wall's clock, since ROS time may stand still until this scan is answered. Where it
        does not come the latest pose has to do; None where TF knows none.
        """
        end = time.monotonic() + TF_PATIENCE
        while True:
            # the latest is mostly that of the moment; asking for a moment that is not there yet costs more
            found = self._lookup(ODOM, BASE)
            if found is None or found.header.stamp == moment:
                break
            if found.header.stamp > moment or found.header.stamp.is_zero():  # or fixed for good
                exact = self._lookup(ODOM, BASE, moment)
                if exact or found.header.stamp > moment:
                    found = exact or found
                    break
            if found.header.stamp == self._given_up_at or time.monotonic() > end:
                self._given_up_at = found.header.stamp  # odometry that stands still is waited for only once
                break
            time.sleep(TF_GLANCE)
        return pose_to_2d(messages.pose_from_transform(found)) if found else None

    def _lookup(
        self, parent: str, child: str, moment: Optional[rospy.Time] = None
    ) -> Optional[TransformStamped]:
        """What TF knows, at a moment or (None) the latest; never waits."""
        try:
            return self._transforms.lookup_transform_core(parent, child, moment or rospy.Time())
        except (tf2_ros.TransformException, ValueError):  # ValueError: a frame whose name is none
            return None

    # ------------------------------------------------------------------------ words

    def _tell(self, view: View, before: Memory, decision: Decision, control: ControlConfig) -> None:
        """Log what a scan holds at DEBUG level, and what changed at INFO level, or WARN with the remedy."""
        scan, pillar, phase = view.scan, decision.pillar, decision.phase
        self._seen = "seen" if pillar else "remembered" if decision.estimate else "unknown"
        if LOG.isEnabledFor(logging.DEBUG):
            twist = decision.twist
            rospy.logdebug(
                f"scan {scan.stamp:.2f}: {phase.value}, {twist.linear:.2f} m/s, {twist.angular:.2f} rad/s; "
                f"{_seen(scan, pillar)}; {decision.reason}"
            )
        changed = _stage(self._memory) != _stage(before)
        changed |= phase is Phase.WAITING and decision.reason != self._reason
        self._reason = decision.reason
        if not changed:
            return
        if phase is Phase.ARRIVED and pillar is not None and before.at_pillar:
            rospy.loginfo(f"at the pillar already, {pillar.distance:.3f} m from it")
        elif phase is Phase.ARRIVED and pillar is not None:
            taken = scan.stamp - (self._memory.started_at or 0.0)
            rospy.loginfo(
                f"arrived after {taken:.2f} s of simulated time, {pillar.distance:.3f} m from the pillar "
                f"(stop_distance {control.stop_distance:g} m)"
            )
        elif phase is Phase.DRIVING:
            to_go = f"{decision.distance_error:.2f} m to go"
            rospy.loginfo(f"{decision.reason}, {to_go}; {_seen(scan, pillar)}")
        elif phase is Phase.SEARCHING:
            rospy.loginfo(decision.reason)
        elif phase is Phase.WAITING and view.laser_in_base is not None:
            rospy.logwarn(decision.reason)

    def _announce(self, arrived: bool) -> None:
        """Say on ~arrived what has changed."""
        if arrived is not self._arrived:
            publish(self._announcement, Bool(arrived))
        self._arrived = arrived

    def _examine(self) -> Health:
        """How it goes, for /diagnostics."""
        now, stamps = rospy.get_time(), list(self._stamps)
        latest = self._lookup(ODOM, BASE)
        span = stamps[-1] - stamps[0] if len(stamps) > 1 else 0.0
        return Health(
            scan_age=now - stamps[-1] if stamps else None,
            scan_rate=(len(stamps) - 1) / span if span > 0.0 else None,
            tf_age=now - latest.header.stamp.to_sec() if latest else None,
            mounted=self._lookup(BASE, self._laser_frame) is not None,
            phase=self._memory.phase,
            pillar=self._seen,
        )


def _seen(scan: Scan, pillar: Optional[Pillar]) -> str:
    nearest = scan.ranges[scan.valid]
    seen = f"smallest range {nearest.min():.3f} m" if len(nearest) else "no valid range"
    if pillar is not None:
        seen += f", pillar at x {pillar.x:.3f} m, y {pillar.y:.3f} m, angle {pillar.bearing:.3f} rad"
    return f"{seen} in {scan.frame}"


def _stage(memory: Memory) -> Tuple[Phase, bool]:
    """What is worth a line in the log when it changes; the legs of a search are one stage."""
    return memory.phase, memory.search is not None and memory.search.leg > 0


def main() -> None:
    """Run the node."""
    # only a built workspace has it, and tests read this module without one
    from husky_highlevel_controller.cfg import ControllerConfig

    run_node("husky_highlevel_controller", lambda: ControllerNode(ControllerConfig))
