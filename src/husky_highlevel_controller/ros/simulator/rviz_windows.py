"""RViz windows of a launch: finds the RViz nodes whose window is not open yet.

In: the names of the launched nodes, the ROS master. Out: names.

RViz first loads its displays, which subscribe to their topics and read the robot's description. Then RViz
shows its window. It offers its services last (VisualizerApp::init of RViz 1.14).
"""

from __future__ import annotations

import re
from typing import Iterable, List

from husky_highlevel_controller.xml_rpc import ask

# the name of an RViz node ends like this; an anonymous node also has _HOST_PID_TIME at the end
NAMES = re.compile(r"(rviz|gazebo_gui)(_\w+_\d+_\d+)?$")
SERVICE = "reload_shaders"  # RViz offers this private service only after its window is open


def is_rviz(node: str) -> bool:
    """Return whether a launched node is an RViz, by its name, because roslaunch does not give its program."""
    return NAMES.search(node) is not None


def loading(master_uri: str, caller: str, nodes: Iterable[str]) -> List[str]:
    """Names of the RViz nodes without an open window; `caller` is the full name of the node that asks."""
    services = [(node, f"/{node.lstrip('/')}/{SERVICE}") for node in nodes]
    return [node for node, service in services if not ask(master_uri, "lookupService", caller, service)]
