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

# [s] wall time for which the inputs of higher priority are heard. A node that drives sends more often,
# because the robot forgets a command after 0.5 s.
LISTENING_TIME = 0.6
POLL_PERIOD = 0.02  # [s] wall time between two looks at what was heard


class Disobedience:
    """Finds why the commands have no effect; must not run in a callback, because it waits for the master."""

    def __init__(self, robot: Robot, commands: rospy.Publisher) -> None:
        """Watch the emergency stop; `commands` is the controller's publisher of commands."""
        self._robot, self._commands = robot, commands
        self._is_locked = False
        # the simulator always advertises this topic, so a connection shows that the robot is simulated
        self._lock_topic = rospy.Subscriber("husky_simulator/locked", Bool, self._on_locked, queue_size=1)

    @property
    def reset_service(self) -> str:
        """Name of the simulator's service that puts the robot back to its start; empty for a real robot."""
        return rospy.resolve_name("husky_simulator/reset") if self._lock_topic.get_num_connections() else ""

    def _on_locked(self, message: Bool) -> None:
        self._is_locked = message.data

    def sentence(self, twist: Twist2D, seconds: float) -> str:
        """Return a sentence: the command, the `seconds` for which the robot stood still, and the cause."""
        command = f"{twist.linear:.2f} m/s, {twist.angular:.2f} rad/s"
        return f"commanded {command} for {seconds:.0f} s, but the robot stands; {self._cause()}"

    def _cause(self) -> str:
        """Return the first cause that applies, as the end of a sentence.

        The causes are: no subscriber, the emergency stop, a node on an input of higher priority. If none of
        them applies, the text names what a person should check.
        """
        topic = self._commands.resolved_name
        if not self._commands.get_num_connections():
            return f"no node reads {topic}"
        if self._is_locked:
            return "the emergency stop is on (e_stop)"
        graph = read_graph(rosgraph.get_master_uri())  # None if the master does not answer
        publishers = graph.publishers if graph else {}
        inputs = [rospy.resolve_name(name) for name in self._robot.topics.velocity]
        # `inputs` are in the order of their priority, highest first; a remapped topic is not an input, so it
        # has no priority
        higher_inputs = inputs[: inputs.index(topic)] if topic in inputs else []
        senders = {name: publishers[name] for name in higher_inputs if publishers.get(name)}
        other = first_that_speaks(list(senders))
        if other:
            return f"{other} of {' and '.join(sorted(senders[other]))} has priority over {topic}"
        return "check the emergency stop, the motors, and whether something blocks the robot"


def first_that_speaks(topics: Sequence[str]) -> str:
    """Return the first of the topics of commands on which a message comes within LISTENING_TIME, or "".

    A web page, a joystick and the guards always advertise their topics, but send only in use.
    """
    heard: Set[str] = set()
    subscribers = [
        rospy.Subscriber(topic, Twist, partial(_hear, heard, topic), queue_size=1) for topic in topics
    ]
    end = time.monotonic() + LISTENING_TIME
    while subscribers and not heard and time.monotonic() < end:
        time.sleep(POLL_PERIOD)
    for subscriber in subscribers:
        subscriber.unregister()
    return next((topic for topic in topics if topic in heard), "")


def _hear(heard: Set[str], topic: str, _message: Twist) -> None:
    heard.add(topic)
