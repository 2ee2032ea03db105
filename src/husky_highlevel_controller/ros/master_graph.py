"""ROS graph, from the answers of the master and the nodes.

In: the address of a ROS master. Out: topics with their nodes and types. This module imports only the standard
library, because `./dev doctor` uses it, too.
"""

from __future__ import annotations

from typing import List, Mapping, NamedTuple, Optional, Sequence

from husky_highlevel_controller.xml_rpc import ask

CALLER = "/master_graph"
SIMULATOR = "husky_simulator"  # name of the simulator's node, without its namespace
# parameter in the simulator's namespace; in it, the simulator stores the faults that it has found in other
# nodes
FINDINGS = "husky_findings"
Nodes = Mapping[str, Sequence[str]]  # names of nodes by topic
Kinds = Mapping[str, str]  # types of messages by topic


class Graph(NamedTuple):
    """Topics of a ROS master, with the nodes of each."""

    publishers: Nodes  # names of the nodes that publish each topic
    subscribers: Nodes  # names of the nodes that subscribe to each topic
    types: Mapping[str, str]  # type by topic


def read_graph(master_uri: str) -> Optional[Graph]:
    """Return the graph of a master, or None if no master answers."""
    state = ask(master_uri, "getSystemState", CALLER)
    types = ask(master_uri, "getTopicTypes", CALLER)
    if state is None or types is None:
        return None
    publishers, subscribers = state[:2]  # the third list has the services
    return Graph(dict(publishers), dict(subscribers), dict(types))


def read_kinds(master_uri: str, node: str, publishes: bool) -> Kinds:
    """Return the types of the topics that a node publishes (`publishes`), or to which it subscribes.

    The node itself is asked. The result is empty if it does not answer.
    """
    uri = ask(master_uri, "lookupNode", CALLER, node)
    if not uri:  # the master does not know the node
        return {}
    answer = ask(uri, "getPublications" if publishes else "getSubscriptions", CALLER)
    return dict(answer or ())


def read_absent_services(master_uri: str) -> List[Sequence[str]]:
    """Return the services that nodes asked for in vain: node and name of each service.

    Only the master of `./dev launch` has this list. With any other master, the result is empty.
    """
    return list(ask(master_uri, "getAbsentServices", CALLER) or ())


def read_unread_parameters(master_uri: str) -> List[Sequence[str]]:
    """Return the unread parameters: node, name of the set parameter, name that the node asked for in vain.

    Only the master of `./dev launch` has this list. With any other master, the result is empty.
    """
    return list(ask(master_uri, "getUnreadParams", CALLER) or ())


def read_findings(master_uri: str, simulator: str) -> List[Sequence[str]]:
    """Return the faults that a simulator has found in other nodes: name of the node, and a sentence."""
    namespace = simulator.rsplit("/", 1)[0]
    name = f"{namespace}/{FINDINGS}"
    return list(ask(master_uri, "getParam", CALLER, name) or ())
