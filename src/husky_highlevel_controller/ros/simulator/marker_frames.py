"""Reports markers of other nodes in frames that TF does not have, because RViz does not draw them.

In: the ROS graph, the simulator's frames. Out: a sentence for each unknown frame.
"""

from __future__ import annotations

from difflib import get_close_matches
from functools import partial
from typing import AbstractSet, Any, Callable, Dict, Set, Tuple

import rospy
from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller.ros.master_graph import Graph
from husky_highlevel_controller.ros.simulator.wrong_topics import is_tool

KINDS = {"visualization_msgs/Marker": Marker, "visualization_msgs/MarkerArray": MarkerArray}
FRAME_TOPICS = ("/tf", "/tf_static")
MESSAGES = 50  # number of messages of each topic that are checked; later messages are ignored
# besides the simulator, only this node may publish frames; if any other node does, no markers are checked
ALLOWED_SOURCE = "robot_state_publisher"


class MarkerFrames:
    """Checks the first MESSAGES messages of each topic of markers, and reports unknown frames."""

    def __init__(self, frames: AbstractSet[str], tell: Callable[[str, str], None]) -> None:
        """Set up; `look` finds the topics of markers.

        Args:
            frames: names of all frames that the simulator publishes.
            tell: function that gets a node's name and a sentence; it is called in rospy's threads.
        """
        self._frames, self._tell = frames, tell
        self._subscribers: Dict[str, rospy.Subscriber] = {}  # subscriber of each topic of markers
        # number of messages of each topic that will still be checked
        self._messages_left: Dict[str, int] = {}
        self._reported: Set[Tuple[str, str]] = set()  # node and frame of each marker that was reported

    def look(self, graph: Graph) -> None:
        """Subscribe to new topics of markers, unless another node publishes frames of its own."""
        sources_of_frames = {node for topic in FRAME_TOPICS for node in graph.publishers.get(topic, ())}
        sources_of_frames.discard(rospy.get_name())
        # the frames of any other node are not in `_frames`, so markers in them would cause false alarms
        if any(not node.endswith(ALLOWED_SOURCE) for node in sources_of_frames):
            return
        for topic, nodes in graph.publishers.items():
            kind = KINDS.get(graph.types.get(topic, ""))  # None if the topic has no markers
            # markers of tools (RViz, rqt, rosbag ...) and of the simulator itself are not checked
            has_markers_of_nodes = kind is not None and any(not is_tool(node) for node in nodes)
            if has_markers_of_nodes and topic not in self._subscribers:
                self._messages_left[topic] = MESSAGES
                self._subscribers[topic] = rospy.Subscriber(topic, kind, partial(self._on_markers, topic))

    def _on_markers(self, topic: str, message: Any) -> None:
        """Report markers in unknown frames, and stop listening to a topic after MESSAGES messages."""
        node = message._connection_header["callerid"]
        markers = message.markers if isinstance(message, MarkerArray) else [message]
        for marker in markers:
            frame = marker.header.frame_id.lstrip("/")
            is_drawn = marker.action in (Marker.ADD, Marker.MODIFY)
            if is_drawn and frame not in self._frames and (node, frame) not in self._reported:
                self._reported.add((node, frame))
                self._tell(node, marker_sentence(node, topic, frame, self._frames))
        self._messages_left[topic] -= 1
        if self._messages_left[topic] == 0:
            self._subscribers[topic].unregister()


def marker_sentence(node: str, topic: str, frame: str, frames: AbstractSet[str]) -> str:
    """Return a sentence on a marker in an unknown frame, with the frame that is probably meant.

    Args:
        node: name of the node that publishes the marker.
        topic: topic of the marker.
        frame: frame of the marker.
        frames: names of all frames that TF has.
    """
    nearest = get_close_matches(frame, sorted(frames), n=1, cutoff=0.5)
    remedy = f"did you mean '{nearest[0]}'?" if nearest else "copy the header of the scan"
    return (
        f"{node} publishes a marker on {topic} in the frame '{frame}', which TF does not have, so RViz "
        f"cannot draw it: {remedy}"
    )
