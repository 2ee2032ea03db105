"""Limits of memory and disk of untrusted programs: sizes of their processes and folders are watched.

In: a process and folders. Out: the program is ended, and why. Must not know: what the program is.

rlimits do not do it: RLIMIT_DATA counts no shared mappings, RLIMIT_FSIZE no number of files.
"""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path
from typing import Callable, Optional, Sequence

import psutil

MEMORY = 6_000_000_000  # [bytes] of all processes of a program together
DISK = 3_000_000_000  # [bytes] of all files in its folders
MEMORY_POLL_PERIOD = 0.25  # [s]
DISK_POLLS = 8  # memory polls for each look at the folders


class SizeWatch:
    """Ends a program whose memory or files have grown beyond their limits."""

    def __init__(self, pid: int, folders: Sequence[Path], end_program: Callable[[], None]) -> None:
        self.problem = ""  # why the program was ended
        self._pid, self._folders, self._end_program = pid, tuple(folders), end_program
        self._done = threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def end(self) -> None:
        """Stop watching."""
        self._done.set()

    def _run(self) -> None:
        try:
            root = psutil.Process(self._pid)
        except psutil.Error:
            return
        polls = 0
        while not self._done.wait(MEMORY_POLL_PERIOD):
            polls += 1
            memory = memory_of(root)
            if memory is None:
                return
            disk = sum(map(disk_usage, self._folders)) if polls % DISK_POLLS == 0 else 0
            if memory > MEMORY:
                self.problem = f"it was ended: it used more than {MEMORY / 1e9:g} GB of memory"
            elif disk > DISK:
                self.problem = f"it was ended: it wrote more than {DISK / 1e9:g} GB of files"
            if self.problem:
                self._end_program()
                return


def memory_of(root: psutil.Process) -> Optional[int]:
    """Memory of a process and all below it, shared pages once [bytes]; None: it has ended."""
    try:
        if root.status() == psutil.STATUS_ZOMBIE:
            return None
        processes = root.children(recursive=True)
    except psutil.Error:
        return None
    resident = 0
    for process in processes:
        with contextlib.suppress(psutil.Error):
            resident += process.memory_info().rss
    if resident <= MEMORY:  # each process counts the pages it shares with others
        return resident
    proportional = 0
    for process in processes:
        with contextlib.suppress(psutil.Error):
            proportional += process.memory_full_info().pss
    return proportional


def disk_usage(folder: Path) -> int:
    """Blocks that the files of a folder take, links not followed [bytes]."""
    size = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):
                size += 512 * os.lstat(os.path.join(place, name)).st_blocks
    return size
