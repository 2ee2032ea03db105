"""Reaper: the exit code of a program is the program's, whatever signals come at its end."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from husky_grading.isolation import reaper

DEADLINE = 60.0  # [s]


def reap(script):
    """Exit code and output of a script below the reaper, which is its parent."""
    command = [sys.executable, str(Path(reaper.__file__)), str(os.getpid()), "/bin/bash", "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        try:
            output, _ = program.communicate(timeout=DEADLINE)
        finally:
            program.kill()  # otherwise a program that hangs would be waited for without a deadline
    return program.returncode, output


@pytest.mark.parametrize("name", ["INT", "USR1"])
def test_a_signal_at_the_end_of_a_program_does_not_change_its_exit_code(name):
    script = f"trap '' INT USR1; (while kill -{name} $PPID; do :; done) & sleep 0.1; exit 7"
    assert {reap(script)[0] for _ in range(10)} == {7}


def test_a_signal_is_passed_on_and_the_program_blocks_no_more_than_its_parent():
    script = "grep SigBlk /proc/self/status; trap 'exit 5' USR1; kill -USR1 $PPID; sleep 60 & wait"
    code, output = reap(script)
    assert code == 5
    ours = [line for line in Path("/proc/self/status").read_text().splitlines() if "SigBlk" in line]
    assert output.splitlines() == ours


def test_sigterm_ends_the_program_and_what_it_leaves_behind():
    assert reap("sleep 60 & kill -TERM $PPID; sleep 60")[0] == 128 + signal.SIGTERM
