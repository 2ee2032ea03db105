"""RViz nodes of a launch: known by their names, and by a service when their windows are open."""

import pytest

pytest.importorskip("rospy")

from husky_highlevel_controller.ros.simulator import rviz_windows
from husky_highlevel_controller.ros.simulator.rviz_windows import is_rviz, without_window


def test_an_rviz_loads_until_it_offers_its_services(monkeypatch):
    offered = set()
    monkeypatch.setattr(
        rviz_windows, "ask", lambda _uri, _call, _caller, name: "rosrpc://rviz" if name in offered else None
    )
    nodes = ["husky_rviz", "robot1/rviz"]
    assert without_window("http://master", "/husky_simulator", nodes) == nodes
    offered.add("/husky_rviz/reload_shaders")
    assert without_window("http://master", "/husky_simulator", nodes) == ["robot1/rviz"]
    offered.add("/robot1/rviz/reload_shaders")
    assert without_window("http://master", "/husky_simulator", nodes) == []


def test_an_rviz_is_known_by_its_name():
    assert all(map(is_rviz, ("rviz", "husky_rviz", "robot1/rviz_my_vm_12_345", "gazebo_gui")))
    assert not any(map(is_rviz, ("husky_simulator", "controller", "rviz_markers", "rviz/pillar")))
