"""Watchdog for memory, threads and disk of a process tree.

Rlimits are not enough, because they count neither shared mappings nor files, and because the kernel lets
root have any number of processes.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import stat
import threading
from math import ceil
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

import psutil

# [bytes] a program is ended if its processes and its temporary files together use more memory than this
MEMORY = 6_000_000_000
# folders for temporary files; in the sandbox of bubblewrap, their files are in memory, so they count as
# memory
TEMPORARY = ("/tmp", "/var/tmp", "/dev/shm")
TEMPORARY_FILES = 500_000_000  # [bytes] capacity of each folder in TEMPORARY
THREADS = 1000  # a program is ended if all its processes together have more threads than this
# A submission is ended if its network has more sockets than this; a normal run has a few hundred. Sockets are
# limited because each socket can hold 0.4 MB of unread data in the kernel (net.core.rmem_default and
# wmem_default). The memory of a process does not include these data.
SOCKETS = 1000
# [bytes] a submission is ended if the sizes of all files in its folder add up to more than this
DISK = 3_000_000_000
MEMORY_POLL_PERIOD = 0.25  # [s]
FILES = 200_000  # a submission is ended if its folder has more files and folders than this
# columns of /proc/sysvipc/shm: number of attached processes, and size in memory [bytes]
SHM_ATTACHED, SHM_SIZE = 6, 14
CLONE_NEWIPC = 0x08000000  # flag of setns(2)
BLOCK = 512  # [bytes] stat(2) gives the size of a file on the disk in blocks of this size
DISK_POLLS = 8  # only every DISK_POLLS-th check of the memory also checks the size of the folder


class SizeWatch:
    """Ends an untrusted program whose memory, threads, files or sockets have grown beyond their limits."""

    def __init__(
        self, pid: int, folder: Path, end_program: Callable[[], None], is_network_own: bool = False
    ) -> None:
        """Start watching, in a thread of its own.

        Args:
            pid: id of the program's first process; all processes below it belong to the program.
            folder: folder in which the program writes files.
            end_program: function that ends the program.
            is_network_own: true if the network has no sockets of other programs of this machine; otherwise
                sockets are not limited, because the sockets of all programs would be counted.
        """
        self.problem = ""  # sentence that says why the program was ended; empty if it was not ended
        self._pid, self._folder, self._end_program = pid, folder, end_program
        self._is_network_own = is_network_own
        self._done = threading.Event()  # set by `end`
        threading.Thread(target=self._run, daemon=True).start()

    def end(self) -> None:
        """Stop watching."""
        self._done.set()

    def _run(self) -> None:
        """End the program if it exceeds a limit, or if its size cannot be watched."""
        try:
            self.problem = self._watch()
        except Exception as error:
            # After an error, the limits cannot be checked any more, so the program is ended. The sentence has
            # only `strerror`, because the full text of the error has a path, which may be very long.
            reason = getattr(error, "strerror", None) or error
            self.problem = f"it was ended: its size cannot be watched: {reason}"
        if self.problem:
            self._end_program()

    def _watch(self) -> str:
        """Watch the program, and return a sentence on the limit that it exceeds; empty if it exceeds none."""
        polls = 0
        while not self._done.wait(MEMORY_POLL_PERIOD):
            polls += 1
            processes = processes_below(self._pid)
            if processes is None:  # the program has ended
                break
            if thread_count(processes) > THREADS:
                return f"it was ended: it started more than {THREADS} processes and threads"
            # in the network of the machine, the sockets of all other programs would count, too
            if self._is_network_own and socket_count() > SOCKETS:
                return f"it was ended: it opened more than {SOCKETS} sockets"
            # [bytes] memory that belongs to no process: files in memory, and shared memory that no process
            # uses any more
            unowned = temporary_files(processes) + detached_segments(processes)
            if memory_of(processes) + unowned > MEMORY:
                return f"it was ended: it used more than {MEMORY / 1e9:g} GB of memory"
            if polls % DISK_POLLS == 0:
                size, files = disk_usage(self._folder)
                if size + deleted_files(processes) > DISK:
                    return f"it was ended: it wrote more than {DISK / 1e9:g} GB of files"
                if files > FILES:
                    return f"it was ended: it made more than {FILES} files and folders"
        return ""


def processes_below(pid: int) -> Optional[List[psutil.Process]]:
    """Return all processes that a process has started, directly or indirectly; None if it has ended."""
    try:
        root = psutil.Process(pid)
        # a zombie has ended, but its parent has not asked for its exit code yet
        return None if root.status() == psutil.STATUS_ZOMBIE else root.children(recursive=True)
    except psutil.Error:
        return None


def thread_count(processes: Sequence[psutil.Process]) -> int:
    """Return the number of threads of processes, or the number of processes if it exceeds THREADS."""
    count = len(processes)  # each process has a first thread
    if count > THREADS:  # the limit is exceeded already, so the other threads need not be counted
        return count
    for process in processes:
        with contextlib.suppress(psutil.Error):
            count += process.num_threads() - 1
    return count


def socket_count() -> int:
    """Return the number of sockets in this program's network, also of connections not yet accepted."""
    (used,) = re.findall(r"^sockets: used (\d+)", Path("/proc/self/net/sockstat").read_text(), re.MULTILINE)
    return int(used)


def temporary_files(processes: Sequence[psutil.Process]) -> int:
    """Return the size of the files that the sandbox of these processes keeps in memory [bytes].

    The size is 0 if none of the processes is in a sandbox with mounts of its own.
    """
    own_mounts = os.readlink("/proc/self/ns/mnt")
    for process in processes:
        root = f"/proc/{process.pid}/root"
        # an OSError means that this process has ended, so the next process is tried
        with contextlib.suppress(OSError):
            if os.readlink(f"/proc/{process.pid}/ns/mnt") != own_mounts:
                # all processes in the sandbox see the same folders, so one process is enough
                return sum(_used_of_sandbox(root + folder) for folder in TEMPORARY)
    return 0


def _used_of_sandbox(folder: str) -> int:
    """Return the size of the files in a memory folder of the sandbox [bytes].

    The sandbox mounts a folder of at most TEMPORARY_FILES bytes at this path. Before that, a folder of the
    machine is at this path. Its file system is larger, so it is recognised by its size, and counts as 0.

    Raises:
        OSError: the folder does not exist any more.
    """
    status = os.statvfs(folder)
    is_of_sandbox = status.f_blocks <= ceil(TEMPORARY_FILES / status.f_frsize)
    return (status.f_blocks - status.f_bfree) * status.f_frsize if is_of_sandbox else 0


def _enter_ipc_namespace(processes: Sequence[psutil.Process]) -> bool:
    """Let the calling thread enter the sandbox's IPC namespace, because it sees the shared memory only there.

    Returns:
        Whether the thread is in the IPC namespace of a sandbox, now or since an earlier call. False if
        none of the processes is in a sandbox.
    """
    our_namespace = os.readlink("/proc/self/ns/ipc")  # IPC namespace of this program
    if os.readlink("/proc/thread-self/ns/ipc") != our_namespace:
        return True  # the thread has entered the sandbox's namespace at an earlier call
    for process in processes:
        namespace = f"/proc/{process.pid}/ns/ipc"
        with contextlib.suppress(OSError):  # an OSError means that the process has ended
            if os.readlink(namespace) != our_namespace:  # this process is in the sandbox
                with open(namespace) as file:
                    ctypes.CDLL(None).setns(file.fileno(), CLONE_NEWIPC)
                # `setns` raises no error if it fails, so this checks whether the thread has entered
                if os.readlink("/proc/thread-self/ns/ipc") != our_namespace:
                    return True
    return False


def detached_segments(processes: Sequence[psutil.Process]) -> int:
    """Return the size of a sandbox's System V shared memory to which no process is attached any more [bytes].

    Such memory stays in use although it belongs to no process, so `memory_of` does not count it.

    Only a thread inside the sandbox's IPC namespace sees this memory. So the calling thread enters the
    namespace, and stays there. Call this function only in the thread of a `SizeWatch`.
    """
    if not _enter_ipc_namespace(processes):
        return 0  # none of the processes is in a sandbox
    _titles, *lines = Path("/proc/sysvipc/shm").read_text().splitlines()
    rows = [line.split() for line in lines]
    return sum(int(row[SHM_SIZE]) for row in rows if row[SHM_ATTACHED] == "0")


def memory_of(processes: Sequence[psutil.Process]) -> int:
    """Return the memory of processes together, with shared pages counted once [bytes]."""
    resident = 0
    for process in processes:
        with contextlib.suppress(psutil.Error):
            resident += process.memory_info().rss
    # `resident` may be too large, because each process counts the pages that it shares with others. If even
    # this sum is within the limit, no better sum is needed.
    if resident <= MEMORY:
        return resident
    # The proportional size divides a shared page among its processes, see proc(5). So the sum is right, but
    # it takes long to read.
    proportional = 0
    for process in processes:
        with contextlib.suppress(psutil.Error):
            proportional += process.memory_full_info().pss
    return proportional


def disk_usage(folder: Path) -> Tuple[int, int]:
    """Return the size on the disk of the files below a folder [bytes], and the number of files and folders.

    Links are not followed. The search ends soon after FILES entries, because the limit is then exceeded.

    Raises:
        OSError: a folder hides its content, or has a path that is too long for the kernel.
    """
    size = count = 0  # size of the files [bytes], and number of files and folders
    waiting = [str(folder)]
    while waiting and count <= FILES:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    count += 1
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
                    else:
                        with contextlib.suppress(FileNotFoundError):
                            size += BLOCK * entry.stat(follow_symlinks=False).st_blocks
        except FileNotFoundError:  # the folder was deleted after it was listed
            continue
    return size, count


def deleted_files(processes: Sequence[psutil.Process]) -> int:
    """Return the size on the disk of deleted files that processes still have open [bytes].

    Such files still use the disk, but no folder has them.
    """
    # sizes by device and inode, so that a file counts once even if it is open several times
    sizes = {}
    for process in processes:
        with contextlib.suppress(OSError), os.scandir(f"/proc/{process.pid}/fd") as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    status = os.stat(entry.path)
                    if stat.S_ISREG(status.st_mode) and not status.st_nlink:
                        sizes[status.st_dev, status.st_ino] = BLOCK * status.st_blocks
    return sum(sizes.values())
