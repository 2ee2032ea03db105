"""Topics that the page listens to while they are shown."""

from unittest.mock import Mock

from husky_web import topics


def test_a_topic_of_two_uses_stays_open_for_the_one_that_is_shown(monkeypatch):
    subscriber = Mock()
    monkeypatch.setattr(topics.rospy, "Subscriber", lambda *_, **__: subscriber)
    listener = topics.Topics({"truth": "/odom", "odometry": "/odom"})
    listener.listen("truth", object, True)
    listener.listen("odometry", object, False)
    assert not subscriber.unregister.called
