"""Processes with limited output and size, which leave no process behind.

In: commands. Out: running processes with a log.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, BinaryIO, Callable, Dict, List, Optional, Sequence

import psutil

from husky_grading.isolation.files import create
from husky_grading.isolation.limits import SizeWatch
from husky_grading.isolation.private_network import is_entered
from husky_grading.isolation.sandbox import Workspace, sandboxed
from husky_highlevel_controller.datatypes import HuskyError

# [bytes] if an output is longer than both numbers together, the log has only LOG_HEAD bytes of its beginning
# and LOG_TAIL bytes of its end
LOG_HEAD, LOG_TAIL = 2_000_000, 500_000
CHUNK = 1 << 16  # [bytes]
END_DEADLINE = 10.0  # [s] longest wall time for which `kill` waits until a killed program has ended
STOP_DEADLINE = 30.0  # [s] wall time after Ctrl-C at which this program kills itself, if it still runs
_REAPER = str(Path(__file__).with_name("reaper.py"))


class Process:
    """Process in a session of its own, without input, with its output in a log of limited size.

    It ends, with every process that it started, when it is killed or when this program ends.
    """

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        env: Dict[str, str],
        folder: Path,
        workspace: Optional[Workspace] = None,
        shows_errors: bool = False,
    ) -> None:
        """Start the process.

        Args:
            command: program and arguments.
            log: file for its output.
            env: environment.
            folder: working directory, the only folder that an untrusted program may write.
            workspace: workspace of an untrusted program, which runs in the sandbox; None for our programs.
            shows_errors: true if the program's errors and its progress bar go to the terminal; otherwise they
                go into the log.
        """
        self.log = log
        self._file: Optional[BinaryIO] = None  # the opened log; None if it cannot be written
        with contextlib.suppress(OSError):  # the run continues without a log if the disk is full
            # the log is created before the program starts, so that the program cannot put a link in its place
            self._file = create(log)
        self._watch: Optional[SizeWatch] = None  # ends an untrusted program that uses too much memory or disk
        if workspace is not None:
            command = sandboxed(workspace, command, folder, env)
        self._stderr = None if shows_errors else subprocess.STDOUT
        self.popen = self._popen(command, env, folder)
        if workspace is not None:
            self._watch = SizeWatch(
                self.popen.pid, folder, end_program=self.popen.terminate, is_network_own=is_entered()
            )
        self._head, self._tail = bytearray(), bytearray()  # beginning and end of the output so far
        self._pump = threading.Thread(target=self._read, daemon=True)
        self._pump.start()

    def _popen(self, command: Sequence[str], env: Dict[str, str], folder: Path) -> Any:
        """Start the command under `reaper.py`.

        When the command or this program ends, `reaper.py` kills all processes that the command has started.
        """
        return subprocess.Popen(
            # with -I, Python imports no modules from the working directory or from PYTHONPATH
            [sys.executable, "-I", _REAPER, str(os.getpid()), *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            env=env,
            cwd=folder,
            start_new_session=True,
        )

    def _read(self) -> None:
        """Copy the output into the log until the program closes it, in a thread of its own.

        The first LOG_HEAD bytes are written as they come. Of the rest, only the last LOG_TAIL bytes are
        written, at the end.
        """
        assert self.popen.stdout is not None
        size = 0
        with self.popen.stdout as pipe, contextlib.suppress(OSError, ValueError):
            # the loop ends when the program closes the pipe, because `os.read` then returns an empty chunk
            for chunk in iter(lambda: os.read(pipe.fileno(), CHUNK), b""):
                size += len(chunk)
                # [bytes] part of this chunk that still belongs to the beginning
                room = max(LOG_HEAD - len(self._head), 0)
                self._head += chunk[:room]
                self._write(chunk[:room])
                self._tail = (self._tail + chunk[room:])[-LOG_TAIL:]
        if self._tail:
            left_out = size - len(self._head) - len(self._tail)
            self._write(b"\n[... %d bytes left out ...]\n" % left_out + bytes(self._tail))
        if self._file is not None:
            self._file.close()

    def _write(self, content: bytes) -> None:
        """Append to the log; a full disk is ignored, so that the program is not blocked by a full pipe."""
        with contextlib.suppress(OSError):
            if self._file is not None:
                self._file.write(content)

    @property
    def output(self) -> str:
        """Return the beginning and the end of the output so far."""
        head, tail = bytes(self._head), bytes(self._tail)
        return (head + b"\n" + tail if tail else head).decode(errors="replace")

    @property
    def running(self) -> bool:
        """Return whether the program still runs."""
        return self.popen.poll() is None

    @property
    def problem(self) -> str:
        """Return the limit that ended the program, in a sentence; empty if no limit has ended it."""
        return self._watch.problem if self._watch else ""

    def interrupt(self) -> None:
        """Ask the program to end."""
        with contextlib.suppress(ProcessLookupError):
            self.popen.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """End the process and all processes that it has started, and wait until its output is in the log.

        Each of the waits takes END_DEADLINE at most.
        """
        if self._watch:
            self._watch.end()
        self.popen.terminate()  # reaper.py gets SIGTERM and kills all processes of the program
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.popen.wait(END_DEADLINE)
        # processes can be left if reaper.py has not ended in time, or if another program has killed it
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.popen.pid, signal.SIGKILL)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.popen.wait(END_DEADLINE)
        self._pump.join(END_DEADLINE)


STOP_REQUESTED = threading.Event()  # set by Ctrl-C or SIGTERM; then every `wait` raises StoppedError


class StoppedError(HuskyError):
    """Marking was interrupted."""


def request_stop() -> None:
    """End all waits; if that does not end this program in time, kill it with all programs that it started."""
    if not STOP_REQUESTED.is_set():
        STOP_REQUESTED.set()
        # After `os._exit` has ended this process, each reaper.py that it has started kills its own program.
        # 2 is the exit code of `grade` after an interruption.
        last_resort = threading.Timer(STOP_DEADLINE, os._exit, [2])
        last_resort.daemon = True
        last_resort.start()


def stop_on_signals() -> None:
    """Let Ctrl-C and SIGTERM end all waits, so that this program ends the programs that it has started."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: request_stop())


def wait(condition: Callable[[], bool], seconds: float, period: float = 0.05) -> bool:
    """Wait until a condition holds, and return whether it held within `seconds` of wall time.

    The condition is checked once per period [s].

    Raises:
        StoppedError: marking was interrupted.
    """
    end = time.monotonic() + seconds
    while not condition():
        if STOP_REQUESTED.is_set():
            raise StoppedError("marking was interrupted")
        if time.monotonic() > end:
            return False
        time.sleep(period)
    return True


def wait_and_kill(process: Process, seconds: float, period: float = 0.05) -> bool:
    """Wait until a process ends, at most `seconds` of wall time, and return whether it ended in time.

    In both cases, the process and all programs that it has left running are killed then.

    Raises:
        StoppedError: marking was interrupted.
    """
    try:
        return wait(lambda: not process.running, seconds, period)
    finally:
        process.kill()


def pids_with_variable(name: str, value: str) -> List[int]:
    """Return the ids of other processes that were started with this value of an environment variable.

    For example, all nodes of a ROS network have the same ROS_MASTER_URI. A slash at the end of the variable's
    value does not count.
    """
    pids = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            if process.environ().get(name, "").rstrip("/") == value and process.pid != os.getpid():
                pids.append(process.pid)
    return pids


def end_all(processes: Sequence[Process]) -> List[int]:
    """Kill processes and everything that they started, and return the ids of those that cannot be killed."""
    for process in processes:
        process.kill()
    return [process.popen.pid for process in processes if process.running]
