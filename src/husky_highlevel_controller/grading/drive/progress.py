"""Progress of a process tree: whether one of its threads runs, and its CPU time, from /proc (proc(5))."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Callable, List, Tuple

from husky_highlevel_controller.grading.drive.ros_graph import Registered
from husky_highlevel_controller.grading.isolation.process import Process, wait

POLL_PERIOD = 0.1  # [s] of wall time
LOOK_PERIOD = 0.5  # [s] of wall time between two looks at the ROS graph
IDLE, IDLE_BEFORE = 2.0, 12.0  # [s] of wall time without a running thread: once it listens, and before
# [s] of wall and of CPU time since the last registration of a program that is never idle, such as one that
# publishes in a loop; so much longer where a node has not registered, which may have ended
SETTLED, SETTLED_CPU, NODE_MISSING = 5.0, 3.0, 4.0
CPU_LIMIT, WALL_LIMIT = 50.0, 300.0  # [s] of CPU and of wall time for a program that is never idle
_TICKS = os.sysconf("SC_CLK_TCK")
_RUNNING = {"R", "D"}  # running or runnable, waiting for a disk


def settles(process: Process, nodes: int, done: Callable[[], bool], graph: Callable[[], Registered]) -> bool:
    """Wait until a condition holds; False if the program ends, waits for something else, or has settled.

    A program that is starved of CPU time is runnable, and so not idle, and does not settle: a busy machine
    ends no wait. One that has registered something and then works on without any further registration for
    SETTLED and SETTLED_CPU has settled: what it has not registered by then does not come.

    Args:
        process: the program.
        nodes: number of the nodes that it starts.
        done: the condition.
        graph: gives what its nodes have registered; some sleep for 10 s before they do anything.
    """
    idle_since = looked_at = changed_at = time.monotonic()
    seen, cpu_at_change = Registered(), 0.0

    def decided() -> bool:
        nonlocal idle_since, looked_at, changed_at, seen, cpu_at_change
        runs, cpu_seconds = state_of_tree(process.popen.pid)
        now = time.monotonic()
        if runs:
            idle_since = now
        if now - looked_at > LOOK_PERIOD:
            looked_at, before, seen = now, seen, graph()
            if seen != before:
                changed_at, cpu_at_change = now, cpu_seconds
        idle = now - idle_since
        idles = idle > IDLE_BEFORE or (idle > IDLE and bool(seen.subscribed))
        patience = 1.0 if len(seen.nodes) >= nodes else NODE_MISSING
        settled = (
            bool(seen.advertised or seen.subscribed)
            and now - changed_at > SETTLED * patience
            and cpu_seconds - cpu_at_change > SETTLED_CPU * patience
        )
        return done() or not process.running or idles or settled or cpu_seconds > CPU_LIMIT

    wait(decided, WALL_LIMIT, POLL_PERIOD)
    return done()


def state_of_tree(root: int) -> Tuple[bool, float]:
    """Whether a thread below a process runs, and the CPU time [s] of all that is below it."""
    runs, ticks = False, 0
    waiting = _children(root)
    while waiting:
        pid = waiting.pop()
        for task in _tasks(pid):
            fields = _read(task / "stat").rpartition(")")[2].split()
            if fields:
                runs |= fields[0] in _RUNNING
                ticks += int(fields[11]) + int(fields[12])
        waiting += _children(pid)
    return runs, ticks / _TICKS


def _children(pid: int) -> List[int]:
    return [int(child) for task in _tasks(pid) for child in _read(task / "children").split()]


def _tasks(pid: int) -> List[Path]:
    try:
        return list(Path(f"/proc/{pid}/task").iterdir())
    except OSError:  # it has ended
        return []


def _read(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
