"""Partners of the simulator: the nodes that must have joined before time begins.

In: the topics they share with the simulator, the ROS master. Out: whether they are there.
"""

from __future__ import annotations

from typing import Callable, Sequence, Set

import rosgraph
import rospy

from husky_highlevel_controller.xml_rpc import ask

# roslaunch's own processes, and the nodes of simulator.launch: none of them drives the robot
NODES = {"master", "rosout", "husky_simulator", "robot_state_publisher", "rviz", "husky_rviz", "husky_web"}


class Partners:
    """Nodes that listen to scans and send commands, and nodes that listen besides."""

    def __init__(
        self,
        scans: rospy.Publisher,
        others: Sequence[rospy.Publisher],
        command_topics: str,
        has_sender: Callable[[], bool],
    ) -> None:
        """The scans need a subscriber, and one of the command topics a sender.

        All nodes subscribed to the scans or to the `others` must be connected too: a transform that is lost
        at the beginning would make the run another one.
        """
        self._scans, self._others = scans, others
        self.command_topics, self._has_sender = command_topics, has_sender
        self.scan_topic = scans.resolved_name

    def joined(self) -> bool:
        """Whether all are connected."""
        if not self._has_sender() or not self._scans.get_num_connections():
            return False
        state = ask(rosgraph.get_master_uri(), "getSystemState", rospy.get_name())
        subscribed = {topic: len(nodes) for topic, nodes in state[1]} if state else {}
        return bool(state) and all(
            publisher.get_num_connections() >= subscribed.get(publisher.resolved_name, 0)
            for publisher in (self._scans, *self._others)
        )


def launched_beside() -> Set[str]:
    """Names of the nodes, besides the simulator's own, that a roslaunch on this master has started."""
    names: Set[str] = set()
    for uri in rospy.get_param("/roslaunch/uris", {}).values():
        processes = ask(uri, "list_processes")  # None: it has ended
        # "NODE-COUNT" of each process that lives, and how often it was started
        names.update(name.rsplit("-", 1)[0] for name, _ in (processes or [[]])[0])
    return names - NODES
