"""Mistakes in the ROS graph: misspelt and absent topics, parameters, wrong types, second publishers.

In: the ROS graph. Out: findings, and a sentence for each. This module imports only the standard library,
because `./dev doctor` uses it.
"""

from __future__ import annotations

import os
import re
from functools import partial
from typing import Callable, Iterator, List, Mapping, NamedTuple, Optional, Tuple, Union

from husky_highlevel_controller.ros.master_graph import (
    SIMULATOR,
    Graph,
    Kinds,
    Nodes,
    read_absent_services,
    read_findings,
    read_graph,
    read_kinds,
    read_unread_parameters,
)
from husky_highlevel_controller.spelling import likeness

# beginnings of the names of tools of ROS, and of this package's simulator and its windows
_TOOLS = re.compile(
    r"(.*/)?(rqt|rviz|rosbag|rostopic|rosparam|rosservice|record_|play_|rosout|roslaunch|husky_simulator"
    r"|husky_rviz|husky_web)"
)
# A name may be misspelt if its likeness (difflib's ratio) to another name is at least this. cmd_val is like
# cmd_vel, but cmd_vel_raw is not.
MIN_LIKENESS = 0.85


class WrongTopic(NamedTuple):
    """Topic that only one side uses, and the topic that its node probably means."""

    node: str
    topic: str
    kind: str  # type of the messages that the node uses
    publishes: bool  # true if the node publishes, false if it subscribes
    suggestion: str


class WrongType(NamedTuple):
    """Node that uses a topic of the simulator with another type of messages, so that nothing arrives."""

    node: str
    topic: str
    kind: str  # type of the messages that the node uses
    publishes: bool  # true if the node publishes, false if it subscribes
    simulator: str
    right_kind: str  # type of messages that the simulator uses on this topic


class SecondPublisher(NamedTuple):
    """Node that publishes a topic of the simulator, so subscribers of the topic mix up two sources."""

    node: str
    topic: str
    simulator: str


class UnreadParameter(NamedTuple):
    """Unread parameter below a node's name, and a similar parameter that the node asked for in vain."""

    node: str
    parameter: str
    asked: str


class AbsentTopic(NamedTuple):
    """Node that uses a topic of Gazebo which the simulator does not have."""

    node: str
    topic: str
    publishes: bool  # true if the node publishes, false if it subscribes


class AbsentService(NamedTuple):
    """Node that asks for a service of Gazebo which the simulator does not have."""

    node: str
    service: str


Mistake = Union[WrongTopic, WrongType, SecondPublisher, UnreadParameter, AbsentTopic, AbsentService]
# topics of Gazebo that the simulator does not have, with advice what to use instead; {} stands for the
# namespace of the topic
ABSENT_TOPICS = {
    "link_states": "use {}/model_states, or TF for the links of the robot",
    "performance_metrics": "see ./dev bench",
    "set_link_state": "call the service {}/set_model_state",
    "set_model_state": "call the service {}/set_model_state",
}
# services of Gazebo that the simulator does not have, with advice what to do instead; all other services
# have OTHER_ADVICE
ABSENT_SERVICES = {
    "apply_body_wrench": "forces are not simulated; drive the robot by cmd_vel",
    "apply_joint_effort": "forces are not simulated; drive the robot by cmd_vel",
    "get_joint_properties": "read the topic joint_states",
    "get_link_state": "call {}/get_model_state, or use TF for the links of the robot",
    "set_link_state": "call {}/set_model_state",
    "set_model_configuration": "drive the wheels by cmd_vel; no other joint moves",
    "set_physics_properties": "launch with real_time_factor:=...",
}
OTHER_ADVICE = "see docs/gazebo_launch_files.md"
# function(node, publishes), which returns the types of the topics that a node publishes (True) or subscribes
# to (False)
KindsOf = Callable[[str, bool], Kinds]
SHARED = {"/clock", "/diagnostics", "/rosout", "/tf", "/tf_static"}  # topics that may have several publishers


def is_tool(node: str) -> bool:
    """Return whether a node is a tool of ROS, the simulator, or one of its windows, by its name.

    Nothing that such a node does is a mistake. A user chooses the topics, parameters and services of a tool,
    and the simulator has many topics that no other node needs.
    """
    return bool(_TOOLS.match(node))


def wrong_types(graph: Graph, simulator: str, kinds_of: KindsOf) -> List[WrongType]:
    """Return the nodes that cannot exchange messages with the simulator, because their types differ.

    Args:
        graph: topics and nodes.
        simulator: name of the simulator's node.
        kinds_of: function(node, publishes) that asks the node itself for the types of its topics, because the
            master has only one type for each topic.
    """
    found = []
    for publishes, nodes_by_topic in ((True, graph.publishers), (False, graph.subscribers)):
        # the simulator subscribes to topics that the node publishes, and the other way round
        right_kinds = kinds_of(simulator, not publishes)
        # The topics of SHARED are not checked. Among them are /tf and /tf_static, whose type has two names
        # (of tf and of tf2_msgs), so a check would cause a false alarm.
        nodes_and_topics = []
        for topic in set(right_kinds) - SHARED:
            for node in nodes_by_topic.get(topic, ()):
                if node != simulator:
                    nodes_and_topics.append((node, topic))
        for node, topic in sorted(nodes_and_topics):
            kind = kinds_of(node, publishes).get(topic, "*")  # "*" means any type or an unknown type
            if kind not in ("*", right_kinds[topic]):
                found.append(WrongType(node, topic, kind, publishes, simulator, right_kinds[topic]))
    return found


def second_publishers(graph: Graph, simulator: str) -> List[SecondPublisher]:
    """Return the nodes that publish on a topic on which only the simulator should publish."""
    found = []
    for topic, nodes in sorted(graph.publishers.items()):
        # a topic that the simulator also reads is a command topic, on which other nodes may publish
        is_command_topic = simulator in graph.subscribers.get(topic, ())
        if simulator not in nodes or is_command_topic or topic in SHARED:
            continue
        for node in sorted(nodes):
            if node != simulator:
                found.append(SecondPublisher(node, topic, simulator))
    return found


def unread_parameters(master_uri: str) -> List[UnreadParameter]:
    """Return the parameters that are set, but that no node has read.

    Only the master that `./dev launch` starts has a list of them. With any other master, the result is empty.
    """
    found = []
    for node, parameter, asked, *_ in read_unread_parameters(master_uri):
        found.append(UnreadParameter(str(node), str(parameter), str(asked)))
    return found


def absent_topics(graph: Graph) -> List[AbsentTopic]:
    """Return the nodes that publish or subscribe to a topic of Gazebo that no node of this graph serves."""
    found = []
    for node, topic, publishes, _ in _one_sided(graph):
        namespace, _, name = topic.rpartition("/")
        if namespace.endswith("/gazebo") and name in ABSENT_TOPICS:
            found.append(AbsentTopic(node, topic, publishes))
    return found


def absent_services(master_uri: str) -> List[AbsentService]:
    """Return the nodes that ask for a service of Gazebo which the simulator does not have.

    Only the master that `./dev launch` starts has a list of them. With any other master, the result is empty.
    """
    found = []
    for row in read_absent_services(master_uri):
        node, service = str(row[0]), str(row[1])
        namespace, _, _ = service.rpartition("/")
        if namespace.endswith("/gazebo") and not is_tool(node):
            found.append(AbsentService(node, service))
    return found


def wrong_topics(graph: Graph) -> List[WrongTopic]:
    """Return the topics of a graph whose names are probably misspelt, with the names that are meant.

    A topic is probably misspelt if it has no subscriber, but a similar topic has a subscriber; or if it has
    no publisher, but a similar topic has a publisher. A similar topic has the same type and almost the same
    name. Topics in the namespaces of other robots, and the topics of tools, are not mistakes.
    """
    found = []
    for node, topic, publishes, other_side in _one_sided(graph):
        kind = graph.types.get(topic, "*")
        if kind == "*":  # the type is unknown
            continue
        suggestion = _suggestion(topic, node, other_side, graph.types)
        if suggestion is not None:
            found.append(WrongTopic(node, topic, kind, publishes, suggestion))
    return found


def _one_sided(graph: Graph) -> Iterator[Tuple[str, str, bool, Nodes]]:
    """Yield the nodes that publish a topic without subscribers, or subscribe to a topic without publishers.

    Tools are left out (`is_tool`).

    Yields:
        Node, topic, whether the node publishes, and the other side of the graph. The other side is the
        subscribers of all topics if the node publishes, and the publishers of all topics if it subscribes.
    """
    sides = ((True, graph.publishers, graph.subscribers), (False, graph.subscribers, graph.publishers))
    for publishes, nodes_by_topic, other_side in sides:
        for topic in sorted(nodes_by_topic):
            if not other_side.get(topic):
                for node in sorted(nodes_by_topic[topic]):
                    if not is_tool(node):
                        yield node, topic, publishes, other_side


def mistake_sentence(finding: Mistake) -> str:
    """Return a finding as a sentence for the log: what the node does wrong, and what to change."""
    if isinstance(finding, WrongType):
        # verb for the node, and verb for the simulator
        does, it_does = ("publishes", "reads") if finding.publishes else ("reads", "publishes")
        return (
            f"{finding.node} {does} {finding.kind} on {finding.topic}, but {finding.simulator} {it_does} "
            f"{finding.right_kind} there, so no message arrives: change the type in {finding.node}"
        )
    if isinstance(finding, SecondPublisher):
        return (
            f"{finding.node} publishes {finding.topic}, which {finding.simulator} publishes too, so nodes "
            f"that read it mix up two sources: end {finding.node}, or remap its topic"
        )
    if isinstance(finding, UnreadParameter):
        return (
            f"{finding.node} asked for the parameter {finding.asked}, which is not set, but "
            f"{finding.parameter} is set and no node has read it: use one name in {finding.node} and in the "
            "launch file"
        )
    if isinstance(finding, AbsentService):
        namespace, _, name = finding.service.rpartition("/")
        # `absent_services` finds every name in the namespace gazebo, also names that are not in the table
        remedy = ABSENT_SERVICES.get(name, OTHER_ADVICE).format(namespace)
        return (
            f"{finding.node} asks for the service {finding.service}, which this simulator does not have: "
            f"{remedy}"
        )
    if isinstance(finding, AbsentTopic):
        namespace, _, name = finding.topic.rpartition("/")
        does = "publishes" if finding.publishes else "subscribes to"
        # `absent_topics` finds only topics that are in the table
        remedy = ABSENT_TOPICS[name].format(namespace)
        return f"{finding.node} {does} {finding.topic}, which this simulator does not have: {remedy}"
    return _wrong_topic_sentence(finding)


def _wrong_topic_sentence(finding: WrongTopic) -> str:
    """Return a misspelt topic as a sentence for the log."""
    if finding.publishes:
        does = f"publishes {finding.kind} on {finding.topic}, which no node reads"
    else:
        does = f"subscribes to {finding.topic}, which no node publishes"
    remedy = f"did you mean {finding.suggestion}?"
    namespace, _, name = finding.topic.rpartition("/")
    # the robot husky_melodic publishes its scans on scan, so the node may have been written for this robot
    if name == "scan" and finding.suggestion == f"{namespace}/front/scan":
        remedy += " Or launch with robot:=husky_melodic, whose lidar is on scan in the frame base_laser."
    return f"{finding.node} {does}: {remedy}"


def _suggestion(topic: str, node: str, other_side: Nodes, types: Mapping[str, str]) -> Optional[str]:
    """Return the topic that is probably meant by a misspelt topic, or None if no name is similar.

    Args:
        topic: topic that no node of the other side uses.
        node: node that uses the topic; topics that only this node uses are not suggested.
        other_side: nodes by topic; all publishers if `node` subscribes, all subscribers if it publishes.
        types: types of messages by topic; only topics of the same type are suggested.
    """
    candidates = []  # pairs of the distance of a similar topic and its name
    for other, nodes in other_side.items():
        is_used_by_others = any(name != node for name in nodes)
        if is_used_by_others and types.get(other) == types[topic]:
            distance = _distance(topic, other)
            if distance is not None:
                candidates.append((distance, other))
    if not candidates:
        return None
    # the topic with the smallest distance; if distances are equal, the first name in the alphabet
    _, nearest = min(candidates)
    return nearest


def _distance(topic: str, right_topic: str) -> Optional[Tuple[int, float]]:
    """Return how far a topic is from a right topic, or None if it is probably not a typing error.

    The distance is a pair: the number of namespaces that `topic` lacks, and the unlikeness (0 to 1) of the
    names. For example, /scan is at (1, 0.0) from /front/scan, and /cmd_val is at (0, 0.14) from /cmd_vel.
    Python compares pairs by their first numbers, so a typing error is nearer than a missing namespace.
    """
    # topics that differ only in a number, such as /robot1/scan and /robot2/scan, belong to two robots
    if re.sub(r"\d", "", topic) == re.sub(r"\d", "", right_topic):
        return None
    # `topic` only has more namespaces, such as /robot1/scan for /scan, so it belongs to another robot
    if topic.endswith(right_topic):
        return None
    # `topic` only lacks namespaces, such as /scan for /front/scan
    if right_topic.endswith(topic):
        return right_topic.count("/") - topic.count("/"), 0.0
    unlikeness = 1.0 - likeness(topic.strip("/"), right_topic.strip("/"), separator="/")
    return (0, unlikeness) if unlikeness <= 1.0 - MIN_LIKENESS else None


def main() -> None:
    """Print a sentence for each mistake on $ROS_MASTER_URI."""
    master_uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
    graph = read_graph(master_uri)
    if graph is None:  # no master answers, so there is no graph to check
        return
    findings: List[Mistake] = [
        *wrong_topics(graph),
        *absent_topics(graph),
        *absent_services(master_uri),
        *unread_parameters(master_uri),
    ]
    # every node publishes its log, so all nodes are among the publishers
    nodes = {node for names in graph.publishers.values() for node in names}
    for simulator in sorted(node for node in nodes if node.rsplit("/", 1)[-1] == SIMULATOR):
        findings += second_publishers(graph, simulator)
        findings += wrong_types(graph, simulator, partial(read_kinds, master_uri))
        for node, sentence in read_findings(master_uri, simulator):
            if node in nodes:  # a mistake of a node that has ended is not printed
                print(f"{simulator} has found: {sentence}")
    for finding in findings:
        print(mistake_sentence(finding))


if __name__ == "__main__":
    main()
