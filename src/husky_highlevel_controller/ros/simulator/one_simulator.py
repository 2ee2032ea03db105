"""Check that no simulator runs on this master yet: a second one would set another time, or end the first.

In: the ROS master. Out: the name of the simulator that runs already, the other publishers of /clock.

A launch file asks while it is read, before any of its nodes starts: they have the names of those that run,
and the master ends the first of each name. Only the standard library, because every launch waits for it.
"""

from __future__ import annotations

import os
import sys
import threading
from typing import Any, Callable, List, Optional
from xmlrpc.client import Error, ServerProxy

from husky_highlevel_controller.xml_rpc import server

NODE = "husky_simulator"
DEADLINE = 5.0  # [s] of wall time for one answer
WATCH_PERIOD = 10.0  # [s] of wall time between two looks at who publishes /clock


def publishers_of_clock(master_uri: str) -> List[str]:
    """Names of the nodes that publish /clock and answer; empty without a master."""
    try:
        with server(master_uri, DEADLINE) as master:
            state: Any = master.getSystemState("/one_simulator")
            published = dict(state[2][0])
            return [name for name in published.get("/clock", ()) if _answers(master, name)]
    except (OSError, Error):
        return []


def _answers(master: ServerProxy, name: str) -> bool:
    """Whether a node that the master knows is still there; one that was killed is not."""
    try:
        answer: Any = master.lookupNode("/one_simulator", name)
        with server(answer[2], DEADLINE) as node:
            node.getPid("/one_simulator")
    except (OSError, Error):
        return False
    return True


def running_simulator(master_uri: str) -> Optional[str]:
    """Name of the simulator that runs on a master; None if there is none."""
    names = publishers_of_clock(master_uri)
    return next((name for name in names if name.rsplit("/", 1)[-1] == NODE), None)


def refusal(name: str, master_uri: str) -> str:
    """Reason why a second simulator does not start, and what to do, in a sentence."""
    return (
        f"{name} simulates already on {master_uri}; end it first, "
        "or give this one a master of its own: ROS_MASTER_URI=http://localhost:11312 roslaunch ..."
    )


def watch_clock(own_name: str, master_uri: str, warn: Callable[[str], None]) -> None:
    """Warn once of each other node that publishes /clock; in a thread, until the process ends."""
    reported = {own_name}

    def look() -> None:
        names = set(publishers_of_clock(master_uri)) - reported
        reported.update(names)
        for name in sorted(names):
            warn(f"{name} publishes /clock too: time will jump; end it, or this simulator")
        start()

    def start() -> None:
        timer = threading.Timer(WATCH_PERIOD, look)
        timer.daemon = True
        timer.start()

    look()


def main() -> None:
    """Exit with 1 and a sentence if a simulator runs on $ROS_MASTER_URI; print 'none' otherwise."""
    master_uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
    graded = "HUSKY_SIMULATOR_IS_OURS" in os.environ  # the running one belongs to who reads the launch file
    name = None if graded else running_simulator(master_uri)
    if name is not None:
        print(refusal(name, master_uri), file=sys.stderr)
        raise SystemExit(1)
    print("none")
