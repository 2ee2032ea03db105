"""A line of the log asks no master, so one that hangs holds up nobody who logs."""

import pytest

pytest.importorskip("rospy")

import rospy
from rospy.impl import paramserver

from husky_highlevel_controller.ros.rosout import PARAMETER, remember_parameter


class Master:
    """Parameter server of rospy's client, as a master without the parameter or with one answers."""

    def __init__(self, value):
        self.value, self.questions = value, 0

    def get_param_cached(self, key):
        try:
            return paramserver.get_param_server_cache().get(key)
        except KeyError:
            self.questions += 1
            paramserver.get_param_server_cache().set(key, self.value)
            if self.value == {}:
                raise
            return self.value


@pytest.fixture
def master_with(monkeypatch):
    def master(value):
        asked = Master(value)
        monkeypatch.setattr(rospy.client, "_param_server", asked)
        return asked

    monkeypatch.setattr(paramserver, "_param_server_cache", paramserver.ParamServerCache())
    return master


def test_without_the_parameter_rospy_asks_for_each_line_and_after_the_call_no_more(master_with):
    master = master_with({})
    for _ in range(3):
        assert rospy.get_param_cached(PARAMETER, False) is False
    assert master.questions == 3, "rospy forgets that nobody has set it"
    remember_parameter()
    for _ in range(3):
        assert rospy.get_param_cached(PARAMETER, True) is False
    assert master.questions == 4


def test_a_parameter_that_is_set_counts_and_may_change(master_with):
    master_with(True)
    remember_parameter()
    assert rospy.get_param_cached(PARAMETER, False) is True
    paramserver.get_param_server_cache().update(PARAMETER, False)  # as rospy does when the master tells it
    assert rospy.get_param_cached(PARAMETER, True) is False
