"""Registration of a node: what the answers of a master mean, and what a node does that has lost it."""

import threading
from contextlib import contextmanager
from xmlrpc.server import SimpleXMLRPCServer

import pytest

pytest.importorskip("rospy")

import rospy

from husky_highlevel_controller.ros import registration
from husky_highlevel_controller.ros.registration import LOST, Registration, RegistrationWatch

DEADLINE = 20.0  # [s]
OURS, NAME = "http://robot:4000/", "/walker"


@contextmanager
def master(monkeypatch, answer):
    """A master that answers each question for a node by `answer`, (code, text, value)."""
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        for method in ("lookupNode", "lookupService"):
            server.register_function(answer, method)
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{server.server_address[1]}")
        monkeypatch.setattr(rospy, "get_name", lambda: NAME)
        monkeypatch.setattr(rospy, "get_node_uri", lambda: OURS)
        try:
            yield
        finally:
            server.shutdown()
            thread.join()


@pytest.mark.parametrize(
    ("answer", "known"),
    [
        ((1, "node api", OURS), True),
        ((-1, "unknown node", ""), False),
        ((1, "node api", "http://robot:5000/"), False),  # another node of our name
        ((0, "internal failure", ""), None),
        ("no master at all", None),
    ],
)
def test_only_a_master_that_does_not_know_the_node_means_a_loss(monkeypatch, answer, known):
    with master(monkeypatch, lambda *_: answer):
        node = Registration()
        assert node.look() is known
        assert node.is_lost is (known is False)


def test_a_node_of_which_a_new_master_knows_the_name_alone_is_lost(monkeypatch):
    # rospy's log asks for a parameter, which registers the name of the node at once
    answers = [(1, "node api", OURS), (-1, "no provider", "")]
    with master(monkeypatch, lambda *_: answers.pop(0)):
        assert Registration().look() is False


def test_a_master_that_is_slow_or_gone_means_no_loss(monkeypatch):
    monkeypatch.setattr(registration, "DEADLINE", 0.2)
    release = threading.Event()
    with master(monkeypatch, lambda *_: (release.wait(DEADLINE), (-1, "unknown node", ""))[1]):
        node = Registration()
        assert node.look() is None
        release.set()
    assert node.look() is None, "gone"
    assert not node.is_lost


def test_a_loss_stays_one_whatever_the_master_says_later(monkeypatch):
    answers = [(-1, "unknown node", ""), (1, "node api", OURS), (1, "rosrpc URI", "rosrpc://robot:4001")]
    with master(monkeypatch, lambda *_: answers.pop(0)):
        node = Registration()
        assert [node.look(), node.look()] == [False, True]
        assert node.is_lost, "a subscription that was made later is not all of the node"


def test_a_node_that_is_lost_stands_and_says_so_though_standing_fails(monkeypatch):
    ends, stood, told, sent = threading.Event(), threading.Semaphore(0), [], []

    class Diagnostics:
        def publish(self, array):
            sent.append(array.status[0])

    def stand():
        stood.release()
        raise ValueError("its publisher is closed")

    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: Diagnostics())
    monkeypatch.setattr(rospy, "is_shutdown", ends.is_set)
    monkeypatch.setattr(rospy, "logerr", told.append)
    monkeypatch.setattr(rospy.Time, "now", rospy.Time)
    with master(monkeypatch, lambda *_: (-1, "unknown node", "")):
        RegistrationWatch(stand).start()
        for _ in range(3):
            assert stood.acquire(timeout=DEADLINE)
    ends.set()
    # joined here, because the thread would go on with the true rospy after this test, and log in another test
    (watch,) = (thread for thread in threading.enumerate() if thread.name == "registration")
    watch.join(DEADLINE)
    assert LOST in told
    assert (sent[0].level, sent[0].name, sent[0].message) == (2, "walker", LOST)
