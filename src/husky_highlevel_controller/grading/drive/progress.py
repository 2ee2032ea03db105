"""Progress of a process tree: whether one of its threads runs, and its CPU time, from /proc (proc(5))."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Callable, List, Tuple

from husky_highlevel_controller.grading.isolation.process import Process, wait

POLL_PERIOD = 0.1  # [s] of wall time
IDLE, IDLE_BEFORE = 2.0, 12.0  # [s] of wall time without a running thread: once it is up, and before
CPU_LIMIT, WALL_LIMIT = 50.0, 300.0  # [s] of CPU and of wall time for a program that is never idle
_TICKS = os.sysconf("SC_CLK_TCK")
_RUNNING = {"R", "D"}  # running or runnable, waiting for a disk


def settles(process: Process, done: Callable[[], bool], is_up: Callable[[], bool]) -> bool:
    """Wait until a condition holds; False if the program ends, or waits for something else.

    A program that is starved of CPU time is runnable, and so not idle: a busy machine ends no wait.

    `is_up` says whether it has started; some sleep for 10 s before they do anything.
    """
    idle_since = time.monotonic()

    def decided() -> bool:
        nonlocal idle_since
        runs, cpu_seconds = state_of_tree(process.popen.pid)
        now = time.monotonic()
        if runs:
            idle_since = now
        idle = now - idle_since
        idles = idle > IDLE_BEFORE or (idle > IDLE and is_up())
        return done() or not process.running or idles or cpu_seconds > CPU_LIMIT

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
