"""Stops the robot if the ROS master no longer knows this node, because then no new program can stop it.

rospy registers a node at the master once, when the node starts. If the master dies and another one starts in
its place, the node's connections continue from peer to peer, but no new program finds the node. For example,
`rostopic pub /e_stop` has no subscriber, and the service `start_stop` does not exist.

In: the master. Out: whether the master lists this node.
"""

from __future__ import annotations

import threading
import time
from math import inf
from typing import Any, Callable, Optional, Tuple

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from husky_highlevel_controller.ros.node import contained, publish
from husky_highlevel_controller.xml_rpc import reply

PERIOD = 1.0  # [s] wall time between two questions to the master, and between two messages on /diagnostics
DEADLINE = 2.0  # [s] longest wait for an answer of the master
# [s] wall time between two zero commands; it is short, because twist_mux no longer obeys a topic that was
# silent for 0.5 s
STAND_PERIOD = 0.05
REPORT_PERIOD = 10.0  # [s] wall time between two lines of the log about a lost registration
SUCCESS = 1  # code in the master's answer; for an unknown name, the code is -1
NO_ANSWER = 0  # code of this module, which stands for a missing answer
LOST = (
    "standing still: the ROS master was started again, so this node is no longer registered. No new "
    "program finds this node, so press the red button of the robot, then start all nodes again"
)


class Registration:
    """Knowledge whether the master still lists this node; a lost registration stays lost."""

    def __init__(self) -> None:
        self.is_lost = False  # true after a master has answered that it does not list this node
        self._master_uri = rosgraph.get_master_uri()

    def look(self) -> Optional[bool]:
        """Ask the master whether it lists this node, and set `is_lost` if it does not.

        The result is None, and `is_lost` stays as it is, if the master does not answer within DEADLINE, or if
        this node is shutting down.
        No answer does not mean that the registration is lost, because the master may be slow, or out of reach
        for a while.
        """
        name = rospy.get_name()
        code, uri = self._ask("lookupNode", name)
        # a node of the same name at another address is not this node
        is_known = code == SUCCESS and uri == rospy.get_node_uri()
        if is_known:
            # The master may know the name although the node is not registered, because a subscription to a
            # parameter also makes the name known. But every node of rospy registers the service get_loggers.
            code, _ = self._ask("lookupService", f"{name}/get_loggers")
            is_known = code == SUCCESS
        # `code` belongs to the last question. During a shutdown, no answer counts, because rospy itself then
        # takes the node off the master's list.
        if code == NO_ANSWER or rospy.core.is_shutdown_requested():
            return None
        if not is_known:
            self.is_lost = True
        return is_known

    def _ask(self, method: str, what: str) -> Tuple[int, Any]:
        """Return the code and the value of the master's answer; the code is NO_ANSWER if there is none."""
        answer = reply(self._master_uri, method, rospy.get_name(), what, deadline=DEADLINE)
        return (NO_ANSWER, "") if answer is None else answer


class RegistrationWatch:
    """Thread that asks the master for this node; after a loss, it stops the robot and reports the loss."""

    def __init__(self, stand: Callable[[], None]) -> None:
        """Set up; after a loss, the thread calls `stand` every STAND_PERIOD, which must stop the robot."""
        self._registration, self._stand = Registration(), stand
        # this topic must be advertised before a loss, because after it the master does not know this node,
        # and no subscriber would find the topic
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    @property
    def is_lost(self) -> bool:
        """Return whether the registration is lost: a master has answered that does not list this node."""
        return self._registration.is_lost

    def start(self) -> None:
        """Start the thread, which ends with the node."""
        threading.Thread(target=self._run, name="registration", daemon=True).start()

    def _run(self) -> None:
        """Ask the master every PERIOD until the registration is lost. Then stop the robot again and again.

        After a loss, zero is commanded every STAND_PERIOD. The loss is published on /diagnostics every
        PERIOD, and logged every REPORT_PERIOD.
        """
        self._wait_for_loss()
        # [s] wall times of the last line in the log and of the last message on /diagnostics; -inf lets the
        # first line and the first message come at once
        said_at = published_at = -inf
        while not rospy.is_shutdown():
            now = time.monotonic()
            with contained("standing still"):
                self._stand()
            with contained("the report of a lost registration"):
                if now - said_at >= REPORT_PERIOD:
                    said_at = now
                    rospy.logerr(LOST)
                if now - published_at >= PERIOD:
                    published_at = now
                    self._publish_loss()
            time.sleep(STAND_PERIOD)

    def _wait_for_loss(self) -> None:
        """Ask the master every PERIOD, until the registration is lost or the node is shut down."""
        while not (self.is_lost or rospy.is_shutdown()):
            # the pause comes first, because the node has just registered and is busy with its start
            time.sleep(PERIOD)
            with contained("the look for this node's registration"):
                self._registration.look()  # may set `is_lost`

    def _publish_loss(self) -> None:
        """Publish on /diagnostics, as an error of this node, that its registration is lost."""
        status = DiagnosticStatus(DiagnosticStatus.ERROR, rospy.get_name().strip("/"), LOST, "husky", [])
        array = DiagnosticArray(status=[status])
        array.header.stamp = rospy.Time.now()
        publish(self._diagnostics, array)
