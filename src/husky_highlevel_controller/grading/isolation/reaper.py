"""Runs a command and ends every process it leaves behind: `reaper.py PARENT_PID COMMAND...`.

A child subreaper (prctl(2)): orphans below become children of this process, so all are found by their
parents. It ends with the command, on SIGTERM, or when the process that started it dies, by whatever signal.
SIGINT, SIGUSR1 and SIGUSR2 are passed on to the command. It is started by its path and imports nothing of
this package, because a package of a submission may have the same name.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from typing import Any, List

import psutil

SET_PARENT_DEATH_SIGNAL, SET_CHILD_SUBREAPER = 1, 36  # of prctl(2)
POLL_PERIOD = 0.02  # [s]
STOPPED = 128 + signal.SIGTERM
PASSED_ON = (signal.SIGINT, signal.SIGUSR1, signal.SIGUSR2)


class Stop(BaseException):
    """SIGTERM, or the death of the parent."""


def stop(*_: Any) -> None:
    """Signal handler."""
    raise Stop


def end_descendants() -> None:
    """Kill all processes below this one until none is left."""
    while True:
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):
                process.kill()
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        with contextlib.suppress(Stop):
            signal.sigtimedwait([signal.SIGCHLD], POLL_PERIOD)


def run(parent: int, command: List[str]) -> int:
    """Run the command to its end; its exit code."""
    prctl = ctypes.CDLL(None).prctl
    prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        return STOPPED  # it died before it could be watched
    child = subprocess.Popen(command)
    for number in PASSED_ON:
        signal.signal(number, lambda number, _: os.kill(child.pid, number))
    while True:
        pid, status = os.waitpid(-1, 0)
        if pid == child.pid:
            return os.WEXITSTATUS(status) if os.WIFEXITED(status) else 128 + os.WTERMSIG(status)


def main() -> None:
    """Run `PARENT_PID COMMAND...` and leave nothing of it behind."""
    for number in (signal.SIGTERM, *PASSED_ON):
        signal.signal(number, stop)
    try:
        code = run(int(sys.argv[1]), sys.argv[2:])
    except Stop:
        code = STOPPED
    except OSError as error:
        print(error, file=sys.stderr)
        code = 127
    for number in (signal.SIGTERM, *PASSED_ON):
        signal.signal(number, signal.SIG_IGN)
    end_descendants()
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
