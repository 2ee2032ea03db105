"""RViz windows of a launch: what each of them has still to do before it draws.

In: the names of the launched nodes, the ROS master, RViz's configuration files. Out: missing topics by node.

RViz loads the displays of its configuration in the order of the file: it subscribes to their topics, reads
the robot's description in between, and draws when it has done all that. The master does not say who has read
a parameter, so the subscriptions have to.
"""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import Any, Dict, FrozenSet, Iterable, Iterator, List, Optional, Sequence, Tuple

import rosgraph
import yaml

from husky_highlevel_controller.xml_rpc import ask

IN_NAME = ("rviz", "gazebo_gui")  # parts of the name of a node that is an RViz
TOPICS = ("Topic", "Marker Topic", "Update Topic")  # keys of a display with the topic that it subscribes to
PROCESSES = Path("/proc")
TRANSFORMS = "/tf"  # every RViz subscribes to it, and on its own


def is_rviz(node: str) -> bool:
    """Whether a launched node is an RViz, by its name: roslaunch does not tell its program."""
    return any(part in node for part in IN_NAME)


def missing_topics(master_uri: str, caller: str, nodes: Iterable[str]) -> Dict[str, List[str]]:
    """Topics that each RViz node has still to subscribe to, by the node's full name.

    Nodes that draw are left out.

    Args:
        master_uri: of the ROS master.
        caller: full name of the node that asks.
        nodes: names of RViz nodes that run, or are about to.
    """
    missing = {}
    for name in nodes:
        node = "/" + name.lstrip("/")
        uri = ask(master_uri, "lookupNode", caller, node)
        pid = ask(uri, "getPid", caller) if uri else None
        subscribed = ask(uri, "getSubscriptions", caller) if uri else None
        wanted = {TRANSFORMS} | (_topics_of_process(node, pid) if isinstance(pid, int) else set())
        topics = sorted(wanted - {topic for topic, _ in subscribed or ()})
        if topics:
            missing[node] = topics
    return missing


@lru_cache(maxsize=None)
def _topics_of_process(node: str, pid: int) -> FrozenSet[str]:
    """Topics that the configuration file of a process names; none for one that cannot be read."""
    try:
        words = [os.fsdecode(word) for word in (PROCESSES / str(pid) / "cmdline").read_bytes().split(b"\0")]
        file, remappings = _arguments(words)
        if file is None:
            return frozenset()
        content = yaml.safe_load((PROCESSES / str(pid) / "cwd" / file).read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError):  # RViz itself complains of its file
        return frozenset()
    manager = content.get("Visualization Manager") if isinstance(content, dict) else None
    topics = topics_of_displays(manager.get("Displays") if isinstance(manager, dict) else None)
    resolve = rosgraph.names.resolve_name
    renamed = {resolve(old, node): resolve(new, node) for old, new in remappings}
    resolved = (resolve(topic, node) for topic in topics)
    return frozenset(renamed.get(topic, topic) for topic in resolved)


def _arguments(words: Sequence[str]) -> Tuple[Optional[str], List[Tuple[str, str]]]:
    """The configuration file in RViz's command line, and the topics that it renames, (old, new)."""
    file = next(
        (word for option, word in zip(words, words[1:]) if option in ("-d", "--display-config")), None
    )
    pairs = (word.split(":=", 1) for word in words if ":=" in word and not word.startswith("_"))
    return file, [(old, new) for old, new in pairs]


def topics_of_displays(displays: Any) -> Iterator[str]:
    """Topics that RViz's displays subscribe to, of those that are switched on, also in groups."""
    for display in displays if isinstance(displays, list) else ():
        if not isinstance(display, dict) or not display.get("Enabled", True):
            continue
        yield from (display[key] for key in TOPICS if isinstance(display.get(key), str) and display[key])
        yield from topics_of_displays(display.get("Displays"))
