"""Reader of true poses: what fails in the recorder does not end it; the simulator waits for its answers."""

import json
import socket

import pytest
import rospy

from husky_grading.drive.truth_feed import READ, TruthFeed
from husky_highlevel_controller.ros.simulator.truth_log import VARIABLE, TruthLog

ROW = {"truth": (0.02, 1.0, 2.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.3, -0.2)}


@pytest.mark.parametrize("error", [ValueError("odd"), ZeroDivisionError("odd")])
def test_an_error_of_the_recorder_is_kept_and_each_state_is_answered_all_the_same(error, tmp_path):
    rows, events = [], []

    def on_truth(state):
        rows.append(state)
        if len(rows) == 1:
            raise error

    feed = TruthFeed(tmp_path / "truth", on_truth, lambda *event: events.append(event))
    with socket.socket(socket.AF_UNIX) as simulator:
        simulator.settimeout(20.0)
        simulator.connect(str(tmp_path / "truth"))
        assert feed.failure is None
        for _ in range(2):
            for line in (ROW, {"changed": "moved"}):
                simulator.sendall((json.dumps(line) + "\n").encode())
            assert simulator.recv(1) == READ
    assert len(rows) == 2
    assert feed.failure is error


def test_each_state_is_answered_once_it_is_read(tmp_path):
    rows, events = [], []
    TruthFeed(tmp_path / "truth", rows.append, lambda *event: events.append(event))
    with socket.socket(socket.AF_UNIX) as simulator:
        simulator.settimeout(20.0)
        simulator.connect(str(tmp_path / "truth"))
        for stamp in (0.02, 0.04):
            for broken in (b"{]\n", b"[1]\n", b'{"trith": [1]}{\n'):
                simulator.sendall(broken)
            numbers = (stamp, 1.0, 2.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.3, -0.2)
            for line in ({"changed": "moved"}, {"truth": numbers}):
                simulator.sendall((json.dumps(line) + "\n").encode())
            assert simulator.recv(10) == READ
            row = rows[-1]
            assert (row.stamp, row.pose_in_world.position) == (stamp, (1.0, 2.0, 0.1))
            assert (row.speed, row.yaw_rate, row.to_numbers()) == (0.3, -0.2, numbers)
    assert events == [("changed", "moved")] * 2


def test_the_simulator_answers_calls_until_the_recorder_lets_time_begin(tmp_path, monkeypatch):
    feed = TruthFeed(tmp_path / "truth", lambda state: None, lambda *event: None)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "truth"))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: len(calls) == 500)
    log, calls = TruthLog(), []
    log.wait_to_begin(lambda: calls.append(1) or (len(calls) == 3 and feed.begin()))
    assert 3 <= len(calls) < 500
    assert log.is_open
    log._socket.close()
