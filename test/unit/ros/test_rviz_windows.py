"""What an RViz has still to do before it draws, by its configuration and its subscriptions."""

import os

import pytest

pytest.importorskip("rospy")

import yaml

from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros.simulator import rviz_windows
from husky_highlevel_controller.ros.simulator.rviz_windows import (
    is_rviz,
    missing_topics,
    topics_of_displays,
)

OUR_TOPICS = {
    "husky_simulator/world/update",
    "front/scan",
    "husky_highlevel_controller/visualization_marker",
    "husky_highlevel_controller/visualization_marker_array",
    "odometry/filtered",
}


def test_topics_are_those_of_displays_that_are_switched_on_also_in_groups():
    ours = yaml.safe_load((share_folder() / "rviz" / "controller.rviz").read_text())
    assert set(topics_of_displays(ours["Visualization Manager"]["Displays"])) == OUR_TOPICS
    displays = [
        {"Class": "rviz/Grid"},
        {"Class": "rviz/LaserScan", "Enabled": False, "Topic": "off"},
        {"Class": "rviz/Group", "Displays": [{"Class": "rviz/Map", "Topic": "map"}, "no display"]},
        {"Class": "rviz/Group", "Enabled": False, "Displays": [{"Class": "rviz/Path", "Topic": "path"}]},
        {"Class": "rviz/Image", "Topic": ""},
        {"Class": "rviz/Marker", "Marker Topic": 5},
    ]
    assert list(topics_of_displays(displays)) == ["map"]
    assert list(topics_of_displays("no list")) == []


class Process:
    """An RViz with its command line, and its answers to the ROS API."""

    def __init__(self, monkeypatch, folder, command):
        self.subscribed = None
        (folder / "42").mkdir()
        (folder / "42" / "cmdline").write_bytes(b"\0".join(os.fsencode(word) for word in command) + b"\0")
        (folder / "42" / "cwd").symlink_to(folder)
        monkeypatch.setattr(rviz_windows, "ask", self.answer)
        monkeypatch.setattr(rviz_windows, "PROCESSES", folder)
        rviz_windows._topics_of_process.cache_clear()

    def answer(self, uri, method, *arguments):
        if self.subscribed is None:
            return None
        if method == "getSubscriptions":
            return [[topic, "any"] for topic in self.subscribed]
        return {"lookupNode": "http://rviz:1", "getPid": 42}[method]

    @property
    def missing(self):
        return missing_topics("http://master:11311", "/husky_simulator", ["robot1/husky_rviz"])


def test_it_is_waited_for_until_it_has_subscribed_to_what_its_file_names(monkeypatch, tmp_path):
    displays = [{"Topic": "front/scan"}, {"Topic": "/map"}]
    content = {"Visualization Manager": {"Displays": displays}}
    (tmp_path / "view.rviz").write_text(yaml.safe_dump(content))
    command = ["/opt/rviz", "-d", "view.rviz", "front/scan:=scan", "__name:=husky_rviz"]
    process = Process(monkeypatch, tmp_path, command)
    assert process.missing == {"/robot1/husky_rviz": ["/tf"]}, "it has not started"
    process.subscribed = {"/tf", "/robot1/front/scan"}
    assert process.missing == {"/robot1/husky_rviz": ["/map", "/robot1/scan"]}
    process.subscribed |= {"/map", "/robot1/scan"}
    assert process.missing == {}


@pytest.mark.parametrize("content", ["{", "[]", "Visualization Manager: 5", None])
def test_one_without_a_readable_file_is_waited_for_until_it_listens_to_tf(monkeypatch, tmp_path, content):
    if content is not None:
        (tmp_path / "view.rviz").write_text(content)
    process = Process(monkeypatch, tmp_path, ["rviz", "--display-config", "view.rviz"])
    process.subscribed = set()
    assert process.missing == {"/robot1/husky_rviz": ["/tf"]}
    process.subscribed = {"/tf"}
    assert process.missing == {}


def test_an_rviz_is_known_by_its_name():
    assert all(map(is_rviz, ("rviz", "husky_rviz", "robot1/rviz_vm_12_345", "gazebo_gui")))
    assert not any(map(is_rviz, ("husky_simulator", "controller", "spawn_husky")))
