"""Reasons why the robot does not follow the controller's commands, as far as the ROS graph shows them.

In: the ROS graph, the simulator's emergency stop. Out: a sentence.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Sequence, Set

import rosgraph
import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool

from husky_highlevel_controller.datatypes import Twist2D
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.ros.master_graph import read_graph

# [s] wall time for which the inputs of higher priority are heard. In this time, a node that drives sends at
# least one command, because the robot forgets a command after 0.5 s.
LISTENING_TIME = 0.6
POLL_PERIOD = 0.02  # [s] wall time between two looks at what was heard


class Disobedience:
    """Finds why the commands have no effect; must not run in a callback, because it waits for the master."""

    def __init__(self, robot: Robot, commands: rospy.Publisher) -> None:
        """Watch the emergency stop; `commands` is the controller's publisher of commands."""
        self._robot, self._commands = robot, commands
        self._is_locked = False  # true while the emergency stop of a simulated robot is on
        # the simulator always advertises this topic, so a connection shows that the robot is simulated
        self._lock_topic = rospy.Subscriber("husky_simulator/locked", Bool, self._on_locked, queue_size=1)

    @property
    def reset_service(self) -> str:
        """Name of the simulator's service that puts the robot back to its start; empty for a real robot."""
        return rospy.resolve_name("husky_simulator/reset") if self._lock_topic.get_num_connections() else ""

    def _on_locked(self, message: Bool) -> None:
        """Keep whether the emergency stop of the simulated robot is on."""
        self._is_locked = message.data

    def sentence(self, twist: Twist2D, seconds: float) -> str:
        """Return a sentence: the command, the `seconds` for which the robot stood still, and the cause."""
        command = f"{twist.linear:.2f} m/s, {twist.angular:.2f} rad/s"
        return f"commanded {command} for {seconds:.0f} s, but the robot stands; {self._cause()}"

    def _cause(self) -> str:
        """Return why the robot does not move, as the end of a sentence.

        Possible causes are: no node reads the commands, the emergency stop is on, or another node sends
        commands of higher priority. If none of these is true, the text says what a person should check.
        """
        topic = self._commands.resolved_name
        if not self._commands.get_num_connections():
            return f"no node reads {topic}"
        if self._is_locked:
            return "the emergency stop is on (e_stop)"
        graph = read_graph(rosgraph.get_master_uri())  # None if the master does not answer
        publishers = graph.publishers if graph else {}
        # topics of commands, highest priority first
        inputs = [rospy.resolve_name(name) for name in self._robot.topics.velocity]
        # a topic that was remapped is not among the inputs, so its priority is unknown
        higher_inputs = inputs[: inputs.index(topic)] if topic in inputs else []
        # topics of higher priority that a node has advertised, and these nodes
        senders = {name: publishers[name] for name in higher_inputs if publishers.get(name)}
        busy_topic = first_that_speaks(list(senders))
        if busy_topic:
            return f"{busy_topic} of {' and '.join(sorted(senders[busy_topic]))} has priority over {topic}"
        return "check the emergency stop, the motors, and whether something blocks the robot"


def first_that_speaks(topics: Sequence[str]) -> str:
    """Return the first of some topics of commands on which a message comes within LISTENING_TIME, or "".

    An advertised topic alone does not show that a node drives the robot. A web page, a joystick and the
    guards always advertise their topics, but send commands only in use.
    """
    heard: Set[str] = set()  # topics on which a message has come
    subscribers = [
        rospy.Subscriber(topic, Twist, partial(_hear, heard, topic), queue_size=1) for topic in topics
    ]
    end = time.monotonic() + LISTENING_TIME
    while subscribers and not heard and time.monotonic() < end:
        time.sleep(POLL_PERIOD)
    for subscriber in subscribers:
        subscriber.unregister()
    for topic in topics:
        if topic in heard:
            return topic
    return ""


def _hear(heard: Set[str], topic: str, _message: Twist) -> None:
    """Note that a message has come on a topic; rospy calls this for each message."""
    heard.add(topic)
