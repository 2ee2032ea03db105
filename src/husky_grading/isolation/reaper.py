"""Program that runs a command and ends every process that it leaves: `reaper.py PARENT_PID COMMAND...`.

It is a child subreaper (prctl(2)), so orphans become its children, and it finds all of them. It ends with the
command, on SIGTERM, or when the process that started it ends. It forwards SIGINT, SIGUSR1 and SIGUSR2 to the
command. It is started by its path and imports nothing of this package, because a submitted package may have
the same name.

The signals in SIGNALS are blocked, and `sigwait` takes them one by one. So none of them interrupts a step of
this program, and none is forwarded after the command has ended.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from typing import List, Optional

import psutil

SET_PARENT_DEATH_SIGNAL, SET_CHILD_SUBREAPER = 1, 36  # options of prctl(2)
POLL_PERIOD = 0.02  # [s]
STOPPED, CANNOT_START = 128 + signal.SIGTERM, 127  # exit codes that a shell also uses
SIGNALS = {signal.SIGCHLD, signal.SIGTERM, signal.SIGINT, signal.SIGUSR1, signal.SIGUSR2}


def end_descendants() -> None:
    """Kill all descendants of this program until none is left."""
    while True:
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):
                process.kill()
        # a killed process remains until its parent calls waitpid; -1 means any child of this program
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:  # no child is left
            return
        # orphans of killed processes have become children, so the loop kills again
        signal.sigtimedwait([signal.SIGCHLD], POLL_PERIOD)


def run_and_reap(parent: int, command: List[str]) -> int:
    """Run a command, and return its exit code; STOPPED after SIGTERM, or if the parent has ended.

    Other signals are passed on to the command. Processes that the command leaves behind become children of
    this program.
    """
    # signals that were blocked before this line. The command gets this old set back, because a child process
    # would otherwise inherit the blocked signals of this program.
    old_mask = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    prctl = ctypes.CDLL(None).prctl
    prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        return STOPPED  # the parent ended before prctl was called, so no signal will report its end
    child = subprocess.Popen(command, preexec_fn=lambda: signal.pthread_sigmask(signal.SIG_SETMASK, old_mask))
    while True:
        received = signal.sigwait(SIGNALS)
        # SIGCHLD and SIGTERM are for this program, and the other signals are for the command
        is_for_command = received not in (signal.SIGCHLD, signal.SIGTERM)
        number = forward(received, child.pid) if is_for_command else received
        if number == signal.SIGTERM:
            return STOPPED
        if number == signal.SIGCHLD:
            code = reap(child.pid)
            if code is not None:
                return code


def forward(number: int, pid: int) -> Optional[int]:
    """Send a signal to the command, pause for POLL_PERIOD, and return the signal that ended the pause early.

    Only SIGCHLD or SIGTERM ends the pause early. Otherwise None is returned.

    Without the pause, a flood of signals would keep the command from running. It would also hide the
    command's end, because sigwait returns SIGINT before SIGCHLD.
    """
    # the pid belongs to the child until waitpid is called, even if the child has ended, so the signal
    # reaches no other program
    os.kill(pid, number)
    arrived = signal.sigtimedwait({signal.SIGCHLD, signal.SIGTERM}, POLL_PERIOD)
    return None if arrived is None else arrived.si_signo


def reap(command_pid: int) -> Optional[int]:
    """Take the ended child processes, and return the exit code of the command; None if it still runs.

    One SIGCHLD may report the end of several processes, so the loop asks until no ended process is left.
    """
    pid, status = os.waitpid(-1, os.WNOHANG)
    while pid:
        if pid == command_pid:  # other pids are of orphans
            return os.WEXITSTATUS(status) if os.WIFEXITED(status) else 128 + os.WTERMSIG(status)
        pid, status = os.waitpid(-1, os.WNOHANG)
    return None


def main() -> None:
    """Run the COMMAND of the command line, and end all processes that it leaves."""
    try:
        code = run_and_reap(int(sys.argv[1]), sys.argv[2:])
    except OSError as error:
        print(error, file=sys.stderr)
        code = CANNOT_START
    end_descendants()
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
