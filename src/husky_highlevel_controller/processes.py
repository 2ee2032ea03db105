"""Processes that are strangers: what they print is cut, and in the end none of them is left.

In: commands. Out: running processes with a log. Must not know: ROS, what the processes are.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from functools import lru_cache
from pathlib import Path
from typing import Callable, Dict, List, Sequence

from husky_highlevel_controller.datatypes import HuskyError

LOG_HEAD, LOG_TAIL = 2_000_000, 500_000  # [bytes] of a log that are kept
CHUNK = 1 << 16
END_DEADLINE = 10.0  # [s] of wall time for what was killed to be gone
LIMITS = ["--fsize=500000000", "--data=4000000000", "--core=0"]  # [bytes], of a stranger's files and memory
MANY = "--nproc=1000"  # processes and threads, where they are counted for a namespace alone

# a process namespace of its own: who is in it can neither see nor end a process outside, and ends with it
_NAMESPACE = [
    "unshare",
    "--user",
    "--map-root-user",
    "--pid",
    "--fork",
    "--kill-child=SIGKILL",
    "--mount-proc",
    "--",
]
# elsewhere somebody who keeps them together; by its path, because a stranger's package may have our name
_REAPER = [sys.executable, str(Path(__file__).with_name("reaper.py"))]


@lru_cache(maxsize=1)
def namespaces() -> bool:
    """Whether this machine lets us make process namespaces."""
    try:
        asked = subprocess.run([*_NAMESPACE, "true"], capture_output=True, timeout=10.0, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return asked.returncode == 0


class Process:
    """A process in a session of its own, without input, whose output goes to a log of limited size."""

    def __init__(
        self, command: Sequence[str], log: Path, env: Dict[str, str], folder: Path, stranger: bool = False
    ) -> None:
        self.log = log
        apart = stranger and namespaces()
        self._reaped = stranger and not apart
        if stranger:
            command = ["prlimit", *LIMITS, *[MANY] * apart, "stdbuf", "-oL", *command]
            command = [*(_NAMESPACE if apart else _REAPER), *command]
        self.popen = subprocess.Popen(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=env,
            cwd=folder,
            start_new_session=True,
        )
        self._head, self._tail, self._size = bytearray(), bytearray(), 0
        self._pump = threading.Thread(target=self._read, daemon=True)
        self._pump.start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        with self.popen.stdout as pipe, self.log.open("wb", buffering=0) as file:
            descriptor = pipe.fileno()
            while True:
                try:
                    chunk = os.read(descriptor, CHUNK)
                except (OSError, ValueError):
                    break
                if not chunk:
                    break
                self._size += len(chunk)
                room = LOG_HEAD - len(self._head)
                if room > 0:
                    self._head += chunk[:room]
                    file.write(chunk[:room])
                if len(chunk) > room:
                    self._tail = (self._tail + chunk[max(room, 0) :])[-LOG_TAIL:]
            if self._tail:
                left_out = self._size - len(self._head) - len(self._tail)
                file.write(b"\n[... %d bytes left out ...]\n" % left_out + bytes(self._tail))

    @property
    def output(self) -> str:
        """What it printed so far: the beginning, and the end."""
        return (bytes(self._head) + b"\n" * bool(self._tail) + bytes(self._tail)).decode(errors="replace")

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.popen.poll() is None

    def interrupt(self) -> None:
        """Ask it to end."""
        with contextlib.suppress(ProcessLookupError):
            self.popen.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """End it and its session at once; of a stranger, everybody that it ever started."""
        if self._reaped:
            self.popen.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.popen.wait(END_DEADLINE)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.popen.pid, signal.SIGKILL)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.popen.wait(END_DEADLINE)


STOP = threading.Event()  # somebody wants the marking to end


class StoppedError(HuskyError):
    """The marking was told to end."""


def wait(condition: Callable[[], bool], seconds: float, period: float = 0.05) -> bool:
    """Wait until a condition holds; False if it does not after so many seconds of wall time.

    Raises:
        StoppedError: the marking is to end.
    """
    end = time.monotonic() + seconds
    while not condition():
        if STOP.is_set():
            raise StoppedError("the marking was stopped")
        if time.monotonic() > end:
            return False
        time.sleep(period)
    return True


def with_variable(name: str, value: str) -> List[int]:
    """Every process that was started with this variable in its environment, wherever it has gone."""
    mark = f"{name}={value}".encode()
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "environ").read_bytes().split(b"\0")
        except OSError:  # it has just ended, or is somebody else's
            continue
        if any(word.rstrip(b"/") == mark for word in words) and int(entry.name) != os.getpid():
            found.append(int(entry.name))
    return found


def end_all(processes: Sequence[Process], name: str, value: str) -> List[int]:
    """Kill the processes and everybody with this variable in the environment; who is left in spite of it."""

    def gone() -> bool:
        for pid in with_variable(name, value):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        for process in processes:
            process.popen.poll()  # or it would be there as a zombie
        return not with_variable(name, value)

    for process in processes:
        process.kill()
    end = time.monotonic() + END_DEADLINE
    while not gone() and time.monotonic() < end:
        time.sleep(0.05)
    return with_variable(name, value)
