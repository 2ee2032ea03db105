"""Watch of the ROS graph: it warns once of each wrong topic, and outlives its errors."""

import threading

import pytest

pytest.importorskip("rospy")

from test_wrong_topics import TWIST, graph

from husky_highlevel_controller.ros.simulator import graph as graph_module
from husky_highlevel_controller.ros.simulator.graph import GraphWatch, launched_nodes_of_others

DEADLINE = 20.0  # [s]


def test_the_watch_warns_once_and_five_simulated_seconds_after_the_node_has_joined():
    now, warnings = [100.0], []
    watch = GraphWatch(lambda: now[0], warnings.append)
    wrong = graph(("/walker", "/cmd_vell", TWIST, True))
    for moment, count in ((100.0, 0), (104.9, 0), (105.1, 1), (110.0, 1)):
        now[0] = moment
        watch.look(wrong)
        assert len(warnings) == count
    watch.look(graph())
    watch.look(wrong)
    now[0] = 200.0
    watch.look(wrong)
    assert len(warnings) == 1, "once for each"


def test_the_nodes_of_our_launch_files_are_known_in_any_namespace(monkeypatch):
    nodes = {"husky_simulator", "robot_1/husky_simulator", "robot_1/robot_state_publisher", "robot_1/walker"}
    monkeypatch.setattr(graph_module, "launched_nodes", lambda: nodes)
    assert launched_nodes_of_others() == {"robot_1/walker"}


def test_an_error_of_one_look_does_not_end_the_watch(monkeypatch):
    looks = threading.Semaphore(0)

    class Watch(GraphWatch):
        def look(self, graph):
            looks.release()
            raise KeyError("a topic that has just gone")

    monkeypatch.setattr(graph_module, "PERIOD", 0.01)
    monkeypatch.setattr(graph_module, "read_graph", lambda _: graph())
    Watch(lambda: 0.0, print).start()
    for _ in range(3):
        assert looks.acquire(timeout=DEADLINE)
