"""Findings of the simulator: logged at once, and given to the master when there is something new."""

import pytest

pytest.importorskip("rospy")

from husky_highlevel_controller.ros.simulator import findings
from husky_highlevel_controller.ros.simulator.findings import MAX_FINDINGS, Findings


def test_findings_are_logged_and_given_to_the_master_once_and_the_newest_are_kept(monkeypatch):
    logged, given = [], []
    monkeypatch.setattr(findings.rospy, "logwarn", logged.append)
    monkeypatch.setattr(findings.rospy, "set_param", lambda _, value: given.append(value))
    kept = Findings()
    kept.publish()
    kept.publish()
    assert given == [[]], "those of an earlier simulator are forgotten"
    for number in range(MAX_FINDINGS + 1):
        kept.tell("/drive", f"fault {number}")
    assert len(logged) == MAX_FINDINGS + 1
    kept.publish()
    assert len(given[1]) == MAX_FINDINGS
    assert given[1][-1] == ["/drive", f"fault {MAX_FINDINGS}"]
    kept.publish()
    assert len(given) == 2
