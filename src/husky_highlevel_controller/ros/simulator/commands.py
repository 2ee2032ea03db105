"""Inputs of the simulator: velocity commands, which topic has priority, and the emergency stop."""

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
from husky_highlevel_controller.ros.simulator.wrong_topics import is_tool
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
    """Collects velocity commands, and decides which of them the robot obeys.

    rospy's callbacks collect the commands. The simulation's thread takes them before each physics step.
    """

    def __init__(self, robot: Robot, lockstep: Lockstep, lead_limit: LeadLimit, findings: Findings) -> None:
        """Subscribe to every velocity topic of the robot and to e_stop.

        Args:
            robot: its topics, in the order of their priority, and the time after which a command expires.
            lockstep: gets the topic of each command, as an answer to the last scan.
            lead_limit: gets a call at each command. Without lockstep, it lets the simulation run ahead of a
                slow controller by two scans at most, and then waits for a command.
            findings: gets sentences about mistakes of the senders.
        """
        topics = robot.topics
        # Finds habits of senders: which node drives the robot, and mistakes, such as commands that come too
        # slowly. A node for which the function `may_stand` returns true may stop the robot on purpose, so its
        # zero commands are not a mistake.
        self._habits = CommandHabits(robot.drive.timeout, may_stand)
        # Output topic of the mux, which passes on commands by the priority of their topics. A node that
        # publishes on the output topic bypasses these priorities. This node also publishes on this topic, and
        # `_on_twist` ignores the messages that come from this node itself.
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
        # publishes the commands that the mux has passed, for other nodes; the twist_mux of a real Husky
        # publishes them, too
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
        """Return the topic and the twist of each new command that the robot must obey, oldest first.

        A command is dropped in these cases:

        - A topic of higher priority is active, which means that it had a command a short time ago.
        - The emergency stop is on.
        - `refuse` was called.

        `stamp` is the present simulated time, which counts as the time of all these commands [s].
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
            if topic == self._direct_topic:
                # this command has bypassed the mux, so only the emergency stop can reject it
                if not self._mux.locked:
                    obeyed.append((topic, twist))
            elif self._mux.passes(topic, stamp):
                obeyed.append((topic, twist))
                # this node itself is one of the subscribers of this topic, and does not need the message
                if self._passed_publisher.get_num_connections() > 1:
                    publish(self._passed_publisher, msg)
            else:
                blocking_topic = self._mux.stronger(topic, stamp)
            self._notice_habits(stamp, topic, msg, twist, blocking_topic)
        return obeyed

    def _notice_habits(
        self, stamp: float, topic: str, msg: Twist, twist: Twist2D, blocking_topic: Optional[str]
    ) -> None:
        """Log each habit of a command's sender once, such as commands that come too slowly; note the driver.

        The driver is the node that drives the robot: the last sender of a command that is not zero and that
        no topic of higher priority blocks, even if the emergency stop rejects it.

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
            # DRIVES only tells which node now drives the robot; all other habits are mistakes
            if finding.habit is Habit.DRIVES:
                rospy.loginfo(sentence)
            else:
                self._findings.tell(sender, sentence)

    def has_sender(self) -> bool:
        """Return whether a controller, which can send commands, is connected to this node."""
        if self._main_subscriber.get_num_connections() > 0:
            return True
        # one connection of the direct topic is this node's own publisher
        return self._direct_subscriber.get_num_connections() > 1

    @property
    def e_stop_is_on(self) -> bool:
        """Return whether the emergency stop is on."""
        return self._mux.locked

    def refuse(self) -> None:
        """Obey no command of any node from now on; any thread may call this."""
        self._is_refusing = True

    def forget_commands(self) -> None:
        """Drop waiting commands, and let no input be active; the emergency stop stays as it is."""
        self._arrived.clear()
        self._mux.forget()

    def _on_twist(self, topic: str, msg: Twist) -> None:
        """Queue a command for `take`, and tell lockstep that it has come; rospy calls this for each command.

        If lockstep waits only for an answer to each scan, it drops the further commands of a topic that has
        answered the scan, so that a run is repeatable.
        """
        sender = msg._connection_header["callerid"]  # name of the node that sent the command
        if topic == self._direct_topic and sender == rospy.get_name():
            return  # this node has published the command itself, in `take`, so the command is ignored here
        self._warn_of_two_senders(topic, sender)
        if self._lockstep.drops(topic):
            self._warn_of_ignored_command(topic, sender)
            return
        self._arrived.append((topic, msg))
        # lockstep or the lead limit may be waiting for this command as the answer to the last scan
        self._lockstep.command_arrived(topic)
        self._lead_limit.command_arrived()

    def _warn_of_ignored_command(self, topic: str, sender: str) -> None:
        """Warn that lockstep ignores all but the first command of a sender for one scan.

        The first ignored command of a sender causes no warning, because it may be the stop that a controller
        sends when it ends.
        """
        if sender not in self._double_senders:
            self._double_senders.add(sender)
            return
        rospy.logwarn_throttle(
            10.0,
            f"{rospy.resolve_name(topic)}: {sender} sends several commands for one scan; lockstep uses"
            " the first and ignores the rest",
        )

    def _warn_of_two_senders(self, topic: str, sender: str) -> None:
        """Warn if two nodes send on one topic within TIMEOUT, because the robot obeys both in turn."""
        now = rospy.get_time()
        # before the first command on a topic, its sender counts as the last sender, so there is no warning
        last_sender, sent_at = self._senders.get(topic, (sender, now))
        self._senders[topic] = sender, now
        if last_sender != sender and now - sent_at <= TIMEOUT:
            rospy.logwarn_throttle(
                10.0,
                f"{rospy.resolve_name(topic)}: both {last_sender} and {sender} send commands, and the robot"
                " obeys each in turn; stop one of them, or take over on kb_teleop/cmd_vel",
            )

    def _on_e_stop(self, msg: Bool) -> None:
        """Switch the emergency stop on or off, and log and publish a change."""
        if msg.data != self._mux.locked:
            rospy.logwarn(
                "e_stop: locked, ignoring commands" if msg.data else "e_stop: released, accepting commands"
            )
            publish(self._locked_publisher, msg)
        self._mux.locked = msg.data


def may_stand(node: str) -> bool:
    """Return whether a node may stop the robot on purpose, so that its zero commands cause no warning."""
    return is_tool(node) or node.rsplit("/", 1)[-1] in OUR_NODES
