"""A marker in a frame that TF does not know is told once, with the frame that is probably meant."""

from typing import ClassVar

import pytest

pytest.importorskip("rospy")

from visualization_msgs.msg import Marker, MarkerArray

from husky_highlevel_controller.ros.master_graph import Graph
from husky_highlevel_controller.ros.simulator import marker_frames
from husky_highlevel_controller.ros.simulator.marker_frames import MarkerFrames

TOPIC = "/drive/visualization_marker"
FRAMES = {"odom", "base_link", "front_laser"}


class Subscriber:
    """A subscriber that a test feeds."""

    all: ClassVar[list] = []

    def __init__(self, topic, _kind, callback):
        self.topic, self.callback = topic, callback
        self.all.append(self)

    def unregister(self):
        self.all.remove(self)


@pytest.fixture
def watch(monkeypatch):
    monkeypatch.setattr(marker_frames.rospy, "Subscriber", Subscriber)
    monkeypatch.setattr(marker_frames.rospy, "get_name", lambda: "/husky_simulator")
    monkeypatch.setattr(Subscriber, "all", [])
    told = []
    return MarkerFrames(FRAMES, lambda _node, sentence: told.append(sentence)), told


def graph(kind="visualization_msgs/Marker", node="/drive", tf=("/husky_simulator",)):
    return Graph({TOPIC: [node], "/tf": list(tf)}, {}, {TOPIC: kind, "/tf": "tf2_msgs/TFMessage"})


def marker(frame, action=Marker.ADD):
    message = Marker(action=action)
    message.header.frame_id = frame
    message._connection_header = {"callerid": "/drive"}
    return message


def test_a_frame_that_is_not_known_is_told_once_with_the_nearest(watch):
    frames, told = watch
    frames.look(graph())
    (subscriber,) = Subscriber.all
    for frame in ("front_lasr", "front_lasr", "front_laser", "/odom"):
        subscriber.callback(marker(frame))
    (sentence,) = told
    assert sentence.startswith(f"/drive publishes a marker on {TOPIC} in the frame 'front_lasr'")
    assert sentence.endswith("did you mean 'front_laser'?")


def test_an_array_is_looked_at_and_a_marker_that_deletes_is_not(watch):
    frames, told = watch
    frames.look(graph("visualization_msgs/MarkerArray"))
    array = MarkerArray([marker("nowhere", Marker.DELETEALL), marker("base_laser")])
    array._connection_header = {"callerid": "/drive"}
    Subscriber.all[0].callback(array)
    (sentence,) = told
    assert "'base_laser'" in sentence


@pytest.mark.parametrize(
    "seen", [graph(node="/rviz"), graph(kind="std_msgs/String"), graph(tf=["/husky_simulator", "/my_map"])]
)
def test_no_topic_of_tools_and_nothing_beside_other_frames_is_looked_at(seen, watch):
    watch[0].look(seen)
    assert Subscriber.all == []


def test_it_stops_looking_after_some_messages(watch):
    frames, _ = watch
    frames.look(graph())
    for _ in range(marker_frames.MESSAGES):
        Subscriber.all[0].callback(marker("odom"))
    assert Subscriber.all == []
    frames.look(graph())
    assert Subscriber.all == []
