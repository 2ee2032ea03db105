"""Driver of exercise 5 in marking: services are found and called beside threads that ask for their types."""

import time

import pytest
import rospy
import rosservice

from husky_grading.drive.call_plan import SERVICE
from husky_grading.nodes.exercise_driver import MAX_SERVICES, ExerciseDriver

SET_BOOL = "std_srvs/SetBool"


@pytest.fixture
def driver():
    return ExerciseDriver(SERVICE, "/front/scan", {"/ours"})


def until(condition):
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_service_that_is_found_while_one_is_chosen_ends_nothing(driver, monkeypatch):
    class Name(str):
        """Compares as slowly as that another service is found meanwhile."""

        def __lt__(self, other):
            driver._probe(f"/later_{len(driver.services)}")
            return str(self) < str(other)

    monkeypatch.setattr(rosservice, "get_service_type", lambda name: SET_BOOL)
    monkeypatch.setattr(rospy, "ServiceProxy", lambda *_: lambda data: None)
    for name in ("/b", "/a", "/c"):
        driver._probe(Name(name))
    driver.work(8.0, 0.5)
    until(lambda: driver.work(8.1, 0.5) is None and driver.calls)
    assert not driver.calls[0].success


def test_a_submission_that_a_call_has_stopped_may_be_silent_and_no_other(driver, monkeypatch):
    monkeypatch.setattr(rospy, "ServiceProxy", lambda *_: lambda data: None)
    assert not driver.has_silenced(7.9), "no call yet"
    monkeypatch.setattr(rosservice, "get_service_type", lambda name: SET_BOOL)
    driver._probe("/go")
    driver.work(8.0, 0.5)
    assert driver.has_silenced(8.1), "also while the call is on its way"
    until(lambda: driver.work(8.1, 0.5) is None and driver.calls)
    assert driver.has_silenced(8.1)
    assert not driver.has_silenced(9.0), "it has sent a command since"


@pytest.mark.parametrize("error", [ValueError("odd"), RuntimeError("odd"), rosservice.ROSServiceException()])
def test_a_service_whose_type_cannot_be_read_is_asked_again(driver, error, monkeypatch):
    asked = []

    def type_of(name):
        asked.append(name)
        if len(asked) < 3:
            raise error
        return SET_BOOL

    monkeypatch.setattr(rosservice, "get_service_type", type_of)
    until(lambda: driver.look([("/go", ["/node"])]) is None and driver.services)
    assert driver.services == {"/go"}
    assert len(asked) == 3


@pytest.mark.parametrize("error", [ValueError("odd"), KeyError("odd"), rospy.ServiceException("odd")])
def test_a_call_that_fails_in_whatever_way_is_answered_by_what_went_wrong(driver, error, monkeypatch):
    def fail(_):
        raise error

    monkeypatch.setattr(rosservice, "get_service_type", lambda name: SET_BOOL)
    monkeypatch.setattr(rospy, "ServiceProxy", lambda *_: fail)
    monkeypatch.setattr(rosservice, "get_service_type", lambda name: SET_BOOL)
    driver._probe("/go")
    driver.work(8.0, 0.5)
    until(lambda: driver.work(8.1, 0.5) is None and driver.calls)
    (call,) = driver.calls
    assert (call.success, call.answered_at) == (False, 8.1)
    assert "odd" in call.answer


def test_a_submission_with_many_services_costs_a_bounded_number_of_threads(driver, monkeypatch):
    monkeypatch.setattr(rosservice, "get_service_type", lambda name: SET_BOOL)
    services = [(f"/s{number}", ["/node"]) for number in range(MAX_SERVICES + 20)]
    driver.look(services)
    until(lambda: len(driver.services) == MAX_SERVICES)
    driver.look(services)
    assert len(driver.services) == MAX_SERVICES
