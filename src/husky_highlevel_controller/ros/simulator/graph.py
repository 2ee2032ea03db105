"""ROS graph around the simulator: partners that must have joined before time begins, and mistakes.

In: topics, the ROS master. Out: whether the partners are there; warnings.
"""

from __future__ import annotations

import threading
import time
from typing import Callable, Dict, FrozenSet, Iterator, NamedTuple, Optional, Sequence, Set

import rosgraph
import rospy
from rosgraph_msgs.msg import Clock

from husky_highlevel_controller.ros.master_graph import Graph, Kinds, read_graph, read_kinds
from husky_highlevel_controller.ros.node import contained
from husky_highlevel_controller.ros.simulator.findings import Findings
from husky_highlevel_controller.ros.simulator.marker_frames import MarkerFrames
from husky_highlevel_controller.ros.simulator.wrong_topics import (
    Mistake,
    absent_services,
    absent_topics,
    mistake_sentence,
    second_publishers,
    unread_parameters,
    wrong_topics,
    wrong_types,
)
from husky_highlevel_controller.xml_rpc import ask

# nodes that never drive the robot; every roslaunch, simulator.launch or a launch file in compat/ starts them
OWN_NODES = {
    "master", "rosout", "husky_simulator", "robot_state_publisher", "rviz", "husky_rviz", "husky_web",
    "arrival_exit", "spawn_husky", "gazebo_gui",
}  # fmt: skip
PERIOD = 2.5  # [s] wall time between two queries of the ROS graph
# [s] simulated time for which a mistake must last before it is reported, because the missing publisher or
# subscriber may start later
JOINING_TIME = 5.0


class Partners:
    """Nodes that must be connected before simulated time begins: a controller, and all subscribers."""

    def __init__(
        self,
        scans: Optional[rospy.Publisher],
        others: Sequence[rospy.Publisher],
        command_topics: str,
        has_sender: Callable[[], bool],
    ) -> None:
        """Set up; the partners have joined when these conditions are all true.

        - The scans have a subscriber, and a command topic has a sender. So a controller runs.
        - All nodes that subscribe to the scans or to the `others` are connected. Otherwise a node could lose
          a transform at the beginning, which would change the run.

        Args:
            scans: publisher of the scans; None for a robot without a lidar.
            others: other publishers whose subscribers must be connected.
            command_topics: names of the topics of commands, as a text for the log.
            has_sender: returns whether a node that sends commands is connected to this node.
        """
        self._scans = scans
        # publishers whose subscribers must all be connected
        self._publishers: Sequence[rospy.Publisher] = [*others, scans] if scans else others
        self.command_topics, self._has_command_sender = command_topics, has_sender
        self.scan_topic = scans.resolved_name if scans else ""  # empty for a robot without a lidar

    def joined(self) -> bool:
        """Return whether all partners are connected; false if the master does not answer."""
        if not self._has_command_sender() or (self._scans and not self._scans.get_num_connections()):
            return False
        # topics with their publishers, topics with their subscribers, services; None without an answer
        state = ask(rosgraph.get_master_uri(), "getSystemState", rospy.get_name())
        if not state:
            return False
        subscribers = state[1]
        # number of subscribers of each topic; the master also counts subscribers that are not connected yet
        expected = {topic: len(nodes) for topic, nodes in subscribers}
        for publisher in self._publishers:
            if publisher.get_num_connections() < expected.get(publisher.resolved_name, 0):
                return False
        return True


def _nodes_by_launch() -> Iterator[Set[str]]:
    """Yield, for each roslaunch on this master, the names of its nodes that have not ended."""
    for uri in rospy.get_param("/roslaunch/uris", {}).values():
        # list of the running processes, and list of the ended processes; None if this roslaunch has ended
        processes = ask(uri, "list_processes")
        running = processes[0] if processes else []
        # roslaunch appends a number to the name of each node, as in "husky_simulator-3"; the number is cut
        # off
        yield {name.rsplit("-", 1)[0] for name, _ in running}


def launched_nodes() -> Set[str]:
    """Return the names of all nodes that roslaunch has started on this master, and that have not ended."""
    return set().union(*_nodes_by_launch())


def launched_nodes_of_others() -> Set[str]:
    """Return the names of the launched nodes that may be a controller: all nodes except OWN_NODES."""
    return {name for name in launched_nodes() if name.rsplit("/", 1)[-1] not in OWN_NODES}


def nodes_of_same_launch(name: str) -> Set[str]:
    """Return the names of all nodes of the roslaunch that has started the node `name`; empty if none has.

    The names have no leading slash.
    """
    for names in _nodes_by_launch():
        if name in names:
            return names
    return set()


class SecondFilter:
    """Finds another node that estimates the robot's pose, if it was launched with the simulator.

    Then the simulator no longer publishes its own estimate, because the transform odom -> base_link may have
    only one source.
    """

    def __init__(self, filter_topic: str, leave_filter_to: Callable[[str], None]) -> None:
        """Set up; `leave_filter_to` gets the name of the node that estimates the pose from then on."""
        self._filter_topic, self._leave_filter_to = filter_topic, leave_filter_to
        self._seen_publishers = {rospy.get_name()}
        # name of another node that publishes the filtered odometry; empty if there is none
        self.filter_node = ""

    def look(self, graph: Graph) -> None:
        """Let a new publisher of `filter_topic` estimate the pose in place of the simulator.

        This publisher must belong to the same roslaunch as the simulator. Any other publisher is a mistake,
        which `second_publishers` finds.
        """
        # `_seen_publishers` has this node from the beginning, so this node is never a new publisher
        new_publishers = set(graph.publishers.get(self._filter_topic, ())) - self._seen_publishers
        for node in sorted(new_publishers):
            self._seen_publishers.add(node)
            is_launched = node.lstrip("/") in nodes_of_same_launch(rospy.get_name().lstrip("/"))
            # a node with publish_tf = false publishes no transform, so the simulator must continue its own
            if is_launched and rospy.get_param(f"{node}/publish_tf", True):
                self.filter_node = node
                self._leave_filter_to(node)


class _TopicList(NamedTuple):
    """Topics that a node publishes, or topics to which it subscribes."""

    node: str
    publishes: bool  # true if the node publishes the topics, false if it subscribes to them
    topics: FrozenSet[str]


class GraphWatch:
    """Looks for mistakes of other nodes in the ROS graph, in a thread of its own, until the process ends."""

    def __init__(
        self,
        simulated_time: Callable[[], float],
        warn: Callable[[str], None],
        filter_watch: Optional[SecondFilter] = None,
        markers: Optional[MarkerFrames] = None,
        findings: Optional[Findings] = None,
    ) -> None:
        """Set up; the watch uses its arguments only in its own thread.

        Args:
            simulated_time: returns the simulated time [s].
            warn: gets a sentence about each mistake in the graph.
            filter_watch: finds another node that estimates the pose; None to look for none.
            markers: finds markers in unknown frames; None in a graded run, because nodes get no hints then.
            findings: mistakes that other parts of this node have found, such as `markers`. At each look, the
                watch sends new findings to the master, for ./dev doctor. None to send nothing.
        """
        self._simulated_time, self._warn = simulated_time, warn
        self._filter_watch, self._markers, self._findings = filter_watch, markers, findings
        self._master_uri = rosgraph.get_master_uri()
        # this node, and the nodes whose messages on /clock have already caused a warning
        self._clock_nodes = {rospy.get_name()}
        self._clock_subscriber: Optional[rospy.Subscriber] = None  # made when a second node advertises /clock
        # Types of the topics in each list. Nodes are asked for these types. A node is asked again only if its
        # list has changed, because asking each node at each look would cost time.
        self._kinds_of_lists: Dict[_TopicList, Kinds] = {}
        # [s] simulated time at which each mistake was first seen
        self._first_seen_at: Dict[Mistake, float] = {}
        self._warned_mistakes: Set[Mistake] = set()  # mistakes that were reported; each is reported only once

    def start(self) -> None:
        """Start the thread, which looks at the graph now and then every PERIOD."""
        threading.Thread(target=self._run, name="graph", daemon=True).start()

    def _run(self) -> None:
        """Look at the graph every PERIOD until the process ends.

        The first look does not search for mistakes, because other nodes are still starting, and the search
        asks all of them, which would delay their start.
        """
        is_first_look = True
        while True:
            with contained("the search for mistakes in the ROS graph"):
                graph = read_graph(self._master_uri)  # None if the master does not answer
                if graph is not None and is_first_look:
                    self._look_at_publishers(graph)
                elif graph is not None:
                    self.look(graph)
                if self._findings is not None:
                    self._findings.publish()
            is_first_look = False
            time.sleep(PERIOD)

    def look(self, graph: Graph) -> None:
        """Notice new publishers of important topics, and warn of mistakes that have lasted long enough."""
        self._look_at_publishers(graph)
        self._warn_of_mistakes(graph)

    def _look_at_publishers(self, graph: Graph) -> None:
        """Notice a second clock, another node that estimates the pose, and new topics of markers."""
        has_second_clock = bool(set(graph.publishers.get("/clock", ())) - self._clock_nodes)
        if has_second_clock and self._clock_subscriber is None:
            # a second clock is reported only when it sends a message, because rosbag play advertises /clock
            # but sends nothing there without the option --clock
            self._clock_subscriber = rospy.Subscriber("/clock", Clock, self._on_clock)
        if self._filter_watch is not None:
            self._filter_watch.look(graph)
        if self._markers is not None:
            self._markers.look(graph)

    def _warn_of_mistakes(self, graph: Graph) -> None:
        """Warn of mistakes that last for JOINING_TIME, because a missing node may still be starting."""
        now = self._simulated_time()
        mistakes = list(self._mistakes(graph))
        # a mistake that is no longer there is forgotten; if it comes again, its time begins again
        self._first_seen_at = {mistake: self._first_seen_at.get(mistake, now) for mistake in mistakes}
        for mistake, first_time in self._first_seen_at.items():
            if now - first_time >= JOINING_TIME and mistake not in self._warned_mistakes:
                self._warned_mistakes.add(mistake)
                self._warn(mistake_sentence(mistake))

    def _on_clock(self, message: Clock) -> None:
        """Warn once of each other node that publishes /clock."""
        name = message._connection_header["callerid"]
        if name not in self._clock_nodes:
            self._clock_nodes.add(name)
            self._warn(f"{name} also publishes /clock, so time will jump; end it, or this simulator")

    def _mistakes(self, graph: Graph) -> Iterator[Mistake]:
        """Yield the mistakes in a graph: wrong topics, parameters, services, types, and second publishers."""
        simulator = rospy.get_name()

        def kinds_of(node: str, publishes: bool) -> Kinds:
            """Return the types of the topics that a node publishes, or of those to which it subscribes."""
            nodes_by_topic = graph.publishers if publishes else graph.subscribers
            topics = frozenset(topic for topic, nodes in nodes_by_topic.items() if node in nodes)
            topic_list = _TopicList(node, publishes, topics)
            if topic_list not in self._kinds_of_lists:
                self._kinds_of_lists[topic_list] = read_kinds(self._master_uri, node, publishes)
            return self._kinds_of_lists[topic_list]

        yield from wrong_topics(graph)
        yield from unread_parameters(self._master_uri)
        yield from absent_topics(graph)
        yield from absent_services(self._master_uri)
        # `filter_node` publishes the filtered odometry in place of this node, so it is not a second publisher
        filter_node = self._filter_watch.filter_node if self._filter_watch else ""
        for each in second_publishers(graph, simulator):
            if each.node != filter_node:
                yield each
        yield from wrong_types(graph, simulator, kinds_of)
