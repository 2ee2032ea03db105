"""RViz windows of a launch: finds the RViz nodes whose window is not open yet.

In: names of the launched nodes, the ROS master. Out: names of RViz nodes.

RViz first loads its displays, which subscribe to their topics and read the robot's description. Then RViz
shows its window. It offers its services last (VisualizerApp::init of RViz 1.14).
"""

from __future__ import annotations

import re
from typing import Iterable, List

from husky_highlevel_controller.xml_rpc import ask

# The name of an RViz node ends like this. gazebo_gui is the name of Gazebo's window, in place of which this
# package opens RViz. An anonymous node also has _HOST_PID_TIME at the end.
NAMES = re.compile(r"(rviz|gazebo_gui)(_\w+_\d+_\d+)?$")
SERVICE = "reload_shaders"  # RViz offers this private service only after its window is open


def is_rviz(node: str) -> bool:
    """Return whether the name of a launched node is a usual name of RViz.

    Only the name can be used, because roslaunch does not tell other programs which executable a node runs.
    """
    return NAMES.search(node) is not None


def without_window(master_uri: str, caller: str, nodes: Iterable[str]) -> List[str]:
    """Return the RViz nodes whose window is not open yet; `caller` is the full name of the node that asks."""
    found = []
    for node in nodes:
        service = f"/{node.lstrip('/')}/{SERVICE}"
        # the master has no address of the service as long as RViz has not opened its window
        if not ask(master_uri, "lookupService", caller, service):
            found.append(node)
    return found
