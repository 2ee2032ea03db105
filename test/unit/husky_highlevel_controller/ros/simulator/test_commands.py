"""Who drives the robot: persons before the controller, nobody in an emergency; two that both do are told."""

from functools import partial
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from geometry_msgs.msg import Twist, Vector3
from std_msgs.msg import Bool

from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.ros.simulator import commands
from husky_highlevel_controller.ros.simulator.findings import Findings

DIRECT = "husky_velocity_controller/cmd_vel"  # the output of the Husky's twist_mux


class Network:
    """Commands that nodes send, those that are obeyed, and what is warned of."""

    def __init__(self, monkeypatch):
        self.callbacks, self.passed, self.warnings, self.drops = {}, [], [], False
        self.latched = {}  # last message, by topic
        monkeypatch.setattr(commands.rospy, "Subscriber", self.subscribe)
        monkeypatch.setattr(commands.rospy, "Publisher", self.advertise)
        monkeypatch.setattr(commands.rospy, "logwarn", self.warnings.append)
        monkeypatch.setattr(commands.rospy, "logwarn_throttle", lambda _, text: self.warnings.append(text))
        monkeypatch.setattr(commands.rospy, "get_time", lambda: 0.0)
        lockstep = SimpleNamespace(drops=lambda _: self.drops, command_arrived=lambda *_: None)
        self.commands = commands.Commands(load_robot(), lockstep, lockstep, Findings())

    def advertise(self, topic, _kind, latch=False, **_):
        publish = partial(self.latched.__setitem__, topic) if latch else self.passed.append
        return SimpleNamespace(publish=publish, get_num_connections=lambda: 2)

    def subscribe(self, topic, _kind, callback, **_):
        self.callbacks[topic] = callback

    def send(self, topic="cmd_vel", linear=0.3, sender="/walker", at=0.0):
        """Forward speeds that are obeyed after a command [m/s]."""
        msg = Twist(linear=Vector3(x=linear))
        msg._connection_header = {"callerid": sender}
        self.callbacks[topic](msg)
        return [twist.linear for _, twist in self.commands.take(at)]


@pytest.fixture
def network(monkeypatch):
    return Network(monkeypatch)


def test_a_person_takes_over_from_the_controller_and_hands_back(network):
    assert network.send() == [0.3]
    assert network.send("kb_teleop/cmd_vel", -0.2, at=0.1) == [-0.2]
    assert network.send(at=0.2) == [], "the controller, which goes on commanding, is not heard"
    assert network.send("joy_teleop/cmd_vel", 0.1, at=0.2) == [0.1]
    assert network.send("kb_teleop/cmd_vel", -0.2, at=0.3) == [], "the gamepad comes before the keyboard"
    assert network.send(at=1.0) == [0.3]
    assert [msg.linear.x for msg in network.passed] == [0.3, -0.2, 0.1, 0.3]


def test_an_emergency_stop_locks_all_until_it_is_released(network):
    topics = ("cmd_vel", DIRECT)
    assert [network.send(topic) for topic in topics] == [[0.3], [0.3]]
    assert network.latched["~locked"] == Bool(False)
    network.callbacks["e_stop"](Bool(True))
    assert network.latched["~locked"] == Bool(True), "who comes later is told"
    assert [network.send(topic) for topic in topics] == [[], []]
    network.callbacks["e_stop"](Bool(False))
    assert network.latched["~locked"] == Bool(False)
    assert [network.send(topic) for topic in topics] == [[0.3], [0.3]]


def test_a_simulator_that_its_master_does_not_know_obeys_nobody(network):
    assert network.send() == [0.3]
    network.commands.refuse()
    network.callbacks["e_stop"](Bool(False))
    assert [network.send(topic) for topic in ("cmd_vel", DIRECT, "joy_teleop/cmd_vel")] == [[], [], []]


def test_the_stop_of_a_controller_that_ends_in_lockstep_is_no_warning(network):
    network.drops = True
    assert network.send() == []
    assert network.warnings == []
    assert network.send() == []
    (warning,) = network.warnings
    assert "/walker sends several commands for one scan" in warning


def test_two_that_command_on_one_topic_are_named(network):
    network.send()
    network.send()
    assert network.warnings == []
    network.send(sender="/runner")
    (warning,) = network.warnings
    assert warning.startswith("/cmd_vel: both /walker and /runner send commands")
