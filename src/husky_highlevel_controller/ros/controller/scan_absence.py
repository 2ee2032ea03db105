"""Reason why no scans come, as far as the ROS graph shows it.

In: the ROS graph. Out: a sentence.
"""

from __future__ import annotations

from typing import Optional

import rosgraph

from husky_highlevel_controller.ros.master_graph import SIMULATOR, Graph, read_graph

SCAN_TYPE = "sensor_msgs/LaserScan"
PATIENCE = 5.0  # [s] ROS time without a scan after which the node asks the ROS master for the reason


class ScanAbsence:
    """Asks the master who publishes the scans if none come; must not run in a callback, because it waits."""

    def __init__(self, topic: str) -> None:
        """Ask about the scans on a resolved topic."""
        self._topic = topic
        # [s] ROS time from which the node waits for PATIENCE until it asks the master. At first, this is the
        # time at which it noticed that no scans come, then the time of its last question. None while scans
        # come.
        self._waiting_since: Optional[float] = None
        self._sentence = ""  # reason why no scans come; empty if they come, or if the reason is unknown

    def update(self, now: float, scan_time: Optional[float]) -> str:
        """Return why no scans come; empty if they come, or if a node publishes them.

        The master is asked only when no scan has come for PATIENCE, and then again every PATIENCE, so this
        may be called often.

        Args:
            now: ROS time [s]; 0 before the first message on /clock.
            scan_time: ROS time when the last scan came [s]; None before the first.
        """
        scans_come = scan_time is not None and 0.0 <= now - scan_time < PATIENCE
        if scans_come:  # an earlier reason is forgotten
            self._waiting_since, self._sentence = None, ""
        elif now == 0.0:  # simulated time has not begun, so the wait does not begin either
            self._waiting_since = None
        # The wait begins. If ROS time has gone back, because the simulator was started again, the wait begins
        # again.
        elif self._waiting_since is None or now < self._waiting_since:
            self._waiting_since = now
        elif now - self._waiting_since >= PATIENCE:  # the wait is over, and the next wait begins
            graph = read_graph(rosgraph.get_master_uri())  # None if the master does not answer
            self._waiting_since = now
            self._sentence = absence_sentence(graph, self._topic) if graph else ""
        return self._sentence


def absence_sentence(graph: Graph, topic: str) -> str:
    """Return why no scans come on a topic, with the remedy; empty if a node publishes it."""
    if graph.publishers.get(topic):
        return ""
    other_scans = sorted(
        name
        for name, kind in graph.types.items()
        if kind == SCAN_TYPE and graph.publishers.get(name) and name != topic
    )
    if other_scans:
        return f"no node publishes {topic}: set ~scan_topic_name to {' or '.join(other_scans)}"
    # every node publishes its log, so all nodes are among the publishers
    nodes = {node for names in graph.publishers.values() for node in names}
    if any(node.rsplit("/", 1)[-1] == SIMULATOR for node in nodes):
        # a simulator that runs and publishes no scans was started without a lidar
        remedy = "start the simulator with laser_enabled:=true or set HUSKY_LMS1XX_ENABLED=1"
    else:
        remedy = "start the lidar's driver, or set ~scan_topic_name to its topic"
    return f"no node publishes {topic}: {remedy}"
