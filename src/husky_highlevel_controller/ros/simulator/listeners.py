"""Detects from /proc whether all subscribers of a topic are idle: none of their threads runs.

A node that waits for simulated time (ros::Rate, ros::Duration::sleep, rospy.sleep) answers nothing until the
clock goes on. What it sends does not distinguish it from one that computes; what its threads do does. A
thread that waits for a message runs from the moment it is sent. Unread messages say nothing: rospy reads none
during a callback, in which it may sleep.
"""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import Dict, Set, Tuple

import rospy

# [s] of wall time: roscpp looks at the clock every 1 ms while it sleeps, and a busy host may wake it later:
# with 3 ms two of three drives of such a controller came out otherwise beside a load of 11
ASLEEP_FOR = 0.008
LOOK_PERIOD = 0.002  # [s] of wall time
STAT = 512  # [bytes] of a thread's /proc/.../stat that are read; its state is among the first
RUNNING = {b"R", b"D"}  # states of a thread: on a CPU or waiting for one, or for a disk

Ports = Tuple[int, int]  # of a connection: the subscriber's, this process's


class Listeners:
    """The processes on this machine that subscribe to a publisher's topic."""

    def __init__(self, publisher: rospy.Publisher) -> None:
        self._publisher = publisher
        self._owners: Dict[Ports, int] = {}  # process at the other end of each connection

    def asleep(self) -> bool:
        """Whether all of them stay asleep for some milliseconds; takes as long."""
        end = time.monotonic() + ASLEEP_FOR
        while True:
            if not self._idle():
                return False
            if time.monotonic() >= end:
                return True
            time.sleep(LOOK_PERIOD)

    def _idle(self) -> bool:
        ports = self._ports()
        if ports != self._owners.keys():
            self._owners = _owners(ports)
        if not ports or len(self._owners) < len(ports):
            return False  # elsewhere than on this machine nothing is known
        if _runs(os.getpid(), but=threading.get_native_id()):
            return False  # a thread of ours that is about to send
        return not any(_runs(owner) for owner in set(self._owners.values()))

    def _ports(self) -> Set[Ports]:
        """Ports of each connection; rospy has no public way to its sockets."""
        pairs = set()
        for queued in list(self._publisher.impl.connections):
            transport = getattr(queued, "_connection", queued)
            try:
                pairs.add((transport.socket.getpeername()[1], transport.socket.getsockname()[1]))
            except (AttributeError, OSError):  # it has just been closed
                continue
        return pairs


def _owners(ports: Set[Ports]) -> Dict[Ports, int]:
    """Process that receives, of each connection that ends on this machine.

    The kernel takes 4 ms to list all connections: it is asked only when they change.
    """
    sockets: Dict[str, Ports] = {}
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        words = line.split()
        pair = int(words[1].split(":")[1], 16), int(words[2].split(":")[1], 16)
        if pair in ports:
            sockets[f"socket:[{words[9]}]"] = pair
    owners: Dict[Ports, int] = {}
    for folder in Path("/proc").glob("[0-9]*/fd"):
        try:
            for link in folder.iterdir():
                name = os.readlink(link)
                if name in sockets:
                    owners[sockets[name]] = int(folder.parent.name)
        except OSError:  # it has just ended, or belongs to another user
            continue
    return owners


def _runs(process: int, but: int = 0) -> bool:
    folder = f"/proc/{process}/task"
    try:
        threads = os.listdir(folder)
    except OSError:  # it has just ended
        return False
    for thread in threads:
        try:
            with open(f"{folder}/{thread}/stat", "rb", buffering=0) as file:
                state = file.read(STAT).rpartition(b") ")[2][:1]
        except OSError:
            continue
        if state in RUNNING and int(thread) != but:
            return True
    return False
