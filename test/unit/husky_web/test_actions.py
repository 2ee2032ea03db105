"""Buttons of the page: an error or a service that hangs ends none of the others."""

import queue
import threading

from husky_web import actions


def action_results(monkeypatch, *works):
    """What the page is told of calls, in order."""
    told: queue.Queue = queue.Queue()
    monkeypatch.setattr(actions.rospy, "logwarn", lambda _: None)
    monkeypatch.setattr(actions, "notify", lambda _client, _title, text, good: told.put((text, good)))
    queued = actions.Actions()
    for work in works:
        queued.do(work, object(), "a button")
    return [told.get(timeout=20.0) for _ in works]


def test_an_unexpected_error_of_one_button_leaves_the_others_alive(monkeypatch):
    def fails():
        raise KeyError("gone")

    assert action_results(monkeypatch, fails, lambda: "done") == [("KeyError: 'gone'", False), ("done", True)]


def test_a_service_that_hangs_is_given_up_with_a_sentence(monkeypatch):
    release = threading.Event()
    monkeypatch.setattr(actions, "CALL_TIMEOUT", 0.2)
    monkeypatch.setattr(actions.rospy, "ServiceProxy", lambda *_: lambda *_: release.wait(20.0))
    results = action_results(monkeypatch, lambda: actions.call("/reset", None), lambda: "done")
    assert results == [("/reset has not answered for 0.2 s; it may still act", False), ("done", True)]
    release.set()
