"""Inputs of the simulator: velocity commands by priority, and the emergency stop."""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import Deque, Dict, List, Optional, Set, Tuple

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool

from husky_highlevel_controller.datatypes import STOP, Twist2D
from husky_highlevel_controller.robot import Robot
from husky_highlevel_controller.ros import conversions
from husky_highlevel_controller.ros.node import publish
from husky_highlevel_controller.ros.simulator.findings import Findings
from husky_highlevel_controller.ros.simulator.lockstep import LeadLimit, Lockstep
from husky_highlevel_controller.ros.simulator.wrong_topics import TOOLS
from husky_highlevel_controller.simulator.command_habits import CommandHabits, Habit, habit_sentence
from husky_highlevel_controller.simulator.twist_mux import TIMEOUT, CommandMux

MAIN = "cmd_vel"  # topic on which the robot's controller sends commands
# nodes of this package that stop the robot on purpose; their zero commands cause no warning
OUR_NODES = {
    "husky_highlevel_controller",
    "proximity_stop",
    "crash_stop",
}
# largest number of commands that wait for the next physics step; if more commands come, the oldest are
# dropped
QUEUE = 1000


class Commands:
    """Collects commands in callbacks; the simulation's thread takes them."""

    def __init__(self, robot: Robot, lockstep: Lockstep, lead_limit: LeadLimit, findings: Findings) -> None:
        """Subscribe to every velocity topic of the robot and to e_stop.

        Args:
            robot: its topics, in the order of their priority, and the time after which a command expires.
            lockstep: gets the topic of each command, as an answer to the last scan.
            lead_limit: is notified of each command.
            findings: gets sentences about mistakes of the senders.
        """
        topics = robot.topics
        # Finds habits of senders that make the robot drive badly, such as commands that come too slowly. The
        # nodes of `may_stand` may stop the robot on purpose, so their zero commands are not a habit.
        self._habits = CommandHabits(robot.drive.timeout, may_stand)
        # output topic of the twist_mux, which passes on commands by the priority of their topics; a node that
        # publishes on the output topic bypasses these priorities
        self._direct_topic = topics.wheel_command
        self._lockstep, self._lead_limit, self._findings = lockstep, lead_limit, findings
        self._arrived: Deque[Tuple[str, Twist]] = deque(maxlen=QUEUE)  # topics and commands, until `take`
        # name of the node that sent the last command on each topic, and the time of this command [s]
        self._senders: Dict[str, Tuple[str, float]] = {}
        # nodes that have already sent more than one command for one scan
        self._double_senders: Set[str] = set()
        # name of the last node whose command was not zero; commands that a topic of higher priority blocks do
        # not count
        self.driver = ""
        self._mux = CommandMux(topics.velocity)  # decides by priority which command topic the robot obeys
        self._is_refusing = False  # true after a call of `refuse`; from then on, the robot obeys no command
        # publishes the commands that the mux has passed; the twist_mux of a real Husky publishes them, too
        self._passed_publisher = rospy.Publisher(topics.wheel_command, Twist, queue_size=QUEUE)
        subscribers = {
            topic: rospy.Subscriber(
                topic, Twist, partial(self._on_twist, topic), queue_size=10, tcp_nodelay=True
            )
            for topic in (*topics.velocity, topics.wheel_command)
        }
        # `has_sender` counts the connections of these subscribers to find out whether a controller is
        # connected
        self._main_subscriber, self._direct_subscriber = subscribers[MAIN], subscribers[topics.wheel_command]
        # text for the log with the names of the topics on which a controller can send commands
        self.topic_names = " or ".join(rospy.resolve_name(topic) for topic in (MAIN, topics.wheel_command))
        # this topic is latched, so a web page that is opened later also gets the state of the emergency stop
        self._locked_publisher = rospy.Publisher("~locked", Bool, queue_size=1, latch=True)
        publish(self._locked_publisher, Bool(False))
        rospy.Subscriber("e_stop", Bool, self._on_e_stop, queue_size=10)

    def take(self, stamp: float) -> List[Tuple[str, Twist2D]]:
        """Return the topic and the twist of each new command to obey, oldest first.

        The mux drops a command while an input of higher priority is active, and all commands during an
        emergency stop. An input stays active for some time after its last command, and the mux takes `stamp`
        [s] as the time of these commands. After a call of `refuse`, no command is obeyed.
        """
        obeyed: List[Tuple[str, Twist2D]] = []
        if self._is_refusing:
            self._arrived.clear()
            return obeyed
        while self._arrived:
            topic, msg = self._arrived.popleft()
            twist = conversions.twist_from_msg(msg)
            # topic of higher priority that blocks this command; None if no topic blocks it
            blocking_topic: Optional[str] = None
            # a command on the output topic of the mux has bypassed the mux, so only the emergency stop can
            # reject it
            if topic == self._direct_topic:
                if not self._mux.locked:
                    obeyed.append((topic, twist))
            elif self._mux.passes(topic, stamp):
                obeyed.append((topic, twist))
                # this node itself is the first subscriber; a message is published only for further
                # subscribers
                if self._passed_publisher.get_num_connections() > 1:
                    publish(self._passed_publisher, msg)
            else:
                blocking_topic = self._mux.stronger(topic, stamp)
            self._notice_habits(stamp, topic, msg, twist, blocking_topic)
        return obeyed

    def _notice_habits(
        self, stamp: float, topic: str, msg: Twist, twist: Twist2D, blocking_topic: Optional[str]
    ) -> None:
        """Log each habit of a command's sender, such as commands that come too slowly, once.

        The sender of a command becomes the driver if the command is not zero and no topic of higher priority
        blocks it. This also holds for a command that only the emergency stop rejects.

        Args:
            stamp: simulated time at which the command is taken [s].
            topic: topic of the command.
            msg: the command, with the name of its sender.
            twist: its velocity.
            blocking_topic: topic of higher priority that blocks this command; None if there is none.
        """
        sender = msg._connection_header["callerid"]
        is_zero = twist == STOP
        if blocking_topic is None and not is_zero:
            self.driver = sender
        for finding in self._habits.note(stamp, topic, sender, is_zero, stronger_topic=blocking_topic):
            sentence = habit_sentence(finding._replace(topic=rospy.resolve_name(topic)))
            if finding.habit is Habit.DRIVES:  # all other habits are mistakes
                rospy.loginfo(sentence)
            else:
                self._findings.tell(sender, sentence)

    def has_sender(self) -> bool:
        """Return whether a controller is connected."""
        # one connection of the direct topic is this node's own publisher
        return (
            self._main_subscriber.get_num_connections() > 0
            or self._direct_subscriber.get_num_connections() > 1
        )

    @property
    def e_stop_is_on(self) -> bool:
        """Return whether the emergency stop is on."""
        return self._mux.locked

    def refuse(self) -> None:
        """Obey no command of any node from now on; any thread may call this."""
        self._is_refusing = True

    def forget_commands(self) -> None:
        """Drop waiting commands, and treat every input as silent; the emergency stop stays."""
        self._arrived.clear()
        self._mux.forget()

    def _on_twist(self, topic: str, msg: Twist) -> None:
        """Queue a command for `take`, and report it to lockstep.

        The node's own messages are ignored. In lockstep each scan gets one command, and further ones are
        dropped.
        """
        sender = msg._connection_header["callerid"]  # name of the node that sent the command
        if topic == self._direct_topic and sender == rospy.get_name():
            return  # this node has published the command itself, in `take`, so the command is ignored here
        self._warn_of_two_senders(topic, sender)
        if self._lockstep.drops(topic):
            # the first additional command causes no warning, because it may be the stop that a controller
            # sends when it ends
            if sender not in self._double_senders:
                self._double_senders.add(sender)
                return
            rospy.logwarn_throttle(
                10.0,
                f"{rospy.resolve_name(topic)}: {sender} sends several commands for one scan; lockstep uses"
                " the first and ignores the rest",
            )
            return
        self._arrived.append((topic, msg))
        # lockstep or the lead limit may be waiting for this command as the answer to the last scan
        self._lockstep.command_arrived(topic)
        self._lead_limit.command_arrived()

    def _warn_of_two_senders(self, topic: str, sender: str) -> None:
        """Warn if two nodes send on one topic within TIMEOUT, because the robot obeys both in turn."""
        now = rospy.get_time()
        last_sender, sent_at = self._senders.get(topic, (sender, now))
        self._senders[topic] = sender, now
        if last_sender != sender and now - sent_at <= TIMEOUT:
            rospy.logwarn_throttle(
                10.0,
                f"{rospy.resolve_name(topic)}: both {last_sender} and {sender} send commands, and the robot"
                " obeys each in turn; stop one of them, or take over on kb_teleop/cmd_vel",
            )

    def _on_e_stop(self, msg: Bool) -> None:
        """Lock or release the commands, and log and publish the change."""
        if msg.data != self._mux.locked:
            rospy.logwarn(
                "e_stop: locked, ignoring commands" if msg.data else "e_stop: released, accepting commands"
            )
            publish(self._locked_publisher, msg)
        self._mux.locked = msg.data


def may_stand(node: str) -> bool:
    """Return whether a node may hold the robot with zero commands on purpose."""
    return bool(TOOLS.match(node)) or node.rsplit("/", 1)[-1] in OUR_NODES
