"""What the ROS graph says about a submission: which of its topics lead nowhere, which of ours it forges.

In: the master's lists of topics and nodes. Out: topic names and sentences. Must not know: ROS, points.
"""

from __future__ import annotations

from typing import Dict, List, Mapping, Sequence, Set, Tuple

TWIST = "geometry_msgs/Twist"
EVERY_NODE_HAS = {"/rosout", "/rosout_agg", "/clock", "/tf", "/tf_static"}
Nodes = Mapping[str, Sequence[str]]  # topic: nodes


def silent_topics(publishers: Nodes, subscribers: Nodes, ours: Set[str]) -> List[str]:
    """Topics to which only the submission subscribes and which nothing publishes."""
    return sorted(
        topic
        for topic, nodes in subscribers.items()
        if set(nodes) - ours and not publishers.get(topic) and topic not in EVERY_NODE_HAS
    )


def unread_topics(publishers: Nodes, subscribers: Nodes, types: Dict[str, str], ours: Set[str]) -> List[str]:
    """Velocity commands of the submission that have no subscriber."""
    return sorted(
        topic
        for topic, nodes in publishers.items()
        if set(nodes) - ours and types.get(topic) == TWIST and not subscribers.get(topic)
    )


def forged_topics(publishers: Nodes, guarded: Sequence[str], ours: Set[str]) -> List[Tuple[str, str]]:
    """(topic, node) of the submission where only the simulator publishes."""
    return [(topic, node) for topic in guarded for node in sorted(set(publishers.get(topic, ())) - ours)]
