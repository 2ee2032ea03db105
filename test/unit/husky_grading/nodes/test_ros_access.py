"""Access to a drive's network: services are asked for and called beside threads, whatever they answer."""

import time
from xmlrpc.client import Fault

import pytest
import rospy
import rosservice

from husky_grading.nodes.ros_access import MAX_SERVICES, DriveAccess

SET_BOOL = "std_srvs/SetBool"


@pytest.fixture
def access():
    return DriveAccess({"/ours"}, None)


def until(condition):
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize("error", [ValueError("odd"), RuntimeError("odd"), rosservice.ROSServiceException()])
def test_a_service_whose_type_cannot_be_read_is_asked_again(access, error, monkeypatch):
    asked = []

    def type_of(name):
        asked.append(name)
        if len(asked) < 3:
            raise error
        return SET_BOOL

    monkeypatch.setattr(rosservice, "get_service_type", type_of)
    until(lambda: access.service_types(["/go"]) == {"/go": SET_BOOL})
    assert len(asked) == 3


@pytest.mark.parametrize("error", [ValueError("odd"), KeyError("odd"), rospy.ServiceException("odd")])
def test_a_call_that_fails_in_whatever_way_is_answered_by_what_went_wrong(access, error, monkeypatch):
    def fail(_):
        raise error

    monkeypatch.setattr(rospy, "ServiceProxy", lambda *_: fail)
    access.call("/go", True)
    until(access.answer)
    success, text, is_error = access.answer()
    assert not success
    assert is_error
    assert "odd" in text


def test_services_that_come_with_ros_and_tf2_are_not_the_submissions(access, monkeypatch):
    asked = []
    monkeypatch.setattr(rosservice, "get_service_type", lambda name: asked.append(name) or SET_BOOL)
    names = [f"/n/{name}" for name in ("get_loggers", "set_logger_level", "set_parameters", "tf2_frames")]
    until(lambda: access.service_types([*names, "/go"]) == {"/go": SET_BOOL})
    assert asked == ["/go"]


def test_a_submission_with_many_services_costs_a_bounded_number_of_threads(access, monkeypatch):
    monkeypatch.setattr(rosservice, "get_service_type", lambda name: SET_BOOL)
    names = [f"/s{number}" for number in range(MAX_SERVICES + 20)]
    until(lambda: len(access.service_types(names)) == MAX_SERVICES)
    assert len(access.service_types(names)) == MAX_SERVICES


def test_a_parameter_that_the_master_cannot_send_ends_no_recording(access, monkeypatch):
    def get_param(name, _):
        raise Fault(1, "int exceeds XML-RPC limits")

    monkeypatch.setattr(rospy, "get_param_names", lambda: ["/big", "/robot_description"])
    monkeypatch.setattr(rospy, "get_param", get_param)
    assert access.parameters() == {}
    assert access.descriptions({"base_link"}) == ()


def test_parameters_of_marking_s_own_nodes_are_not_the_submission_s(access, monkeypatch):
    monkeypatch.setattr(rospy, "get_param_names", lambda: ["/ours/topic", "/n/topic"])
    monkeypatch.setattr(rospy, "get_param", lambda name, _: name)
    assert access.parameters() == {"/n/topic": "/n/topic"}
