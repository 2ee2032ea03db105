"""Which Husky a submission is written for: what it subscribes to, started beside a ROS master alone, decides.

In: a submission. Out: "noetic" (scans on /front/scan) or "melodic" (on /scan), and why.
Must not know: points.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Tuple
from xmlrpc.client import Error as XmlRpcError
from xmlrpc.client import ServerProxy

from husky_highlevel_controller.grading.drive.run import SCAN_TOPICS, Submission, starter
from husky_highlevel_controller.grading.isolation.process import wait
from husky_highlevel_controller.grading.isolation.ros_network import Network

SUBSCRIBE_DEADLINE = (
    90.0  # [s] of wall time; some sleep for 10 s before they subscribe, some machines are busy
)
POLL_PERIOD = 0.2  # [s]
DEFAULT = "noetic"
CALLER = "/marking"


def detect_husky(submission: Submission, folder: Path) -> Tuple[str, str]:
    """The Husky, and a sentence that says why it is this one.

    Args:
        submission: what to start.
        folder: for logs.

    Raises:
        MarkingError: no ROS master can be started.
    """
    with Network(folder) as network:
        events = network.folder_of("submission") / "events.jsonl"
        events.write_text("")
        with ServerProxy(network.uri) as master:
            master.setParam(CALLER, "/run_id", "husky")  # roslaunch waits for it
        process = network.start("submission", starter(events, "run", submission), submission.workspace)

        def found() -> str:
            topics = _subscribed(network.uri)
            return next((husky for husky, topic in SCAN_TOPICS.items() if topic in topics), "")

        wait(lambda: bool(found()) or not process.running, SUBSCRIBE_DEADLINE, POLL_PERIOD)
        husky = found()
    if husky:
        return husky, f"--husky {husky}: it subscribes to {SCAN_TOPICS[husky]}"
    topics = " nor to ".join(SCAN_TOPICS.values())
    return DEFAULT, f"--husky {DEFAULT}: it subscribes neither to {topics}"


def _subscribed(uri: str) -> Tuple[str, ...]:
    """Topics that any node subscribes to."""
    try:
        with ServerProxy(uri) as master:
            answer: Any = master.getSystemState(CALLER)
        return tuple(topic for topic, nodes in answer[2][1] if nodes)
    except (OSError, XmlRpcError, ValueError):
        return ()
