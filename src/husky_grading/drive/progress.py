"""Progress of a process tree: its CPU time, and whether one of its threads runs, from /proc (proc(5))."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Callable, List, Tuple

from husky_grading.drive.ros_graph import Registered
from husky_grading.isolation.process import Process, wait

POLL_PERIOD = 0.1  # [s] wall time
LOOK_PERIOD = 0.5  # [s] wall time between two queries of the ROS graph
# [s] a program is idle if none of its threads has run for the wall time IDLE; before it has subscribed to a
# topic, IDLE_BEFORE counts, because some controllers first sleep for 10 s
IDLE, IDLE_BEFORE = 2.0, 12.0
# A program that publishes in a loop is never idle, but it settles. It has settled if both are true since its
# last new registration at the ROS master: its CPU time is above SETTLED_CPU [s], and its CPU time and its
# sleep together are above SETTLED [s]. Both limits are multiplied by NODE_MISSING while one of its nodes has
# not registered at all.
SETTLED, SETTLED_CPU, NODE_MISSING = 5.0, 0.5, 4.0
# [s] a program that is neither idle nor settled is waited for until it has used this CPU time, but at most
# for this wall time
CPU_LIMIT, WALL_LIMIT = 50.0, 300.0
_TICKS = os.sysconf("SC_CLK_TCK")
# indices of three fields of /proc/PID/task/TID/stat, after the program's name: state of the thread, and its
# CPU time in its own code and in the kernel, in units of 1 / _TICKS [s]
_STATE, _USER_TICKS, _SYSTEM_TICKS = 0, 11, 12
_RUNNING = {"R", "D"}  # letters for the state of a thread: R runs or is ready to run, D waits for a disk


def wait_while_active(
    process: Process, node_count: int, condition: Callable[[], bool], read_graph: Callable[[], Registered]
) -> bool:
    """Wait until a condition holds, but only while a program is active; return whether the condition holds.

    `grade` waits in this way for a submission to start. So a slow start on a busy machine costs no points,
    and `grade` does not wait in vain for a submission that will never be ready.

    A program is not active any more if it ends, is idle, or has settled, so that it registers nothing more. A
    program that waits for CPU time is neither idle nor settled, so a busy machine does not end the wait. A
    program that never does one of these is given up after CPU_LIMIT of CPU time, or WALL_LIMIT of wall time.

    Args:
        process: the program.
        node_count: number of the nodes that it starts; if some of them have not registered yet, the wait is
            longer.
        condition: function that returns whether the condition holds.
        read_graph: function that returns the registrations of its nodes.
    """
    activity = _Activity(process, node_count, read_graph)

    def is_wait_over() -> bool:
        """Measure the program, and return whether the wait is over."""
        activity.measure()
        is_quiet = activity.is_idle or activity.has_settled
        return condition() or not process.running or is_quiet or activity.cpu_seconds > CPU_LIMIT

    wait(is_wait_over, WALL_LIMIT, POLL_PERIOD)
    return condition()


class _Activity:
    """Activity of a program: its CPU time, its sleep and its registrations, as of the last `measure`."""

    def __init__(self, process: Process, node_count: int, read_graph: Callable[[], Registered]) -> None:
        self._process = process
        self._node_count = node_count  # number of the nodes that the program starts
        self._read_graph = read_graph  # returns the registrations of the program's nodes
        now = time.monotonic()
        self._measured_at = now  # [s] wall time of the last measurement
        self._ran_at = now  # [s] wall time of the last measurement at which a thread of the program ran
        self._looked_at = now  # [s] wall time of the last query of the ROS graph
        self._registered = Registered()  # registrations at the last query of the ROS graph
        self.cpu_seconds = 0.0  # [s] CPU time that the program has used since its start
        # [s] CPU time that the program had used at the last change of its registrations
        self._cpu_at_change = 0.0
        # [s] wall time in which no thread ran, since the last change of the registrations
        self._slept = 0.0

    def measure(self) -> None:
        """Measure how long the program has computed and slept; every LOOK_PERIOD, query its registrations."""
        runs, self.cpu_seconds = state_of_tree(self._process.popen.pid)
        now = time.monotonic()
        if runs:
            self._ran_at = now
        else:
            self._slept += now - self._measured_at
        self._measured_at = now
        if now - self._looked_at > LOOK_PERIOD:
            self._looked_at = now
            self._query_registrations()

    def _query_registrations(self) -> None:
        """Query the registrations; if they have changed, count CPU time and sleep from 0 again."""
        registered = self._read_graph()
        if registered != self._registered:
            self._registered = registered
            self._slept, self._cpu_at_change = 0.0, self.cpu_seconds

    @property
    def is_idle(self) -> bool:
        """Return whether no thread has run for IDLE seconds, or IDLE_BEFORE if it has not subscribed."""
        idle_seconds = self._measured_at - self._ran_at
        return idle_seconds > (IDLE if self._registered.subscribed else IDLE_BEFORE)

    @property
    def has_settled(self) -> bool:
        """Return whether the program has registered nothing new for long, although it has computed.

        Only CPU time and sleep count, because a program that waits for a CPU on a busy machine may still
        register something. A program that only sleeps has not settled, but it becomes idle.
        """
        if not self._registered.advertised and not self._registered.subscribed:
            return False  # the nodes still start
        is_node_missing = len(self._registered.nodes) < self._node_count
        patience = NODE_MISSING if is_node_missing else 1.0  # factor of both limits
        computed = self.cpu_seconds - self._cpu_at_change  # [s] CPU time since the last change
        return computed > SETTLED_CPU * patience and computed + self._slept > SETTLED * patience


def state_of_tree(root: int) -> Tuple[bool, float]:
    """Return whether a thread of the processes below a process runs, and the CPU time of these processes [s].

    The processes below it are those that it has started, directly or indirectly.
    """
    runs, ticks = False, 0
    waiting = _children(root)  # the root itself is reaper.py, a program of ours, so it does not count
    while waiting:
        pid = waiting.pop()
        for thread in _threads(pid):
            # the fields come after the program's name, which is in brackets and may contain brackets
            fields = _read(thread / "stat").rpartition(")")[2].split()
            if fields:  # otherwise the thread has ended
                runs |= fields[_STATE] in _RUNNING
                ticks += int(fields[_USER_TICKS]) + int(fields[_SYSTEM_TICKS])
        waiting += _children(pid)
    return runs, ticks / _TICKS


def _children(pid: int) -> List[int]:
    """Return the ids of the processes that a process, by any of its threads, has started."""
    children: List[int] = []
    for thread in _threads(pid):
        children += map(int, _read(thread / "children").split())
    return children


def _threads(pid: int) -> List[Path]:
    """Return the folders in /proc of the threads of a process; none if the process has ended."""
    try:
        return list(Path(f"/proc/{pid}/task").iterdir())
    except OSError:
        return []


def _read(path: Path) -> str:
    """Return the text of a file in /proc; empty if its process or thread has ended."""
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
