"""Detects from /proc whether all subscribers of a topic are idle: no thread of theirs runs.

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
from typing import Dict, List, Optional, Set, Tuple

import rospy

ASLEEP_FOR = 0.003  # [s] of wall time: roscpp looks at the clock every 1 ms while it sleeps
LOOK_PERIOD = 0.0005  # [s] of wall time
RUNNING = {"R", "D"}  # states of a thread: on a CPU or waiting for one, or for a disk


class Listeners:
    """The processes on this machine that subscribe to a publisher's topic."""

    def __init__(self, publisher: rospy.Publisher) -> None:
        self._publisher = publisher
        self._owners: Dict[str, int] = {}  # process of a socket's inode

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
        inodes = _receiving_sockets(ports)
        if not ports or len(inodes) < len(ports):
            return False  # elsewhere than on this machine nothing is known
        owners = {self._owner(inode) for inode in inodes}
        if _runs(os.getpid(), but=threading.get_native_id()):
            return False  # a thread of ours that is about to send
        return not any(owner is None or _runs(owner) for owner in owners)

    def _ports(self) -> Set[Tuple[int, int]]:
        """(theirs, ours) of each connection; rospy has no public way to its sockets."""
        pairs = set()
        for queued in list(self._publisher.impl.connections):
            transport = getattr(queued, "_connection", queued)
            try:
                pairs.add((transport.socket.getpeername()[1], transport.socket.getsockname()[1]))
            except (AttributeError, OSError):  # it has just been closed
                continue
        return pairs

    def _owner(self, inode: str) -> Optional[int]:
        if inode not in self._owners:
            self._owners.update(_owners({inode}))
        return self._owners.get(inode)


def _receiving_sockets(ports: Set[Tuple[int, int]]) -> List[str]:
    """Inodes of the receiving ends of the connections between these ports."""
    found = []
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        words = line.split()
        local, remote = int(words[1].split(":")[1], 16), int(words[2].split(":")[1], 16)
        if (local, remote) in ports:
            found.append(words[9])
    return found


def _owners(inodes: Set[str]) -> Dict[str, int]:
    """Which process has a socket open."""
    names = {f"socket:[{inode}]": inode for inode in inodes}
    owners = {}
    for folder in Path("/proc").glob("[0-9]*/fd"):
        try:
            for link in folder.iterdir():
                name = os.readlink(link)
                if name in names:
                    owners[names[name]] = int(folder.parent.name)
        except OSError:  # it has just ended, or belongs to another user
            continue
    return owners


def _runs(process: int, but: int = 0) -> bool:
    for status in Path(f"/proc/{process}/task").glob("*/stat"):
        try:
            if int(status.parent.name) != but and status.read_text().rpartition(")")[2].split()[0] in RUNNING:
                return True
        except OSError:
            continue
    return False
