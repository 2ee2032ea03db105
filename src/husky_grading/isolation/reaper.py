"""Runs a command and ends every process it leaves behind: `reaper.py PARENT_PID COMMAND...`.

A child subreaper (prctl(2)): orphans below become children of this process, so all are found by their
parents. It ends with the command, on SIGTERM, or when the process that started it dies, by whatever signal.
SIGINT, SIGUSR1 and SIGUSR2 are passed on to the command. It is started by its path and imports nothing of
this package, because a package of a submission may have the same name.

Signals are blocked and waited for: none interrupts anything, and none is passed on after the command's end.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from typing import List

import psutil

SET_PARENT_DEATH_SIGNAL, SET_CHILD_SUBREAPER = 1, 36  # options of prctl(2)
POLL_PERIOD = 0.02  # [s]
STOPPED = 128 + signal.SIGTERM
SIGNALS = {signal.SIGCHLD, signal.SIGTERM, signal.SIGINT, signal.SIGUSR1, signal.SIGUSR2}


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
        signal.sigtimedwait([signal.SIGCHLD], POLL_PERIOD)


def run_and_reap(parent: int, command: List[str]) -> int:
    """Run the command to its end; its exit code."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    prctl = ctypes.CDLL(None).prctl
    prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        return STOPPED  # it died before it could be watched
    child = subprocess.Popen(command, preexec_fn=lambda: signal.pthread_sigmask(signal.SIG_SETMASK, before))
    while True:
        number = signal.sigwait(SIGNALS)
        if number == signal.SIGTERM:
            return STOPPED
        if number != signal.SIGCHLD:
            os.kill(child.pid, number)  # at worst a zombie, so the number has no other process
            continue
        pid, status = os.waitpid(-1, os.WNOHANG)
        while pid:
            if pid == child.pid:
                return os.WEXITSTATUS(status) if os.WIFEXITED(status) else 128 + os.WTERMSIG(status)
            pid, status = os.waitpid(-1, os.WNOHANG)


def main() -> None:
    """Run `PARENT_PID COMMAND...` and leave nothing of it behind."""
    try:
        code = run_and_reap(int(sys.argv[1]), sys.argv[2:])
    except OSError as error:
        print(error, file=sys.stderr)
        code = 127
    end_descendants()
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
