"""Holds the simulated clock until a controller has answered the scan before."""

from __future__ import annotations

import threading
import time
from typing import Callable, Sequence

import rosgraph
import rospy

PARTNER_DEADLINE = 30.0  # [s] of wall time for a controller to join
ANSWER_DEADLINE = 5.0  # [s] of wall time for it to answer a scan
PATIENCE = 1.0  # [s] of wall time for the first answer before the question is put again
GLANCE = 0.05  # [s] of wall time between two looks at what else is to be done


class Lockstep:
    """One scan, one command: then a whole ROS run is repeatable, however busy the machine is.

    Where nobody answers in time it says so, once, and the simulation runs free from then on.
    """

    def __init__(self, wanted: bool) -> None:
        self._on, self._begun = wanted, False
        self._answered = threading.Event()

    def answer(self) -> None:
        """Note that a command has arrived; any thread may call this."""
        self._begun = True
        self._answered.set()

    def wait_for_partner(
        self,
        needed: Sequence[rospy.Publisher],
        commands: rospy.Subscriber,
        others: Sequence[rospy.Publisher],
        meanwhile: Callable[[], None],
    ) -> None:
        """Wait until every `needed` topic has a listener and commands have a sender, doing `meanwhile`.

        Whoever has subscribed to one of these topics or of the `others` must be connected by then: a
        transform that is lost at the beginning would make the run another one.
        """
        master = rosgraph.Master(rospy.get_name())

        def joined() -> bool:
            meanwhile()
            if not all(connected.get_num_connections() for connected in (*needed, commands)):
                return False
            subscribed = {topic: len(nodes) for topic, nodes in master.getSystemState()[1]}
            return all(
                publisher.get_num_connections() >= subscribed.get(publisher.resolved_name, 0)
                for publisher in (*needed, *others)
            )

        names = " and ".join(publisher.resolved_name for publisher in needed)
        if self._on:
            rospy.loginfo(
                f"lockstep: time waits until somebody listens to {names} and sends {commands.resolved_name}"
            )
        failing = f"nobody listens to {names} and sends {commands.resolved_name}"
        self._wait(joined, PARTNER_DEADLINE, failing)

    def expect_answer(self) -> None:
        """Call before a scan is published: what was answered so far does not count."""
        self._answered.clear()

    def wait_for_answer(self, meanwhile: Callable[[], None], ask_again: Callable[[], None]) -> None:
        """Wait until a command has arrived since `expect_answer`, doing `meanwhile`: requests may be made.

        A controller's very first command may be lost, while its publisher learns of us: until one has come,
        the scan is sent again.
        """
        asked = time.monotonic()

        def answered() -> bool:
            nonlocal asked
            meanwhile()
            if not self._begun and time.monotonic() - asked > PATIENCE:
                asked = time.monotonic()
                ask_again()
            return self._answered.wait(GLANCE)

        if self._on and not self._answered.is_set():
            self._wait(answered, ANSWER_DEADLINE, "no command answers the scan")

    def _wait(self, done: Callable[[], bool], deadline: float, failing: str) -> None:
        end = time.monotonic() + deadline
        while self._on and not rospy.is_shutdown() and not done():
            if time.monotonic() > end:
                rospy.logwarn(
                    f"lockstep: after {deadline:g} s of wall time {failing}; running free from now on"
                )
                self._on = False
            time.sleep(0.001)
