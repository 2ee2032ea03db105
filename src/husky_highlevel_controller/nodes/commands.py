"""The simulator's inputs: velocity commands by their priority, and the emergency stop."""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import Callable, Deque, Dict, List, Tuple

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool

from husky_highlevel_controller import messages
from husky_highlevel_controller.datatypes import Twist2D
from husky_highlevel_controller.mux import INPUTS, TIMEOUT, CommandMux
from husky_highlevel_controller.nodes.starting import publish

DIRECT = "husky_velocity_controller/cmd_vel"  # what the mux passes on, and a way past it
MAIN = "cmd_vel"
QUEUE = 1000  # commands kept between two physics steps; older ones are overruled anyway


class Commands:
    """Collects commands in callbacks; the simulation's thread takes them."""

    def __init__(self, on_arrival: Callable[[], None]) -> None:
        self._on_arrival = on_arrival
        self._arrived: Deque[Tuple[str, Twist]] = deque(maxlen=QUEUE)
        self._senders: Dict[str, Tuple[str, float]] = {}  # of each topic, and when they sent
        self._mux = CommandMux()
        self._passed = rospy.Publisher(DIRECT, Twist, queue_size=QUEUE)
        subscribers = {
            topic: rospy.Subscriber(
                topic, Twist, partial(self._on_twist, topic), queue_size=10, tcp_nodelay=True
            )
            for topic in (*INPUTS, DIRECT)
        }
        self.main: rospy.Subscriber = subscribers[MAIN]
        rospy.Subscriber("e_stop", Bool, self._on_e_stop, queue_size=10)

    def take(self, stamp: float) -> List[Twist2D]:
        """The commands to obey of those that have arrived, oldest first, taken to arrive at `stamp` [s]."""
        obeyed = []
        while self._arrived:
            topic, msg = self._arrived.popleft()
            if topic == DIRECT:
                if not self._mux.locked:
                    obeyed.append(messages.twist_from_msg(msg))
            elif self._mux.passes(topic, stamp):
                obeyed.append(messages.twist_from_msg(msg))
                if self._passed.get_num_connections() > 1:  # one of them is our own
                    publish(self._passed, msg)
        return obeyed

    def forget(self) -> None:
        """Begin anew, but for the emergency stop."""
        self._arrived.clear()
        self._mux.forget()

    def _on_twist(self, topic: str, msg: Twist) -> None:
        sender = msg._connection_header["callerid"]
        if topic == DIRECT and sender == rospy.get_name():
            return  # what take() has passed on
        self._notice_quarrel(topic, sender)
        self._arrived.append((topic, msg))
        self._on_arrival()

    def _notice_quarrel(self, topic: str, sender: str) -> None:
        now = rospy.get_time()
        other, sent = self._senders.get(topic, (sender, now))
        self._senders[topic] = sender, now
        if other != sender and now - sent <= TIMEOUT:
            rospy.logwarn_throttle(
                10.0,
                f"{rospy.resolve_name(topic)}: both {other} and {sender} send commands, and the robot obeys"
                " each in turn; stop one of them, or take over on kb_teleop/cmd_vel",
            )

    def _on_e_stop(self, msg: Bool) -> None:
        if msg.data != self._mux.locked:
            rospy.logwarn("e_stop: commands are locked" if msg.data else "e_stop: commands are free again")
        self._mux.locked = msg.data
