"""Watches one drive for marking: true motion, commands, markers, graph; writes a recording, and ends."""

from __future__ import annotations

import json
import signal
import threading
import time
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, List, Set, Tuple

import numpy as np
import rosgraph
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from husky_highlevel_controller import messages
from husky_highlevel_controller.datatypes import Pose, Pose2D
from husky_highlevel_controller.geometry import yaw_from_quat
from husky_highlevel_controller.grading import REACHED, TOUCH
from husky_highlevel_controller.nodes.conductor import Conductor
from husky_highlevel_controller.nodes.marker_watch import MarkerWatch
from husky_highlevel_controller.nodes.starting import run_node
from husky_highlevel_controller.recording import CUT_OFF, STANDS, Recording, hull_gaps, to_json

SIMULATOR = "/husky_simulator"
LOOK_PERIOD = 0.2  # [s] of wall time between two looks at the graph
NUDGE_AFTER = 1.0  # [s] of wall time
AT_PILLAR = 3.0  # [s], simulated: so long at the pillar, it is over
STILL, NEVER = 15.0, 20.0  # [s], simulated: so long still after a drive, or from the start, it is over


@dataclass(frozen=True)
class Assignment:
    """What to record; the marking writes it into a file."""

    output: str  # file for the recording
    start: Tuple[float, float, float]  # [m, m, rad], of base_link in the world
    pillar: Tuple[float, float]  # [m], in the world
    deadline: float  # [s], simulated
    scan_topic: str
    exercise: int
    ours: Tuple[str, ...]  # nodes that are not the submission's


class Recorder:
    """Callbacks note, `run` waits for the end and writes."""

    def __init__(self) -> None:
        path = Path(rospy.myargv()[1])
        self._task = Assignment(**json.loads(path.read_text()))
        self._lock = threading.Lock()
        self._rows: List[Tuple[float, ...]] = []
        self._truth: List[Pose] = []
        self._commands: List[float] = []
        self._command_count = 0
        self._nearest: List[Tuple[float, float]] = []
        self._watch = MarkerWatch(lambda: self._now)
        self._subscribed = self._joined = False
        self._written = False
        self._drove_at = self._moved_at = 0.0
        self._first_moved = inf
        self._began = inf  # [s] of wall time
        self._reached_at = self._touched_at = inf
        self._join = threading.Event()
        signal.signal(signal.SIGUSR1, lambda *_: self._join.set())
        rospy.on_shutdown(lambda: self._write(CUT_OFF))
        rospy.Subscriber("ground_truth/odom", Odometry, self._on_truth, queue_size=10000)
        rospy.Subscriber("cmd_vel", rospy.AnyMsg, self._on_command, queue_size=1000)
        self._master = rosgraph.Master(rospy.get_name())
        self._ours = {*self._task.ours, "/rosout", rospy.get_name()}
        self._conductor = Conductor(self._task.exercise, self._task.scan_topic, self._ours)
        rospy.loginfo("recording")

    def run(self) -> None:
        """Record until the drive is over."""
        ended = ""
        while not ended and not rospy.is_shutdown():
            self._look_at_graph()
            self._conductor.work(self._now, self._speed)
            ended = self._over()
            time.sleep(LOOK_PERIOD)
        self._write(ended)

    # ------------------------------------------------------------------------ what comes

    @property
    def _now(self) -> float:
        return self._rows[-1][0] if self._rows else 0.0

    @property
    def _speed(self) -> float:
        return self._rows[-1][4] if self._rows else 0.0

    def _on_truth(self, msg: Odometry) -> None:
        if msg._connection_header.get("callerid") != SIMULATOR or self._written:
            return  # somebody else's truth
        if self._now >= self._task.deadline:
            return
        p, q, v = msg.pose.pose.position, msg.pose.pose.orientation, msg.twist.twist
        pose = Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
        now = msg.header.stamp.to_sec()
        self._began = min(self._began, time.monotonic())
        row = (now, p.x, p.y, yaw_from_quat(pose.quat_xyzw), v.linear.x, v.angular.z)
        with self._lock:
            self._rows.append(row)
            self._truth.append(pose)
        if abs(v.linear.x) > STANDS:
            self._drove_at = now
        if abs(v.linear.x) > STANDS or abs(v.angular.z) > STANDS:
            self._moved_at, self._first_moved = now, min(self._first_moved, now)
        gap = float(hull_gaps(np.array([row[1:4]]), self._task.pillar)[0])
        self._reached_at = min(self._reached_at, now) if gap <= REACHED else inf
        if gap <= TOUCH:
            self._touched_at = min(self._touched_at, now)

    def _on_command(self, msg: Any) -> None:
        if msg._connection_header.get("callerid") == rospy.get_name():
            return
        self._command_count += 1
        now = self._now
        if not self._commands or self._commands[-1] < now:
            self._commands.append(now)

    def _on_scan(self, msg: LaserScan) -> None:
        scan = messages.scan_from_msg(msg)
        self._nearest.append((scan.stamp, float(np.min(scan.ranges, where=scan.valid, initial=inf))))
        self._conductor.answer(scan.stamp)

    # ------------------------------------------------------------------------ the graph

    def _look_at_graph(self) -> None:
        try:
            publishers, subscribers, services = self._master.getSystemState()
            types = dict(self._master.getTopicTypes())
        except (OSError, rosgraph.MasterException):
            return
        for topic, nodes in publishers:
            if set(nodes) - self._ours:
                self._watch.follow(topic, types.get(topic, ""))
        listeners: Set[str] = set(dict(subscribers).get(self._task.scan_topic, ()))
        self._subscribed = self._subscribed or bool(listeners - self._ours)
        self._conductor.look(services)
        senders = set(dict(publishers).get(rospy.resolve_name("cmd_vel"), ()))
        there = self._subscribed and bool(senders - self._ours or self._task.exercise == 2)
        # only after the submission, for which lockstep waits, or in its place
        if not self._joined and (there or self._join.is_set()):
            self._joined = True
            print("joined", flush=True)
            if not there:
                self._conductor.stand_in()
            rospy.Subscriber(self._task.scan_topic, LaserScan, self._on_scan, queue_size=1000)
        # the first command is lost where the submission's publisher does not know the simulator yet
        if self._rows and self._command_count == 0 and time.monotonic() > self._began + NUDGE_AFTER:
            self._conductor.nudge()

    # ------------------------------------------------------------------------ the end

    def _over(self) -> str:
        now = self._now
        if now >= self._task.deadline:
            return f"the deadline of {self._task.deadline:g} s"
        if self._task.exercise != 3:
            return self._conductor.over
        still = now - self._moved_at
        if now >= self._touched_at + AT_PILLAR:
            return "it touched the pillar"
        if self._first_moved < inf:
            if min(now - self._drove_at, now - self._reached_at) >= AT_PILLAR:
                return "it stands at the pillar"
            return f"it stood still for {STILL:g} s" if still >= STILL else ""
        return f"it did not move for {NEVER:g} s" if now >= NEVER else ""

    def _write(self, ended: str) -> None:
        with self._lock:
            if self._written:
                return
            self._written = True
        table = np.array(self._rows, dtype=float).reshape(-1, 6)
        topic_parameters, queue_parameters = self._conductor.parameters()
        recording = Recording(
            start=Pose2D(*self._task.start),
            pillar=self._task.pillar,
            deadline=self._task.deadline,
            times=table[:, 0],
            poses=table[:, 1:4],
            speeds=table[:, 4:6],
            commands=np.array(self._commands),
            command_count=self._command_count,
            nearest=np.array(self._nearest).reshape(-1, 2),
            markers=self._watch.shown(table[:, 0], self._truth),
            marker_topics=self._watch.topics,
            services=tuple(sorted(self._conductor.services)),
            calls=tuple(self._conductor.calls),
            topic_parameters=topic_parameters,
            queue_parameters=queue_parameters,
            subscribed=self._subscribed,
            ended=ended,
        )
        part = Path(self._task.output + ".part")
        part.write_text(to_json(recording))
        part.replace(self._task.output)


def main() -> None:
    """Run the node."""
    run_node("marking_recorder", Recorder)


if __name__ == "__main__":
    main()
