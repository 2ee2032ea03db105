"""Causes of a robot that does not obey: inputs of higher priority count only if something is sent there."""

import pytest

pytest.importorskip("rospy")

import rospy
from geometry_msgs.msg import Twist

from husky_highlevel_controller.ros.controller import disobedience
from husky_highlevel_controller.ros.controller.disobedience import first_that_speaks

JOYSTICK, GUARD = "/joy_teleop/cmd_vel", "/twist_marker_server/cmd_vel"


@pytest.mark.parametrize(("speaking", "first"), [([], ""), ([GUARD], GUARD), ([GUARD, JOYSTICK], JOYSTICK)])
def test_an_input_that_is_only_advertised_does_not_hold_the_robot(monkeypatch, speaking, first):
    open_topics = []

    class Subscriber:
        def __init__(self, topic, _kind, callback, queue_size):
            self.topic = topic
            open_topics.append(topic)
            if topic in speaking:
                callback(Twist())

        def unregister(self):
            open_topics.remove(self.topic)

    monkeypatch.setattr(rospy, "Subscriber", Subscriber)
    monkeypatch.setattr(disobedience, "LISTENING_TIME", 0.05)
    assert first_that_speaks([JOYSTICK, GUARD]) == first
    assert not open_topics
