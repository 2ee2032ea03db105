"""Records one drive for grading: true motion, commands, markers, the ROS graph."""

from __future__ import annotations

import hashlib
import resource
import signal
import threading
import time
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any, Dict, List, Optional, Set, Tuple

import numpy as np
import rosgraph
import rospy
from sensor_msgs.msg import LaserScan

from husky_grading.drive.call_plan import BAG, FORWARD
from husky_grading.drive.drive_end import NO_COMMAND, DriveEnd
from husky_grading.drive.ros_graph import (
    TRUTH,
    forged_topics,
    listens,
    silent_topics,
    topics_of_truth,
    unread_topics,
)
from husky_grading.drive.truth_feed import TruthFeed
from husky_grading.nodes.exercise_driver import UNANSWERED, ExerciseDriver
from husky_grading.nodes.marker_watch import MarkerWatch
from husky_grading.nodes.playback_watch import PlaybackWatch
from husky_grading.notes import Kind, Note
from husky_grading.recording import (
    CUT_OFF,
    Assignment,
    Closing,
    Status,
    ahead_and_turn,
    closed,
    is_zero,
    pose_jumps,
    scan_hits,
    to_json,
)
from husky_highlevel_controller.config import load
from husky_highlevel_controller.config import to_json as record_to_json
from husky_highlevel_controller.datatypes import Scan, TrueState
from husky_highlevel_controller.geometry import pose_to_2d
from husky_highlevel_controller.robot import ROBOTS, load_robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import run_node

LOOK_PERIOD = 0.2  # [s] of wall time between two looks at the graph
CLOSING_PERIOD = 0.02  # [s] of wall time between two looks for what marking has to say
CONNECTING = 2.0  # [s] of wall time for the submission's publishers to connect before time begins
# to the robot's mux, or past it
VELOCITY_TOPICS = ("cmd_vel", *(load_robot(name).topics.wheel_command for name in ROBOTS))
SILENT = 2.0  # [s], simulated: a submission that listens, but advertises no command by then, sends none
MEMORY = 2_000_000_000  # [bytes] of the recorder; its threads' stacks are some hundred million
MAX_VIOLATIONS = 5  # that are named
BAG_MARGIN = 0.1  # [s], simulated: the last pose may come so long before the end of a bag
HITS_PERIOD = 1.0  # [s], simulated, between two scans whose points are kept for a picture


class DriveRecorder:
    """Callbacks append, `run` waits for the end and writes."""

    def __init__(self) -> None:
        path = Path(rospy.myargv()[1])
        self._task = load(Assignment, path)
        self._known = self._task.recording
        self._lock = threading.Lock()
        self._truth: List[TrueState] = []
        self._end = DriveEnd(self._known.pillar, self._known.robot)
        self._commands: List[float] = []
        self._command_count = self._zero_count = 0
        self._fastest = self._sharpest = 0.0
        self._nearest: List[Tuple[float, float]] = []
        self._scans: List[Scan] = []
        self._watch = MarkerWatch(lambda: self._now, self._task.packages)
        played = self._known.playback
        self._playback = PlaybackWatch(self._watch, played) if played else None
        self._subscribed = self._listens = self._advertises = False
        self._joined_at = inf  # [s] of wall time
        self._publishers: Dict[str, List[str]] = {}  # names of nodes by topic
        self._is_over = self._written = False
        self._status, self._status_lock = Status(), threading.Lock()
        self._types: Dict[str, str] = {}  # of topics
        self._silent: List[str] = []
        self._unread: List[str] = []
        self._violations: Dict[str, None] = {}  # in order
        self._unanswered = ""
        self._go_on, self._abandoned = threading.Event(), threading.Event()
        signal.signal(signal.SIGUSR1, lambda *_: self._go_on.set())
        signal.signal(signal.SIGUSR2, lambda *_: self._abandoned.set())
        rospy.on_shutdown(lambda: self._write(CUT_OFF))
        self._master = rosgraph.Master(rospy.get_name())
        self._our_nodes = {*self._task.ours, rospy.get_name()}
        self._subscribers = [
            rospy.Subscriber(topic, rospy.AnyMsg, self._on_command, queue_size=1000, tcp_nodelay=True)
            for topic in VELOCITY_TOPICS
        ]
        self._driver = ExerciseDriver(self._task.driver, self._known.scan_topic, self._our_nodes)
        self._feed = TruthFeed(Path(self._task.truth_socket), self._on_truth, self._on_event)
        self._tell()

    def run(self) -> None:
        """Record until the drive is over.

        Raises:
            Exception: of a callback. Nothing is written then: a part of a drive would cost points.
        """
        try:
            self._record()
        except Exception:
            self._written = self._written or not rospy.core.is_shutdown_requested()
            raise

    def _record(self) -> None:
        cause: Optional[Note] = None
        while cause is None and not rospy.is_shutdown():
            joined_at = self._joined_at
            self._look_at_graph()
            self._begin(joined_at)
            self._tell(now=self._now)
            if self._feed.failure is not None:
                raise self._feed.failure
            cause = self._driver.work(self._now, self._speed) or self._over()
            time.sleep(LOOK_PERIOD)
        self._is_over = True
        self._watch.close()
        self._tell(over=True)
        while not Path(self._task.closing).exists() and not rospy.is_shutdown():
            time.sleep(CLOSING_PERIOD)
        self._write(cause)

    @property
    def _now(self) -> float:
        return self._truth[-1].stamp if self._truth else 0.0

    @property
    def _speed(self) -> float:
        return self._truth[-1].speed if self._truth else 0.0

    @property
    def _last_command(self) -> float:
        return self._commands[-1] if self._commands else -inf

    def _on_truth(self, state: TrueState) -> None:
        if self._is_over or self._now >= self._known.deadline:
            self._watch.close()
            return
        with self._lock:
            self._truth.append(state)
        self._end.update(state)

    def _on_event(self, kind: str, text: str) -> None:
        if kind == "changed":
            self._violate(f"the simulator was asked to interfere at {self._now:.2f} s: {text}")
        elif kind == "unanswered" or (kind == "asleep" and not self._driver.has_silenced(self._last_command)):
            self._unanswered = text

    def _violate(self, text: str) -> None:
        if len(self._violations) < MAX_VIOLATIONS:
            self._violations[text] = None

    def _on_command(self, msg: Any) -> None:
        if self._is_over or msg._connection_header.get("callerid") in self._our_nodes:
            return
        self._command_count += 1
        self._zero_count += is_zero(msg._buff)
        ahead, turn = ahead_and_turn(msg._buff)
        self._fastest, self._sharpest = max(self._fastest, ahead), max(self._sharpest, turn)
        now = self._now
        if not self._commands or self._commands[-1] < now:
            self._commands.append(now)

    def _on_scan(self, msg: LaserScan) -> None:
        if self._is_over:
            return
        scan = conversions.scan_from_msg(msg)
        self._nearest.append((scan.stamp, float(np.min(scan.ranges, where=scan.valid, initial=inf))))
        if not self._scans or scan.stamp >= self._scans[-1].stamp + HITS_PERIOD:
            self._scans.append(scan)
        self._driver.answer(scan.stamp)

    def _look_at_graph(self) -> None:
        try:
            published, subscribed, services = self._master.getSystemState()
            publishers, subscribers = dict(published), dict(subscribed)
            if any(self._types.get(topic, "*") == "*" for topic in publishers):  # "*": of a subscriber to any
                self._types = dict(self._master.getTopicTypes())
        except UNANSWERED:
            return
        self._publishers = publishers
        for topic, nodes in publishers.items():
            if set(nodes) - self._our_nodes:
                self._watch.follow(topic, self._types.get(topic, ""))
                if self._playback:
                    self._playback.follow(topic, self._types.get(topic, ""))
        listeners: Set[str] = set(subscribers.get(self._known.scan_topic, ()))
        if not self._subscribed and listeners - self._our_nodes:
            self._subscribed = True
            self._tell(subscribed=True)
        self._silent = self._silent or silent_topics(publishers, subscribers, self._our_nodes)
        self._unread = unread_topics(publishers, subscribers, self._types, self._our_nodes)
        simulator_topics = (TRUTH, "/clock", self._known.scan_topic)
        for topic, node in forged_topics(publishers, simulator_topics, self._our_nodes):
            self._violate(f"node {node} publishes on {topic}, as the simulator does")
        for topic, node in topics_of_truth(subscribers, self._our_nodes):
            self._violate(f"node {node} subscribes to {topic}, where the simulator tells where things are")
        self._driver.look(services)
        self._listens = self._listens or listens(subscribers, self._our_nodes)
        topics = map(rospy.resolve_name, VELOCITY_TOPICS)
        sends = any(set(publishers.get(topic, ())) - self._our_nodes for topic in topics)
        self._advertises = self._advertises or sends
        self._join()

    def _join(self) -> None:
        """Take part only after the submission, for which lockstep waits, or in its place."""
        is_ready = self._subscribed and (self._advertises or self._task.driver in (FORWARD, BAG))
        if self._joined_at == inf and (is_ready or self._go_on.is_set()):
            self._joined_at = time.monotonic()
            self._tell(joined=True)
            if self._playback:
                return
            if not is_ready:
                self._driver.answer_scans()
            scans = self._known.scan_topic
            self._subscribers.append(
                rospy.Subscriber(scans, LaserScan, self._on_scan, queue_size=1000, tcp_nodelay=True)
            )

    def _begin(self, joined_at: float) -> None:
        """Let time begin once what is recorded is connected, or cannot be: a drive repeats from its start.

        `joined_at` [s] is of an earlier look: what is advertised a moment after the commands is seen by now.
        """
        estimates = self._playback.subscribers if self._playback else ()
        connected = all(
            each.get_num_connections() >= len(self._publishers.get(each.resolved_name, ()))
            for each in (*self._subscribers, *self._watch.subscribers, *estimates)
        )
        if joined_at < inf and (connected or time.monotonic() > joined_at + CONNECTING):
            self._feed.begin()

    def _over(self) -> Optional[Note]:
        if self._playback:
            return self._bag_over(self._playback)
        if self._now >= self._known.deadline:
            return Note(Kind.DEADLINE, f"the deadline of {self._known.deadline:g} s")
        if not self._task.ends_at_pillar:
            return None
        if self._listens and not self._advertises and self._now >= SILENT:
            return Note(Kind.NO_PUBLISHER, f"it had no publisher of velocity commands for {SILENT:g} s")
        if self._abandoned.is_set() and not self._command_count:
            return NO_COMMAND
        return self._end.reason(self._abandoned.is_set())

    def _bag_over(self, playback: PlaybackWatch) -> Optional[Note]:
        playback.look(self._now)
        if self._abandoned.is_set():
            return Note(Kind.NODES_ENDED, "its nodes had ended")
        end = self._known.deadline - BAG_MARGIN
        done = self._now >= end and playback.is_over(end)
        return Note(Kind.PLAN_DONE, "the bag was played") if done else None

    def _tell(self, **changes: Any) -> None:
        """Tell marking what has changed."""
        with self._status_lock:
            self._status = replace(self._status, **changes)
            part = Path(self._task.status + ".part")
            part.write_text(record_to_json(self._status))
            part.replace(self._task.status)

    def _write(self, cause: Optional[Note]) -> None:
        with self._lock:
            if self._written:
                return
            self._written = True
        truth = list(self._truth)
        table = np.array(
            [(row.stamp, *pose_to_2d(row.pose_in_world), row.speed, row.yaw_rate) for row in truth]
        ).reshape(-1, 6)
        times, poses = table[:, 0], table[:, 1:4]
        topic_parameters, queue_parameters = self._driver.parameters()
        frames = self._watch.frames
        recording = replace(
            self._known,
            times=times,
            poses=poses,
            speeds=table[:, 4:6],
            commands=np.array(self._commands),
            command_count=self._command_count,
            zero_count=self._zero_count,
            fastest=self._fastest,
            sharpest=self._sharpest,
            nearest=np.array(self._nearest).reshape(-1, 2),
            hits=scan_hits(self._scans, times, poses, self._known.robot),
            markers=self._watch.samples(times, [row.pose_in_world for row in truth], self._known.pillar),
            marker_topics=self._watch.topics,
            services=tuple(sorted(self._driver.services)),
            other_services=tuple(sorted(self._driver.other_services)),
            calls=tuple(self._driver.calls),
            callers=self._driver.callers(),
            topic_parameters=topic_parameters,
            queue_parameters=queue_parameters,
            subscribed=self._subscribed,
            advertised=self._advertises,
            silent_topics=tuple(self._silent),
            unread_topics=tuple(self._unread),
            violations=(*self._violations, *pose_jumps(times, poses)),
            notes=self._notes(),
            ended=cause,
            frames=frames,
            descriptions=self._driver.descriptions(frames),
            playback=self._playback.playback if self._playback else None,
        )
        closing = Path(self._task.closing)
        text = to_json(closed(recording, load(Closing, closing) if closing.exists() else Closing()))
        part = Path(self._task.output + ".part")
        part.write_text(text)
        part.replace(self._task.output)
        self._tell(sha256=hashlib.sha256(text.encode()).hexdigest())

    def _notes(self) -> Tuple[Note, ...]:
        """Notes on what this recorder alone has seen."""
        notes = self._watch.notes
        if self._unanswered and self._command_count:
            notes = (Note(Kind.UNANSWERED_SCANS, self._unanswered), *notes)
        return notes


def main() -> None:
    """Run the node, within a limit: a message of a gigabyte costs its connection."""
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    run_node("marking_recorder", DriveRecorder, listen_to_clock=False)


if __name__ == "__main__":
    main()
