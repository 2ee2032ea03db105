"""Watch over the ROS graph: warns once of each wrong topic, and of each other node that publishes /clock."""

from __future__ import annotations

import threading
from typing import Callable, Dict, Set

import rosgraph
import rospy

from husky_highlevel_controller.ros.simulator.one_simulator import clock_publishers
from husky_highlevel_controller.ros.simulator.wrong_topics import (
    Graph,
    WrongTopic,
    read_graph,
    sentence,
    wrong_topics,
)

PERIOD = 2.5  # [s] of wall time between two looks
JOINING_TIME = 5.0  # [s] of simulated time that a topic may lack its other side


class GraphWatch:
    """Looks at the graph in a thread of its own until the process ends."""

    def __init__(self, simulated_time: Callable[[], float], warn: Callable[[str], None]) -> None:
        """Set up; `simulated_time` [s] and `warn` are called in the thread."""
        self._simulated_time, self._warn = simulated_time, warn
        self._master_uri = rosgraph.get_master_uri()
        self._clock_nodes = {rospy.get_name()}
        self._first_times: Dict[WrongTopic, float] = {}  # [s] of simulated time
        self._warnings: Set[WrongTopic] = set()

    def start(self) -> None:
        """Look now, and every PERIOD."""
        graph = read_graph(self._master_uri)
        if graph is not None:
            self.look(graph)
        timer = threading.Timer(PERIOD, self.start)
        timer.daemon = True
        timer.start()

    def look(self, graph: Graph) -> None:
        """Warn of what is new in a graph."""
        if set(graph.publishers.get("/clock", ())) - self._clock_nodes:
            names = set(clock_publishers(self._master_uri, graph.publishers)) - self._clock_nodes
            self._clock_nodes |= names
            for name in sorted(names):
                self._warn(f"{name} publishes /clock too: time will jump; end it, or this simulator")
        now = self._simulated_time()
        self._first_times = {finding: self._first_times.get(finding, now) for finding in wrong_topics(graph)}
        for finding, first_time in self._first_times.items():
            if now - first_time >= JOINING_TIME and finding not in self._warnings:
                self._warnings.add(finding)
                self._warn(sentence(finding))
