"""Network namespace of one marking: loopback only, so that no submission reaches another, or a machine."""

from __future__ import annotations

import fcntl
import os
import shutil
import socket
import struct
import subprocess
import sys
from typing import List, Optional

MARK = "HUSKY_GRADE_NETWORK"  # set in the environment of the program that runs inside
PROBE_DEADLINE = 10.0  # [s] of wall time
_SET_FLAGS, _UP_AND_RUNNING = 0x8914, 0x1 | 0x8 | 0x40  # SIOCSIFFLAGS; IFF_UP, IFF_LOOPBACK, IFF_RUNNING


def enter() -> None:
    """Start this program again in a network of its own; returns inside, or where the machine allows none."""
    if MARK in os.environ:
        if os.environ[MARK]:
            _bring_loopback_up()
        return
    command = _namespace_command()
    os.environ[MARK] = "private" if command else ""
    if command:
        os.execv(command[0], [*command, sys.executable, *sys.argv])


def is_private() -> bool:
    """Whether this program runs in a network of its own."""
    return bool(os.environ.get(MARK))


def can_be_made() -> bool:
    """Whether this machine lets us make one."""
    return bool(_namespace_command())


def _namespace_command() -> Optional[List[str]]:
    program = shutil.which("unshare")
    for flags in (["--user", "--map-root-user", "--net", "--"], ["--net", "--"]):
        if program and _works([program, *flags]):
            return [program, *flags]
    return None


def _works(command: List[str]) -> bool:
    try:
        done = subprocess.run([*command, "true"], capture_output=True, timeout=PROBE_DEADLINE, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def _bring_loopback_up() -> None:
    with socket.socket() as any_socket:
        fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sH14x", b"lo", _UP_AND_RUNNING))
