"""Detects from /proc whether all subscribers of a topic are idle: none of their threads runs.

`Lockstep` needs this. A node that waits for simulated time (ros::Rate, ros::Duration::sleep, rospy.sleep)
answers nothing until the clock advances, so the simulator must not wait for it. A node that computes also
sends no messages, but the simulator must wait for it. One of its threads runs.

When a message is sent, the kernel marks the thread that waits for it as running at once. So a node with a new
message does not look idle. The number of unread messages would not show whether a node is idle, because
rospy reads none during a callback, and the callback may sleep.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Set, Tuple

import rospy

# [s] wall time of the long check (see `Listeners.asleep`): a process counts as asleep if no look in this time
# finds a running thread. A sleeping roscpp node checks the clock every 1 ms, but a busy computer may wake the
# node later. With 3 ms, at a load average of 11, two of three equal runs of such a node gave different
# results.
ASLEEP_FOR = 0.008
LOOK_PERIOD = 0.002  # [s] wall time between two checks whether the processes sleep
STAT = "stat"  # file of a thread in /proc with the state of the thread
# true if the kernel counts the turns of each thread: how often it has let the thread run on a CPU
COUNTS_TURNS = os.path.exists("/proc/self/schedstat")
# file of a thread in /proc with its turns; if the kernel does not count turns, STAT is read in its place, and
# no turns are compared
SCHEDULE = "schedstat" if COUNTS_TURNS else STAT
READ_SIZE = 512  # [bytes] length of the part of each file that is read; it includes the state of the thread
# largest number of threads of a process that are checked; their files stay open, because opening files takes
# most of the time of a check
MAX_THREADS = 200
# states of a thread that works: R is on a CPU or waits for a CPU, D waits for a disk
RUNNING_STATES = {b"R", b"D"}

Ports = Tuple[int, int]  # TCP ports of a connection: port of the subscriber, port of this process
# Turns of a process: for each thread, the text of its file SCHEDULE. If the text is the same at two looks,
# the thread has not run between them.
Turns = Dict[str, bytes]
# Result of one look at all listeners: the turns of each process, by the id of the process. If a thread of the
# process runs, None is in place of its turns.
Look = Dict[int, Optional[Turns]]


class Listeners:
    """The processes on this machine that subscribe to a publisher's topic or to /clock."""

    def __init__(self, publisher: Optional[rospy.Publisher], clock: rospy.Publisher) -> None:
        """Set up without any process; `asleep` finds the processes.

        Args:
            publisher: publisher of the topic; None if the topic is not published.
            clock: publisher of /clock.
        """
        self._publisher, self._clock = publisher, clock
        # ports of the connections to all subscribers of the topic or of /clock
        self._ports: Set[Ports] = set()
        # threads of this process; a thread that runs may be about to send a message to the listeners
        self._own_threads = _Threads(os.getpid())
        # threads of each process that receives the topic of `publisher` or the clock, by the id of this
        # process
        self._processes: Dict[int, _Threads] = {}
        self._topic_receivers: Set[int] = set()  # ids of the processes that receive the topic of `publisher`
        self._clock_receivers: Set[int] = set()  # ids of the processes that receive the clock
        # true if all processes that receive the topic are on this machine, where they can be seen
        self._sees_all_receivers = False
        # True if the short check (see `asleep`) is possible. It needs the turns of each thread: how often the
        # kernel has let the thread run. It also needs nodes in Python only, because their turns do not change
        # while they wait. A node in C++ wakes every millisecond, so its turns change also while it waits.
        self._can_check_turns = False
        # the look at which all processes were last found asleep; if the turns of a process are now different,
        # the process has run since then
        self._idle_look: Look = {}

    def asleep(self) -> bool:
        """Return whether all listeners are asleep, and stay so until a message is sent.

        The call looks at all threads again and again. The result is false if a look finds that a receiver of
        the topic runs, or that another thread of this process runs. The result is true when one of two checks
        is passed:

        - The short check compares two looks, and is only possible for nodes in Python.
        - The long check is for nodes in any language: during ASLEEP_FOR, all looks found that the receivers
          of the topic do not run.

        If a receiver of the topic is on another machine, where it cannot be seen, the result is false.
        """
        self._find_processes()
        if not self._sees_all_receivers:
            return False
        end = time.monotonic() + ASLEEP_FOR
        last_look: Optional[Look] = None  # None before the first look
        while True:
            look = self._look_if_receivers_wait()
            if look is None:
                return False
            passes_long_check = time.monotonic() >= end
            if passes_long_check or self._passes_short_check(last_look, look):
                self._idle_look = look
                return True
            # the short check needs a second look, so this look follows the first one at once
            is_second_look_next = last_look is None and self._can_check_turns
            if not is_second_look_next:
                time.sleep(LOOK_PERIOD)
            last_look = look

    def _look_if_receivers_wait(self) -> Optional[Look]:
        """Look at all threads; None if a receiver of the topic, or another thread of this process, runs.

        A thread of this process may be about to send a message to a receiver. A process that receives only
        the clock may run.
        """
        if self._own_threads.turns() is None:
            return None
        look = {process: threads.turns() for process, threads in self._processes.items()}
        if any(look[process] is None for process in self._topic_receivers):
            return None
        return look

    def _passes_short_check(self, last_look: Optional[Look], look: Look) -> bool:
        """Return whether two looks show that all processes have received the last tick, and now sleep.

        `last_look` is None if there is only one look so far; then the check is not passed.
        """
        if not self._can_check_turns or last_look is None:
            return False
        runs_now = None in look.values()
        has_run_between_looks = look != last_look
        # Each tick (message on /clock) wakes its receivers. So a process that has not run since all processes
        # were last found asleep has not received the last tick yet, and is about to run.
        have_received_tick = all(
            look[process] != self._idle_look.get(process) for process in self._clock_receivers
        )
        return have_received_tick and not has_run_between_looks and not runs_now

    def _find_processes(self) -> None:
        """Find the processes that listen, if the connections have changed since the last call."""
        topic_ports, clock_ports = _ports_of(self._publisher), _ports_of(self._clock)
        if topic_ports | clock_ports == self._ports:
            return
        self._ports = topic_ports | clock_ports
        process_by_ports = _receiving_processes(self._ports)
        ports_here = process_by_ports.keys()  # ports of the connections to processes on this machine
        self._topic_receivers = {process_by_ports[ports] for ports in topic_ports & ports_here}
        self._clock_receivers = {process_by_ports[ports] for ports in clock_ports & ports_here}
        # false also if there is no receiver, because `asleep` then has no controller to look at
        self._sees_all_receivers = bool(topic_ports) and topic_ports <= ports_here
        processes = set(process_by_ports.values())  # a process may have several connections
        self._can_check_turns = COUNTS_TURNS and all(map(_in_python, processes))
        for threads in self._processes.values():
            threads.close()
        self._processes = {process: _Threads(process) for process in processes}


class _Threads:
    """Threads of a process; their files in /proc stay open, because opening them takes most of the time."""

    def __init__(self, process: int) -> None:
        """Set up for the process with this id; no file is opened yet."""
        self._folder = f"/proc/{process}/task"
        # descriptors of the open files SCHEDULE and STAT of each thread
        self._files: Dict[str, List[int]] = {}

    def close(self) -> None:
        """Close all files."""
        for thread in list(self._files):
            self._forget(thread)

    def turns(self) -> Optional[Turns]:
        """Return the turns of all threads except the calling thread, or None if one of them runs now."""
        try:
            threads = os.listdir(self._folder)[:MAX_THREADS]
        except OSError:  # the process has just ended
            threads = []
        for ended in self._files.keys() - threads:
            self._forget(ended)
        turns = {}  # text of the file SCHEDULE of each thread
        own_thread = str(threading.get_native_id())
        for thread in threads:
            if thread == own_thread:  # this thread makes the check, so it is always running
                continue
            try:
                if thread not in self._files:
                    self._open(thread)
                schedule, stat = self._files[thread]
                turns[thread] = os.pread(schedule, READ_SIZE, 0)
                # the state is the letter after the name, which is in parentheses: "123 (python3) S ..."
                state = os.pread(stat, READ_SIZE, 0).rpartition(b") ")[2][:1]
                if state in RUNNING_STATES:
                    return None
            except OSError:  # the thread has just ended
                self._forget(thread)
        return turns

    def _open(self, thread: str) -> None:
        """Open the files of a thread."""
        # this list is stored before the files are opened: if the second file cannot be opened, `_forget`
        # closes the first
        files: List[int] = []
        self._files[thread] = files
        for name in (SCHEDULE, STAT):
            files.append(os.open(f"{self._folder}/{thread}/{name}", os.O_RDONLY | os.O_CLOEXEC))

    def _forget(self, thread: str) -> None:
        """Close the files of a thread, if any are open."""
        for file in self._files.pop(thread, ()):
            os.close(file)


def _ports_of(publisher: Any) -> Set[Ports]:
    """Return the ports of each connection of a publisher; the sockets are in private attributes of rospy."""
    pairs = set()
    for connection in list(publisher.impl.connections) if publisher else []:
        # a publisher with a queue wraps each connection in a QueuedConnection
        transport = getattr(connection, "_connection", connection)
        # an error means that the connection has just been closed
        with contextlib.suppress(AttributeError, OSError):
            # the second value of an address is its port
            subscriber_port = transport.socket.getpeername()[1]
            own_port = transport.socket.getsockname()[1]
            pairs.add((subscriber_port, own_port))
    return pairs


def _in_python(process: int) -> bool:
    """Return whether a process runs Python, by the name of its program."""
    try:
        return os.path.basename(os.readlink(f"/proc/{process}/exe")).startswith("python")
    except OSError:  # the process has just ended, or belongs to another user
        return False


def _receiving_processes(ports: Set[Ports]) -> Dict[Ports, int]:
    """Return the id of the process at the subscriber's end of each connection, by the ports.

    A subscriber on another machine is left out. The kernel takes 4 ms to list all connections, so this is
    called only when connections have changed.
    """
    # fields of a line of /proc/net/tcp: 0 number, 1 local ADDRESS:PORT, 2 remote ADDRESS:PORT, 9 inode of the
    # socket; numbers are hexadecimal, and the first line has the titles
    ports_by_socket: Dict[str, Ports] = {}
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        fields = line.split()
        local, remote, inode = fields[1], fields[2], fields[9]
        pair = int(local.split(":")[1], 16), int(remote.split(":")[1], 16)
        # A connection has two lines. This is the line of the subscriber's socket; in the line of the
        # publisher's socket, the local port and the remote port are exchanged.
        if pair in ports:
            ports_by_socket[f"socket:[{inode}]"] = pair
    # the folder /proc/PROCESS/fd has a link to each socket of the process
    process_by_ports: Dict[Ports, int] = {}  # id of the process that receives from each connection
    for folder in Path("/proc").glob("[0-9]*/fd"):
        try:
            links = list(folder.iterdir())
        except OSError:  # the process has just ended, or belongs to another user
            continue
        for link in links:
            with contextlib.suppress(OSError):  # an error means that the file has just been closed
                socket_name = os.readlink(link)
                if socket_name in ports_by_socket:
                    process_by_ports[ports_by_socket[socket_name]] = int(folder.parent.name)
    return process_by_ports
