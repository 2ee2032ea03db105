"""Namespaces of one marking: a network with a loopback only, and mounts of its own.

So a submission reaches neither another submission nor another machine. The mounts let the folder of results
have a neutral path, see `place`.
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct
import sys
from functools import lru_cache
from typing import Dict, List, Sequence, Tuple

from husky_grading.isolation import place
from husky_grading.isolation.sandbox import system_program, works

# environment variable with the network of a program: "private", or empty for the network of the machine
VARIABLE = "HUSKY_GRADE_NETWORK"
MOUNTS = "--mount"  # option of unshare(1) that gives a program mounts of its own
_IFREQ = "16sH14x"  # struct ifreq of netdevice(7): name of the interface, flags, unused bytes
# request and flags that switch a network interface on, see netdevice(7): SIOCSIFFLAGS; IFF_UP, IFF_LOOPBACK
# and IFF_RUNNING
_SET_FLAGS, _UP_AND_RUNNING = 0x8914, 0x1 | 0x8 | 0x40


def enter_network() -> None:
    """Start this program again in a network of its own, and return only in the new program.

    If this machine allows no such network, nothing is started, and the function returns in this program.
    """
    if VARIABLE in os.environ:  # this is the new program
        if os.environ[VARIABLE]:
            # the ioctl switches the loopback interface on; it needs a socket of any kind
            with socket.socket() as any_socket:
                fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack(_IFREQ, b"lo", _UP_AND_RUNNING))
        return
    command, variables = inside([sys.executable, *sys.argv])
    os.environ.update(variables)
    if variables[VARIABLE]:  # empty if this machine allows no network of its own
        os.execv(command[0], command)  # the new program replaces this one


def inside(command: Sequence[str]) -> Tuple[List[str], Dict[str, str]]:
    """Return the command that starts a program in its own namespaces, and its environment variables.

    If this machine allows no namespaces, the command stays as it is.
    """
    prefix = _namespace_command()
    own_place = place.make() if MOUNTS in prefix else ""
    return [*prefix, *command], {VARIABLE: "private" if prefix else "", place.VARIABLE: own_place}


def is_entered() -> bool:
    """Return whether this program runs in a network of its own."""
    return bool(os.environ.get(VARIABLE))


def reach() -> str:
    """Return how far programs in this program's network can reach, as a text for the result."""
    return "loopback only" if is_entered() else "not kept apart"


def can_be_made() -> bool:
    """Return whether this machine lets us make a private network."""
    return bool(_namespace_command())


@lru_cache(maxsize=None)
def _namespace_command() -> Tuple[str, ...]:
    """Return the command that starts a program in a network of its own; () if this machine allows none.

    The first choice that works is taken. Choices that also give the program its own mounts come first.
    """
    as_root = ["--user", "--map-root-user"]  # a user without the rights of root needs these options
    for flags in ([*as_root, MOUNTS], [MOUNTS], as_root, []):
        if works("unshare", *flags, "--net", "--", "true"):
            return (system_program("unshare"), *flags, "--net", "--")
    return ()
