"""A controller without scans says who should publish them, and how to get them."""

import pytest

pytest.importorskip("rospy")

from husky_highlevel_controller.ros.controller import scan_absence
from husky_highlevel_controller.ros.controller.scan_absence import SCAN_TYPE, ScanAbsence
from husky_highlevel_controller.ros.master_graph import Graph

SIMULATED = {"/clock": ["/lab/husky_simulator"]}
REMEDY = "start the simulator with laser_enabled:=true or set HUSKY_LMS1XX_ENABLED=1"


def graph(publishers):
    kinds = {topic: SCAN_TYPE for topic in publishers if topic.endswith("scan")}
    return Graph(publishers, {"/front/scan": ["/controller"]}, {"/front/scan": SCAN_TYPE, **kinds})


@pytest.mark.parametrize(
    ("publishers", "sentence"),
    [
        (SIMULATED, f"no node publishes /front/scan: {REMEDY}"),
        ({**SIMULATED, "/front/scan": ["/husky_simulator"]}, ""),
        (
            {**SIMULATED, "/scan": ["/husky_simulator"]},
            "no node publishes /front/scan: set ~scan_topic_name to /scan",
        ),
        (
            {"/rosout": ["/controller"]},
            "no node publishes /front/scan: start the lidar's driver, or set ~scan_topic_name to its topic",
        ),
    ],
)
def test_the_reason_why_no_scans_come_has_its_remedy(publishers, sentence, monkeypatch):
    monkeypatch.setattr(scan_absence, "read_graph", lambda _: graph(publishers))
    absence = ScanAbsence("/front/scan")
    early = [absence.update(now, None) for now in (0.0, 0.0, 1e9, 1e9 + 4.9)]
    assert not any(early), "time had not begun, and then a node may still start"
    assert absence.update(1e9 + 5.0, None) == sentence
    assert absence.update(1e9 + 6.0, 1e9 + 6.0) == "", "scans have come"
    silent = [absence.update(1e9 + now, 1e9 + 6.0) for now in (11.0, 16.0)]
    assert silent == ["", sentence]
    assert absence.update(1.0, 1e9 + 6.0) == sentence, "the simulator was started again"
