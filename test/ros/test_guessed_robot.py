"""Drives of a hand-in that is built here: the robot goes by what it listens to, whatever its files say."""

import shutil

import pytest
from packages import make_package

from husky_grading.mark import mark
from husky_grading.recording import recordings_in
from husky_grading.records import Job, MarkingConfig


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="no valgrind here")
def test_a_node_that_dies_in_the_memory_check_gets_the_scans_that_it_listens_to(tmp_path):
    package = make_package("dies_in_the_check", tmp_path / "ann")
    config = MarkingConfig(robot="auto", deadline=3.0, pace=8.0, trials=1)
    result = mark(Job("ann", str(tmp_path / "out"), config, hand_in=str(package)))
    assert "scans are sent on /laser, the only topic of scans that it subscribes to" in result.notes
    (recording,) = recordings_in(tmp_path / "out")
    assert (recording.scan_topic, recording.subscribed) == ("/laser", True)
    assert recording.driving.any()
    logs = list((tmp_path / "out" / "memcheck").glob("submission/memcheck.*"))
    assert logs, "it was checked"
