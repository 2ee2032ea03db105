"""Reader of true poses: what fails in the recorder does not end it; the simulator waits for its answers."""

import json
import socket

import pytest

from husky_grading.drive.truth_feed import READ, TruthFeed

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
