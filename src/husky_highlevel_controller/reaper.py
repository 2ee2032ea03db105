"""Runs a command, and leaves nobody of it behind: `reaper.py COMMAND...`, started by its path.

For machines without process namespaces. Whoever is orphaned below becomes a child of this process (a
"subreaper"), so that all are found by their parents, whatever they did to hide. It ends with the command, on
SIGTERM, or with the one who started it. Must not know: this package, which a stranger's may be named like.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict, List

SUBREAPER, PARENT_DEATH_SIGNAL = 36, 1  # of prctl(2)
GLANCE = 0.02  # [s]


def descendants(pid: int) -> List[int]:
    """Everybody below a process."""
    children: Dict[int, List[int]] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, IndexError, ValueError):
            parent = int(entry.read_text().rpartition(")")[2].split()[1])
            children.setdefault(parent, []).append(int(entry.parent.name))
    found, to_see = [], [pid]
    while to_see:
        below = children.get(to_see.pop(), [])
        found += below
        to_see += below
    return found


def end_descendants() -> None:
    """Kill them until nobody is left."""
    while True:
        for pid in descendants(os.getpid()):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        time.sleep(GLANCE)


def main() -> None:
    """Run the command; its exit code."""
    prctl = ctypes.CDLL(None).prctl
    prctl(SUBREAPER, 1, 0, 0, 0)
    prctl(PARENT_DEATH_SIGNAL, signal.SIGTERM, 0, 0, 0)
    asked: List[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: asked.append(number))
    command = subprocess.Popen(sys.argv[1:])
    code = None
    while code is None and not asked:
        time.sleep(GLANCE)
        code = command.poll()
    end_descendants()
    sys.exit(1 if code is None else code if code >= 0 else 128 - code)


if __name__ == "__main__":
    main()
