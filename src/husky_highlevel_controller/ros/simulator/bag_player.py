"""Plays the drive of exercise 4 to a student's filter, as `rosbag play` would, but without a bag file.

The messages are published while they are simulated. In: the arguments `ROBOT SEED PACE SECONDS`. Out: /clock,
the topics of the bag, and the true poses by `TruthLog`, whose reader (the grader) lets time begin.
"""

from __future__ import annotations

import sys
import time
from itertools import chain, islice
from typing import Any, Dict, Iterable, Tuple

import rospy
from rosgraph_msgs.msg import Clock

from husky_highlevel_controller.datatypes import Snapshot
from husky_highlevel_controller.ros.conversions import time_to_msg
from husky_highlevel_controller.ros.node import publish, run_node
from husky_highlevel_controller.ros.simulator.record_bag import TRUTH_TOPIC, messages_of_drive
from husky_highlevel_controller.ros.simulator.truth_log import TruthLog

# number of messages that are simulated before the player begins; all topics are among them, so the player
# can advertise every topic
FIRST_MESSAGES = 400
# length of the queues of messages, which is so large that no message is lost on a busy machine
QUEUE = 100_000


class BagPlayer:
    """Advertises every topic, waits for the reader of the true poses, and plays."""

    def __init__(self) -> None:
        """Prepare the drive; the program's arguments are robot, seed, real-time factor and length [s]."""
        name, seed, pace, seconds = sys.argv[1:5]
        self._pace, self._truth = float(pace), TruthLog()
        self._messages = messages_of_drive(name, ground="hard", seed=int(seed), duration=float(seconds))
        self._publishers: Dict[str, Any] = {}

    def _advertise_topics_of(self, messages: Iterable[Tuple[Snapshot, str, Any]]) -> None:
        """Advertise each topic of some messages, except the true poses, which only the grader may get."""
        for _, topic, msg in messages:
            if topic not in {TRUTH_TOPIC, *self._publishers}:
                latch = topic == "/tf_static"
                self._publishers[topic] = rospy.Publisher(topic, type(msg), queue_size=QUEUE, latch=latch)

    def run(self) -> None:
        """Play the drive, then wait for the shutdown, because latched messages would end with the node.

        FIRST_MESSAGES messages are made before time begins, so that every topic is advertised by then.
        """
        first_messages = list(islice(self._messages, FIRST_MESSAGES))
        self._advertise_topics_of(first_messages)
        first_snapshot, _, _ = first_messages[0]
        now = first_snapshot.stamp  # [s] simulated time
        # /clock is advertised last, because the grader takes it as the sign that the player is ready
        clock = rospy.Publisher("/clock", Clock, queue_size=QUEUE, latch=True)
        publish(clock, Clock(time_to_msg(now)))
        # wait until the reader of the true poses lets simulated time begin
        self._truth.wait_to_begin(meanwhile=lambda: None)
        wall_time_of_zero = time.monotonic()  # [s] wall time that belongs to simulated time 0
        for snapshot, topic, msg in chain(first_messages, self._messages):
            if snapshot.stamp > now:
                now = snapshot.stamp
                due = wall_time_of_zero + now / self._pace  # [s] wall time at which this message is due
                time_left = due - time.monotonic()  # [s] negative if the player is late
                time.sleep(max(0.0, time_left))
                if time_left < 0.0:
                    # The player does not catch up, because a filter cannot follow many messages at once. So
                    # all later messages are due later by the same time.
                    wall_time_of_zero -= time_left
                publish(clock, Clock(time_to_msg(now)))
            if rospy.is_shutdown():
                return
            # a student's program must not read the true poses, so they go only to the grader
            if topic == TRUTH_TOPIC:
                self._truth.write(snapshot)
            else:
                publish(self._publishers[topic], msg)
        rospy.spin()


def main() -> None:
    """Run the node, under the simulator's name."""
    run_node("husky_simulator", BagPlayer, listen_to_clock=False)
