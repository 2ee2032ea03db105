"""End of a launch with exit_on_arrival:=true, when no simulator gives the time."""

import pytest

pytest.importorskip("rospy")

import rospy

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.ros.controller import arrival_exit
from husky_highlevel_controller.ros.controller.arrival_exit import ArrivalExit


@pytest.mark.parametrize("begin", [0.0, 1.8e9])
def test_the_deadline_counts_from_the_begin_of_the_run_also_by_the_time_of_day(begin, monkeypatch):
    parameters = {"~": {"deadline": 5.0}, "/use_sim_time": begin == 0.0}
    now = [begin]
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: parameters.get(name, default))
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(rospy, "get_time", lambda: now[0])
    monkeypatch.setattr(arrival_exit.time, "sleep", lambda _: now.__setitem__(0, now[0] + 1.0))
    with pytest.raises(
        HuskyError, match="no arrival within 5 s of simulated time; last: no odometry has come"
    ):
        ArrivalExit().run()
    assert now[0] == begin + 6.0
