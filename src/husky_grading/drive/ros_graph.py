"""ROS graph: requests to a ROS master over XML-RPC, and findings on the topics that a submission uses."""

from __future__ import annotations

from dataclasses import replace
from typing import (
    Any,
    Collection,
    Dict,
    FrozenSet,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
)

from husky_grading.records import ROBOT_VERSIONS, SMB, MarkingConfig
from husky_highlevel_controller.xml_rpc import ask

# [s] longest wait for an answer of the ROS master; a submission may have replaced the master by a program
# that never answers
ANSWER_DEADLINE = 20.0
CALLER = "/marking"  # name under which marking sends its requests to the ROS master
MAX_CALLERS = 5  # largest number of nodes that are reported as callers of a service
TWIST, SCAN = "geometry_msgs/Twist", "sensor_msgs/LaserScan"
# topics with true positions, which a submission must not read; TRUTH has the robot's pose, and the topics of
# all objects begin with WORLD
TRUTH, WORLD = "/ground_truth/odom", "/husky_simulator/world/"
# topics of almost every node, which say nothing about the work of a submission
EVERY_NODE_HAS = {"/rosout", "/rosout_agg", "/clock", "/tf", "/tf_static"}
Nodes = Mapping[str, Sequence[str]]  # nodes by topic


def has_service(uri: str, name: str) -> bool:
    """Return whether a node offers a service."""
    return bool(_ask(uri, "lookupService", name))


def callers(uri: str, service: str, our_nodes: Collection[str]) -> Dict[str, int]:
    """Return how often each node of the submission has called a service; at most MAX_CALLERS nodes.

    Each call looks the service up at the master, and our master counts how often each node does this. The
    nodes with the most calls come first.
    """
    answer = _ask(uri, "countLookups", service)
    # the answer is checked, because a submission may have replaced the master by its own program
    counts = answer if isinstance(answer, dict) else {}
    of_others = {
        node: count for node, count in counts.items() if isinstance(count, int) and node not in our_nodes
    }
    most_first = sorted(of_others.items(), key=lambda entry: entry[1], reverse=True)
    return dict(most_first[:MAX_CALLERS])


def is_published(uri: str, topic: str) -> bool:
    """Return whether a node advertises a topic."""
    published, *_ = _ask(uri, "getSystemState") or ((), (), ())
    return any(name == topic for name, _ in published)


class Registered(NamedTuple):
    """Registrations of a submission with a ROS master, without the topics that every node has."""

    nodes: FrozenSet[str] = frozenset()  # names of nodes
    advertised: FrozenSet[str] = frozenset()  # topics on which the nodes publish
    subscribed: FrozenSet[str] = frozenset()  # topics to which the nodes subscribe


def read_registrations(uri: str, our_nodes: Collection[str]) -> Registered:
    """Return the nodes that are not ours, and the topics that they publish and subscribe to.

    The result is empty if the master does not answer.
    """
    # publishers, subscribers and services; each of the three has pairs of a name and the names of its nodes
    state = _ask(uri, "getSystemState") or ((), (), ())
    publishers, subscribers, *_ = state
    all_pairs = [pair for part in state for pair in part]
    all_nodes = {node for _, nodes in all_pairs for node in nodes}

    def topics_of_others(pairs: Sequence[Tuple[str, Sequence[str]]]) -> FrozenSet[str]:
        """Return the topics for which the master has a node that is not ours."""
        used = {topic for topic, nodes in pairs if set(nodes) - set(our_nodes)}
        return frozenset(used - EVERY_NODE_HAS)

    return Registered(
        nodes=frozenset(all_nodes - set(our_nodes)),
        advertised=topics_of_others(publishers),
        subscribed=topics_of_others(subscribers),
    )


def set_parameters(uri: str, values: Mapping[str, Any]) -> None:
    """Set ROS parameters, given by their names."""
    for name, value in values.items():
        _ask(uri, "setParam", name, value)


def topics_subscribed(uri: str, our_nodes: Collection[str] = ()) -> Tuple[str, ...]:
    """Return the topics to which a node that is not ours subscribes."""
    _, subscribers, _ = _ask(uri, "getSystemState") or ((), (), ())
    return tuple(topic for topic, nodes in subscribers if set(nodes) - set(our_nodes))


def robot_listened_to(uri: str, our_nodes: Collection[str], config: MarkingConfig) -> Optional[MarkingConfig]:
    """Return the settings of the robot whose scans a submission receives; None if there is no such robot.

    The robot of `config` is tried first. If no known robot sends scans on one of the topics, but the
    submission subscribes to exactly one topic of the type LaserScan, the robot is a Husky that sends its
    scans there.
    """
    topics = topics_subscribed(uri, our_nodes)
    if config.scan_topic in topics:
        return config
    # the SMB and the older Husky use the same topic, so a subscription to this topic means the Husky
    for version, (scan_topic, _) in ROBOT_VERSIONS.items():
        if version != SMB and scan_topic in topics:
            return replace(config, robot=version)
    types = dict(_ask(uri, "getTopicTypes") or ())
    scans = [topic for topic in topics if types.get(topic) == SCAN]
    return replace(config, robot="husky", scans=scans[0]) if len(scans) == 1 else None


def _ask(uri: str, method: str, *arguments: Any) -> Any:
    """Call an XML-RPC method of a ROS master, and return its value; None if it fails or gets no answer."""
    return ask(uri, method, CALLER, *arguments, deadline=ANSWER_DEADLINE)


def listens(subscribers: Nodes, our_nodes: Set[str]) -> bool:
    """Return whether the submission subscribes to a topic, apart from those of every node, such as /clock."""
    return any(set(nodes) - our_nodes for topic, nodes in subscribers.items() if topic not in EVERY_NODE_HAS)


class SilentTopics:
    """Topics to which the submission has subscribed, but on which no node has ever published.

    Often the name of such a topic is misspelt, or belongs to another robot. A topic stays silent after its
    subscriber has ended. A topic is not silent if its publisher comes after its subscriber, or has ended.
    """

    def __init__(self) -> None:
        self._subscribed: Set[str] = set()
        self._published: Set[str] = set()

    def update(self, publishers: Nodes, subscribers: Nodes, our_nodes: Set[str]) -> None:
        """Take in the ROS graph of now."""
        self._published |= {topic for topic, nodes in publishers.items() if nodes}
        self._subscribed |= {topic for topic, nodes in subscribers.items() if set(nodes) - our_nodes}

    @property
    def names(self) -> Tuple[str, ...]:
        """Names of the silent topics, in alphabetical order."""
        return tuple(sorted(self._subscribed - self._published - EVERY_NODE_HAS))


def unread_topics(
    publishers: Nodes, subscribers: Nodes, types: Dict[str, str], our_nodes: Set[str]
) -> List[str]:
    """Return the topics on which the submission publishes velocity commands, but to which no node subscribes.

    Such commands never reach the robot, often because the name of the topic is wrong.
    """
    return sorted(
        topic
        for topic, nodes in publishers.items()
        if set(nodes) - our_nodes and types.get(topic) == TWIST and not subscribers.get(topic)
    )


def forged_topics(publishers: Nodes, topics: Sequence[str], our_nodes: Set[str]) -> List[Tuple[str, str]]:
    """Return (topic, node) for each node of the submission that publishes on one of these topics.

    The topics are those of the simulator. A submission that publishes on them could forge scans or time.
    """
    forged: List[Tuple[str, str]] = []
    for topic in topics:
        of_submission = set(publishers.get(topic, ())) - our_nodes
        forged += [(topic, node) for node in sorted(of_submission)]
    return forged


def topics_of_truth(subscribers: Nodes, our_nodes: Set[str]) -> List[Tuple[str, str]]:
    """Return (topic, node) for each subscription of the submission to a topic with true poses.

    A robot does not know its true pose, so a submission must not read it.
    """
    read: List[Tuple[str, str]] = []
    for topic, nodes in subscribers.items():
        if topic == TRUTH or topic.startswith(WORLD):
            read += [(topic, node) for node in sorted(set(nodes) - our_nodes)]
    return read
