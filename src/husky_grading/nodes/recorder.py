"""Recorder of one run for grading: true motion, commands, markers, the ROS graph."""

from __future__ import annotations

import resource
import threading
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from math import inf
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Set, Tuple

import numpy as np
import rosgraph
import roslib.message
import rospy
from sensor_msgs.msg import LaserScan

from husky_grading.drive.recorder_channel import (
    Abandoned,
    Assignment,
    GoOn,
    HandOver,
    Joined,
    Now,
    Over,
    Ready,
)
from husky_grading.drive.ros_graph import (
    TRUTH,
    SilentTopics,
    forged_topics,
    listens,
    topics_of_truth,
    unread_topics,
)
from husky_grading.drive.truth_feed import TruthFeed
from husky_grading.exercises.catalogue import EXERCISES
from husky_grading.exercises.watch import DriveState
from husky_grading.nodes.marker_watch import MarkerWatch
from husky_grading.nodes.ros_access import UNANSWERED, DriveAccess
from husky_grading.notes import Kind, Note
from husky_grading.recording import (
    CUT_OFF,
    Recording,
    ahead_and_turn,
    is_zero,
    pose_jumps,
    scan_hits,
)
from husky_highlevel_controller.datatypes import Scan, TrueState
from husky_highlevel_controller.geometry import pose_to_2d
from husky_highlevel_controller.robot import ROBOTS, load_robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import run_node

LOOK_PERIOD = 0.2  # [s] wall time between two queries of the ROS graph
# [s] simulated time begins at most this wall time after the recorder joined the run, even if some topics are
# not connected yet
CONNECTING = 2.0
# topics on which a submission can send velocity commands: cmd_vel, which the robot's twist_mux reads, and the
# output of the twist_mux, which moves the robot directly
VELOCITY_TOPICS = ("cmd_vel", *(load_robot(name).topics.wheel_command for name in ROBOTS))
# [bytes] limit for the memory of the recorder, because a submission may send huge messages; the stacks of the
# recorder's threads alone take some hundred million bytes
MEMORY = 2_000_000_000
MAX_VIOLATIONS = 5  # at most this number of broken rules is reported
# largest number of topics whose messages the exercise gets by `on_message`, and queue length of each topic
MAX_FOLLOWED, FOLLOWED_QUEUE = 10, 50_000
HITS_PERIOD = 1.0  # [s] the recorder keeps one scan in each period of simulated time, for the pictures


class DriveRecorder:
    """Node whose callbacks record a run, while `run` waits for the end and sends the recording."""

    def __init__(self, channel: Connection) -> None:
        """Wait for the assignment, prepare an empty recording, and send Ready on the channel to marking.

        The assignment is the first message of marking on the channel. From now on, the recorder receives the
        submission's commands, the simulator's true states, and further messages of marking.
        """
        self._channel, self._channel_lock = channel, threading.Lock()  # several threads send
        self._task: Assignment = channel.recv()
        self._initial = self._task.recording  # recording with the facts that are known before the run
        self._lock = threading.Lock()  # guards `_truth` and `_handed_over`, which several threads change
        self._truth: List[TrueState] = []  # true states of the robot so far
        self._commands: List[float] = []  # [s] simulated times at which commands came, each time once
        self._command_count = self._zero_count = 0  # number of all commands, and of commands that are zero
        self._fastest = self._sharpest = 0.0  # largest commanded speed [m/s] and yaw rate [rad/s]
        self._nearest: List[Tuple[float, float]] = []  # time [s] and smallest range [m] of each scan
        self._scans: List[Scan] = []  # one scan every HITS_PERIOD, for the pictures
        # keeps the markers of the submission, with their times and positions
        self._markers = MarkerWatch(lambda: self._now, self._task.packages)
        self._followed: Set[str] = set()  # topics whose messages the exercise gets by `on_message`
        self._subscribed = False  # true if the submission subscribes to the input topic of the exercise
        self._listens = False  # true if the submission subscribes to any topic
        self._advertises = False  # true if the submission has a publisher of velocity commands
        # [s] wall time at which the recorder joined the run (`_join`), so that simulated time can begin; inf
        # before
        self._joined_at = inf
        self._publishers: Dict[str, List[str]] = {}  # names of the publishing nodes by topic
        self._services: Tuple[str, ...] = ()  # names of the services that the submission offers
        self._is_over = False  # true after the end of the run
        # true if the recording was sent, or must not be sent, because an error has made it incomplete
        self._handed_over = False
        self._types: Dict[str, str] = {}  # types by topic
        # topics to which the submission subscribes, but on which no node publishes
        self._silent = SilentTopics()
        self._unread: List[str] = []  # topics on which the submission sends commands, but which no node reads
        # sentences on broken rules. They are the keys of a dict, so each sentence occurs once, and their
        # order is kept.
        self._violations: Dict[str, None] = {}
        # sentence that says that the submission did not answer every scan with a command; empty if the
        # simulator has not reported this
        self._unanswered = ""
        # set by the message GoOn: the recorder joins the run now, although the submission is not ready
        self._go_on = threading.Event()
        # set by the message Abandoned: no node of the submission runs any more
        self._abandoned = threading.Event()
        # after a shutdown from outside, the part of the run so far is sent, as a run that was cut off
        rospy.on_shutdown(lambda: self._hand_over(CUT_OFF))
        self._master = rosgraph.Master(rospy.get_name())
        # names of nodes that do not belong to the submission
        self._our_nodes = {*self._task.ours, rospy.get_name()}
        self._subscribers = [
            rospy.Subscriber(topic, rospy.AnyMsg, self._on_command, queue_size=1000, tcp_nodelay=True)
            for topic in VELOCITY_TOPICS
        ]
        self._access = DriveAccess(self._our_nodes, self._markers)  # through which `_watch` uses ROS
        # the exercise's own part of the recorder (class Watch); it follows the run, and decides when the run
        # is over
        self._watch = EXERCISES[self._task.exercise].watch(self._initial, self._access)
        # receives the true states and events of the simulator by a socket and not by ROS, so a submission
        # cannot forge them
        self._feed = TruthFeed(Path(self._task.truth_socket), self._on_truth, self._on_event)
        threading.Thread(target=self._listen, daemon=True).start()
        self._send(Ready())

    def run(self) -> None:
        """Look at the ROS graph several times per second until the run is over; then send the recording.

        Meanwhile, the callbacks record commands, scans and markers.

        Raises:
            Exception: the error of a callback. Then no recording is sent, because a part of a run would cost
                points.
        """
        cause: Optional[Note] = None
        try:
            while cause is None and not rospy.is_shutdown():
                had_joined = self._joined_at < inf
                self._look_at_graph()  # may join the run
                # A submission may advertise a topic, such as markers, just after its commands. Only the next
                # look finds this topic and subscribes to it. So simulated time does not begin at the look
                # that joins the run.
                if had_joined:
                    self._begin_when_connected()
                self._send(Now(self._now, self._subscribed))
                if self._feed.failure is not None:  # error of `_on_truth` or `_on_event`, in another thread
                    raise self._feed.failure
                cause = self._watch.look(self._state)
                time.sleep(LOOK_PERIOD)
            self._is_over = True
            self._markers.close()
            if cause is not None:  # cause is None after a shutdown, which has already sent the recording
                self._send(Over())
                self._hand_over(cause)
        except Exception:
            # At the end of this program, rospy calls `_hand_over`. It sends nothing if `_handed_over` is set.
            # So an incomplete recording is not sent after an error. If this program was shut down from
            # outside, the error is only a consequence of that, and the recording is sent.
            if not rospy.core.is_shutdown_requested():
                self._handed_over = True
            raise

    def _listen(self) -> None:
        """Obey the messages of the program that runs the submission, see `drive/recorder_channel.py`.

        This is a thread of its own, because `run` may wait for an answer of the ROS master.
        """
        # an EOFError or OSError means that nobody reads the recording any more
        with suppress(EOFError, OSError):
            while True:
                message = self._channel.recv()
                if isinstance(message, GoOn):
                    self._go_on.set()
                elif isinstance(message, Abandoned):
                    self._abandoned.set()
                elif isinstance(message, HandOver):
                    # at the shutdown, rospy calls `_hand_over`, which sends the recording so far
                    rospy.signal_shutdown("the run is cut off")

    @property
    def _now(self) -> float:
        """Return the simulated time of the latest true state [s]."""
        return self._truth[-1].stamp if self._truth else 0.0

    @property
    def _state(self) -> DriveState:
        """Return the present state of the run for the exercise's watch."""
        return DriveState(
            now=self._now,
            speed=self._truth[-1].speed if self._truth else 0.0,
            subscribed=self._subscribed,
            listens=self._listens,
            advertises=self._advertises,
            commands=self._command_count,
            abandoned=self._abandoned.is_set(),
            services=self._services,
        )

    def _on_truth(self, state: TrueState) -> None:
        """Keep a true state and pass it to the exercise's watch, unless the run is over."""
        if self._is_over or self._now >= self._initial.deadline:
            # no true pose is recorded any more, so a later marker could not be placed in the world
            self._markers.close()
            return
        with self._lock:
            self._truth.append(state)
        self._watch.on_truth(state)

    def _on_event(self, kind: str, text: str) -> None:
        """Keep an event of the simulator: a call that changed the world, or a scan without a command.

        The simulator waits after each scan for a command of the submission.

        Args:
            kind: "changed" if a service call has changed the world. "asleep" if no command came after a scan,
                because the controller sleeps. "unanswered" if the simulator has waited in vain, and waits for
                no command any more.
            text: sentence on the event.
        """
        if kind == "changed":
            self._violate(f"the simulator was asked to interfere at {self._now:.2f} s: {text}")
        elif kind == "unanswered" or (kind == "asleep" and not self._was_told_to_stop()):
            # sentence that says that the submission did not answer every scan with a command
            self._unanswered = text

    def _was_told_to_stop(self) -> bool:
        """Return whether the exercise has told the submission to stop, so that it may send no commands.

        If the submission still sends commands long after it was told to stop, it drives again, and the result
        is False.
        """
        last_command = self._commands[-1] if self._commands else -inf  # [s] simulated time
        return self._watch.has_silenced(last_command)

    def _violate(self, text: str) -> None:
        """Record that the submission has broken a rule, by a sentence; at most MAX_VIOLATIONS are kept."""
        if len(self._violations) < MAX_VIOLATIONS:
            self._violations[text] = None

    def _on_command(self, msg: Any) -> None:
        """Count a command of the submission, with its time and speeds; our own nodes do not count."""
        if self._is_over or msg._connection_header.get("callerid") in self._our_nodes:
            return
        self._command_count += 1
        self._zero_count += is_zero(msg._buff)
        ahead, turn = ahead_and_turn(msg._buff)  # sizes of linear.x [m/s] and angular.z [rad/s]
        self._fastest, self._sharpest = max(self._fastest, ahead), max(self._sharpest, turn)
        now = self._now
        if not self._commands or self._commands[-1] < now:  # several commands of one moment are kept once
            self._commands.append(now)

    def _on_scan(self, msg: LaserScan) -> None:
        """Keep the smallest range of each scan for the judge, and a scan every HITS_PERIOD for pictures."""
        if self._is_over:
            return
        scan = conversions.scan_from_msg(msg)
        self._nearest.append((scan.stamp, float(np.min(scan.ranges, where=scan.valid, initial=inf))))
        if not self._scans or scan.stamp >= self._scans[-1].stamp + HITS_PERIOD:
            self._scans.append(scan)
        self._watch.on_scan(scan.stamp)

    def _on_message(self, msg: Any, topic: str) -> None:
        """Pass a message on a followed topic to the exercise's watch, unless the run is over."""
        if not self._is_over:
            self._watch.on_message(topic, msg)

    def _look_at_graph(self) -> None:
        """Ask the master for the ROS graph, and keep the parts that the rubric needs.

        New topics of the submission are subscribed to, if they have markers or types that the exercise
        follows. Then `_join` joins the run, if the submission is ready. Without an answer of the master
        nothing changes, because the next look comes soon.
        """
        try:
            published, subscribed, services = self._master.getSystemState()
            publishers, subscribers = dict(published), dict(subscribed)
            # The master gives the type "*" as long as a topic has only subscribers that accept any type. So
            # the types are requested again until the master knows the real type.
            if any(self._types.get(topic, "*") == "*" for topic in publishers):
                self._types = dict(self._master.getTopicTypes())
        except UNANSWERED:
            return
        self._publishers = publishers
        for topic, nodes in publishers.items():
            if set(nodes) - self._our_nodes:  # a node of the submission publishes on the topic
                self._markers.follow(topic, self._types.get(topic, ""))
                self._follow(topic, self._types.get(topic, ""))
        self._keep_used_topics(publishers, subscribers)
        self._check_for_violations(publishers, subscribers)
        self._services = tuple(name for name, nodes in services if set(nodes) - self._our_nodes)
        self._join()

    def _keep_used_topics(self, publishers: Dict[str, List[str]], subscribers: Dict[str, List[str]]) -> None:
        """Keep whether the submission subscribes and sends commands, and its silent and unread topics.

        A subscription or a publisher that was seen once counts until the end, because a node may end during
        the run. For unread topics only the latest look counts, because a subscriber may come after the
        publisher.
        """
        # nodes that subscribe to the topic that the exercise needs; in most exercises, this is the topic of
        # the scans
        listeners: Set[str] = set(subscribers.get(self._watch.input_topic, ()))
        self._subscribed = self._subscribed or bool(listeners - self._our_nodes)
        self._listens = self._listens or listens(subscribers, self._our_nodes)
        for name in VELOCITY_TOPICS:
            nodes = publishers.get(rospy.resolve_name(name), ())
            self._advertises = self._advertises or bool(set(nodes) - self._our_nodes)
        self._silent.update(publishers, subscribers, self._our_nodes)
        self._unread = unread_topics(publishers, subscribers, self._types, self._our_nodes)

    def _check_for_violations(
        self, publishers: Dict[str, List[str]], subscribers: Dict[str, List[str]]
    ) -> None:
        """Keep a violation for each topic of the simulator that the submission forges or must not read.

        `publishers` and `subscribers` are the names of the nodes by topic.
        """
        # only the simulator may publish on these topics, because a submission could forge poses, time or
        # scans on them
        simulator_topics = (TRUTH, "/clock", self._watch.input_topic)
        for topic, node in forged_topics(publishers, simulator_topics, self._our_nodes):
            self._violate(f"node {node} publishes on {topic}, on which only the simulator may publish")
        for topic, node in topics_of_truth(subscribers, self._our_nodes):
            self._violate(f"node {node} subscribes to {topic}, which has the true poses of the simulator")

    def _follow(self, topic: str, kind: str) -> None:
        """Subscribe to a topic of the submission, of messages of the type `kind`, if the exercise needs them.

        For example, exercise 4 needs each topic with odometry. `_watch`, the exercise's own part of the
        recorder, lists the types that it needs, and gets the messages.
        """
        if kind not in self._watch.follows or topic in self._followed or len(self._followed) >= MAX_FOLLOWED:
            return
        message_class = roslib.message.get_message_class(kind)
        if message_class is not None:
            self._followed.add(topic)
            self._subscribers.append(
                rospy.Subscriber(topic, message_class, self._on_message, topic, queue_size=FOLLOWED_QUEUE)
            )

    def _join(self) -> None:
        """Join the run, once, if the submission is ready or will not become ready (message GoOn).

        After this, `_begin_when_connected` lets simulated time begin. In exercise 4, a bag is played in place
        of the simulator, and nothing else is needed.
        """
        if self._joined_at < inf:  # the recorder has joined before
            return
        is_ready = self._watch.is_submission_ready(self._state)
        if not is_ready and not self._go_on.is_set():
            return
        self._joined_at = time.monotonic()
        self._send(Joined())
        if self._watch.reads_scans:
            self._join_simulator(is_ready)

    def _join_simulator(self, is_ready: bool) -> None:
        """Subscribe to the scans, and advertise commands if the submission is not ready.

        The simulator waits for a node that subscribes to the scans, and for a node that advertises commands.
        A submission that is not ready may advertise no commands, for example because its nodes have ended.
        """
        if not is_ready:
            self._access.advertise_commands()
        scans = self._initial.scan_topic
        self._subscribers.append(
            rospy.Subscriber(scans, LaserScan, self._on_scan, queue_size=1000, tcp_nodelay=True)
        )

    def _begin_when_connected(self) -> None:
        """Let simulated time begin if all recorded topics are connected, or CONNECTING seconds after `_join`.

        So two runs of the same submission are recorded alike from their first moment. `run` calls this only
        after `_join`, so the topics and their publishers are known.
        """
        subscribers = (*self._subscribers, *self._markers.subscribers)
        # each subscriber must have a connection to every node that publishes on its topic
        is_connected = all(
            each.get_num_connections() >= len(self._publishers.get(each.resolved_name, ()))
            for each in subscribers
        )
        if is_connected or time.monotonic() > self._joined_at + CONNECTING:
            self._feed.begin()  # only the first call has an effect

    def _send(self, message: Any) -> None:
        """Send a message to the program that runs the submission; several threads may call this."""
        with self._channel_lock:
            self._channel.send(message)

    def _hand_over(self, cause: Optional[Note]) -> None:
        """Send the recording to marking, once; further calls do nothing.

        `run` calls this at the end of the run, and rospy calls it at a shutdown. `cause` is the reason why
        the run is over.
        """
        with self._lock:
            if self._handed_over:
                return
            self._handed_over = True
            states = list(self._truth)  # a copy, because another thread may append further states
        self._send(self._recording_of(states, cause))

    def _recording_of(self, states: Sequence[TrueState], cause: Optional[Note]) -> Recording:
        """Return the recording of the run with these true states; `cause` is the reason why it is over."""
        times, poses, speeds = _arrays_of(states)
        frames = self._markers.frames
        notes = [*self._markers.notes]
        # if no command came at all, the judge says this (`first_cause`), and a note on the scans adds nothing
        if self._unanswered and self._command_count:
            notes.insert(0, Note(Kind.UNANSWERED_SCANS, self._unanswered))
        return replace(
            self._initial,
            times=times,
            poses=poses,
            speeds=speeds,
            commands=np.array(self._commands),
            command_count=self._command_count,
            zero_count=self._zero_count,
            fastest=self._fastest,
            sharpest=self._sharpest,
            nearest=np.array(self._nearest).reshape(-1, 2),
            hits=scan_hits(self._scans, times, poses, self._initial.robot),
            markers=self._markers.samples(
                times, [each.pose_in_world for each in states], self._initial.pillar
            ),
            marker_topics=self._markers.topics,
            marker_types=self._markers.types,
            subscribed=self._subscribed,
            advertised=self._advertises,
            silent_topics=self._silent.names,
            unread_topics=tuple(self._unread),
            violations=(*self._violations, *pose_jumps(times, poses)),
            notes=tuple(notes),
            ended=cause,
            frames=frames,
            descriptions=self._access.descriptions(frames),
            estimate=self._watch.estimate,
            watched={**self._initial.watched, **self._watch.kept()},
        )


def _arrays_of(states: Sequence[TrueState]) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, poses and speeds of N true states of the robot.

    Returns:
        Times (N,) [s], poses (N, 3) as x, y [m] and yaw [rad], and speeds (N, 2) as speed [m/s] and yaw rate
        [rad/s].
    """
    rows = [(each.stamp, *pose_to_2d(each.pose_in_world), each.speed, each.yaw_rate) for each in states]
    table = np.array(rows).reshape(-1, 6)  # `reshape` gives the table six columns even if it has no rows
    return table[:, 0], table[:, 1:4], table[:, 4:6]


def main(channel: Connection) -> None:
    """Run the node within a limit of memory, so a message of a gigabyte only ends its connection."""
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    run_node("marking_recorder", partial(DriveRecorder, channel), listen_to_clock=False)
