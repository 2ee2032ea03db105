"""Request for a stop: it is repeated until its service answers, and zero is commanded meanwhile."""

import threading

import pytest

pytest.importorskip("rospy")


from husky_highlevel_controller.ros.safety import stop_request
from husky_highlevel_controller.ros.safety.stop_request import StopRequest

DEADLINE = 20.0  # [s]


class Service:
    """A stop request whose service behaves as a list of functions says, one for each call."""

    def __init__(self, *calls):
        self.calls, self.zeros, self.failures = list(calls), threading.Semaphore(0), []
        self.answered, self.ended = threading.Event(), threading.Event()
        self.request = StopRequest(
            lambda: self.calls.pop(0)(),
            self.zeros.release,
            lambda danger, reason: self.failures.append(reason),
            lambda danger: self.answered.set(),
        )
        self.thread = threading.Thread(target=self.request.run, args=(self.ended.is_set,), daemon=True)
        self.thread.start()

    def end(self):
        self.ended.set()
        self.thread.join(DEADLINE)
        assert not self.thread.is_alive()


def test_a_service_that_fails_is_called_again_and_zero_is_commanded_until_it_answers():
    service = Service(lambda: "no such service", lambda: "it answered 'no'", lambda: None)
    service.request.start("a wall")
    assert service.answered.wait(DEADLINE)
    assert service.failures == ["no such service", "it answered 'no'"]
    assert service.zeros.acquire(timeout=DEADLINE)
    service.end()


def test_a_service_that_hangs_is_called_again_and_zero_is_commanded_meanwhile(monkeypatch):
    monkeypatch.setattr(stop_request, "CALL_TIMEOUT", 0.3)
    release = threading.Event()
    service = Service(release.wait, lambda: None)
    service.request.start("a wall")
    for _ in range(3):
        assert service.zeros.acquire(timeout=DEADLINE)
    assert service.answered.wait(DEADLINE)
    assert service.failures == ["it did not answer within 0.3 s"]
    release.set()
    service.end()


def test_a_call_that_hangs_when_the_node_ends_has_not_failed():
    release = threading.Event()
    service = Service(release.wait)
    service.request.start("a wall")
    assert service.zeros.acquire(timeout=DEADLINE)
    service.end()
    assert service.failures == []
    release.set()


def test_calls_that_hang_do_not_pile_up(monkeypatch):
    monkeypatch.setattr(stop_request, "CALL_TIMEOUT", 0.01)
    monkeypatch.setattr(stop_request, "RETRY_PERIOD", 0.01)
    release = threading.Event()
    service = Service(*[release.wait] * 20)
    service.request.start("a wall")
    for _ in range(20):
        assert service.zeros.acquire(timeout=DEADLINE)
    assert len(service.calls) == 20 - stop_request.MAX_HUNG_CALLS
    service.end()
    release.set()


def test_a_call_that_raises_is_a_failure_and_an_error_on_the_way_does_not_end_the_stop():
    service = Service(lambda: {}["gone"], lambda: None, lambda: None)
    service.fails = iter([True, False])

    def on_success(_danger):
        if next(service.fails, False):
            raise ValueError("the log is gone")
        service.answered.set()

    service.request._on_success = on_success
    service.request.start("a wall")
    assert service.answered.wait(DEADLINE), "it is called until all is done"
    assert service.failures == ["KeyError: 'gone'"]
    service.end()
    assert not service.request.pending


def test_a_request_while_one_is_pending_is_the_same_one():
    answer = threading.Event()
    service = Service(lambda: not answer.wait(DEADLINE) or None, lambda: None)
    service.request.start("a wall")
    service.request.start("a wall")
    answer.set()
    assert service.answered.wait(DEADLINE)
    service.end()
    assert len(service.calls) == 1
