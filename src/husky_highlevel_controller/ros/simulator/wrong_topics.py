"""Wrong topics: those with publishers or subscribers alone, where another topic has almost the same name.

In: the ROS graph. Out: findings, and a sentence for each. Only the standard library, for `./dev doctor`.
"""

from __future__ import annotations

import os
import re
from difflib import SequenceMatcher
from typing import Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from husky_highlevel_controller.xml_rpc import ask

CALLER = "/wrong_topics"
# nodes that publish and subscribe to any topic by request, and the simulator with its many topics
TOOLS = re.compile(
    r"(.*/)?(rqt|rviz|rosbag|rostopic|record_|play_|rosout|roslaunch|husky_simulator|husky_rviz|husky_web)"
)
MIN_LIKENESS = 0.85  # of two names, by difflib's ratio: cmd_val and cmd_vel are; cmd_vel_raw is another one
Nodes = Mapping[str, Sequence[str]]  # by topic


class Graph(NamedTuple):
    """Topics of a ROS master, with the nodes of each."""

    publishers: Nodes
    subscribers: Nodes
    types: Mapping[str, str]  # by topic


class WrongTopic(NamedTuple):
    """Topic that only one side uses, and the one that its node probably means."""

    node: str
    topic: str
    kind: str  # type of its messages
    publishes: bool  # else the node subscribes
    suggestion: str


def wrong_topics(graph: Graph) -> List[WrongTopic]:
    """Topics of a graph that are probably mistakes.

    One has no other side, and a topic of the same type and almost the same name has. Namespaces of other
    robots and the topics of TOOLS are no mistakes.
    """
    sides = ((True, graph.publishers, graph.subscribers), (False, graph.subscribers, graph.publishers))
    return [
        WrongTopic(node, topic, graph.types[topic], publishes, suggestion)
        for publishes, own, others in sides
        for topic in sorted(own)
        if not others.get(topic) and graph.types.get(topic, "*") != "*"
        for node in sorted(own[topic])
        if not TOOLS.match(node)
        for suggestion in _suggestions(topic, node, others, graph.types)
    ]


def wrong_topic_sentence(finding: WrongTopic) -> str:
    """A finding for the log."""
    if finding.publishes:
        does = f"publishes {finding.kind} on {finding.topic}, which no node reads"
    else:
        does = f"subscribes to {finding.topic}, which no node publishes"
    remedy = f"did you mean {finding.suggestion}?"
    if (finding.topic.rsplit("/", 1)[-1], finding.suggestion) == ("scan", f"{finding.topic[:-4]}front/scan"):
        remedy += " Or launch with robot:=husky_melodic, whose lidar is on scan in the frame base_laser."
    return f"{finding.node} {does}: {remedy}"


def read_graph(master_uri: str) -> Optional[Graph]:
    """The graph of a master; None where none answers."""
    state = ask(master_uri, "getSystemState", CALLER)
    types = ask(master_uri, "getTopicTypes", CALLER)
    return None if state is None or types is None else Graph(dict(state[0]), dict(state[1]), dict(types))


def _suggestions(topic: str, node: str, others: Nodes, types: Mapping[str, str]) -> Iterator[str]:
    """The topic of the other side that is nearest to a wrong one, if any is near."""
    candidates = [
        (distance, other)
        for other, nodes in others.items()
        if types.get(other) == types[topic] and any(name != node for name in nodes)
        for distance in [_distance(topic, other)]
        if distance is not None
    ]
    if candidates:
        yield min(candidates)[1]


def _distance(topic: str, other: str) -> Optional[Tuple[int, float]]:
    """Namespaces left out, and unlikeness, of a topic written for another; None: it is no slip of the pen."""
    if re.sub(r"\d", "", topic) == re.sub(r"\d", "", other) or topic.endswith(other):
        return None  # that of another robot, by number or by namespace
    if other.endswith(topic):
        return other.count("/") - topic.count("/"), 0.0
    parts, other_parts = topic.strip("/").split("/"), other.strip("/").split("/")
    if len(parts) != len(other_parts):  # front_scan for front/scan
        parts, other_parts = ["_".join(parts)], ["_".join(other_parts)]
    likeness = min(SequenceMatcher(None, *pair).ratio() for pair in zip(parts, other_parts))
    return None if likeness < MIN_LIKENESS else (0, 1.0 - likeness)


def main() -> None:
    """Print a sentence for each wrong topic on $ROS_MASTER_URI."""
    graph = read_graph(os.environ.get("ROS_MASTER_URI", "http://localhost:11311"))
    for finding in wrong_topics(graph) if graph else ():
        print(wrong_topic_sentence(finding))


if __name__ == "__main__":
    main()
