"""Runs a program, and once more if it crashes: RViz 1.14 aborts now and then while it starts.

In: a command line, as roslaunch's launch-prefix hands it over. Out: the program's exit code.
Must not know: what the program does.

Measured on Debian 12 without a graphics card: 1 of 70 starts beside busy loops crashed, none of 65
without them. Mesa's llvmpipe damages the heap while it compiles; its softpipe, slower, does not
(GALLIUM_DRIVER=softpipe).
"""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, Sequence

CRASHES = {-signal.SIGABRT, -signal.SIGSEGV, -signal.SIGBUS}  # exit codes of subprocess


def run(command: Sequence[str]) -> int:
    """Run a command, a second time if a crash ended it; SIGINT and SIGTERM are passed on.

    Args:
        command: the program and its arguments.

    Returns:
        Its exit code; negative where a signal ended it.
    """
    stopping = False
    for attempt in (1, 2):
        process = subprocess.Popen(list(command))

        def pass_on(number: int, _frame: Any, process: subprocess.Popen = process) -> None:
            nonlocal stopping
            stopping = True
            process.send_signal(number)

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, pass_on)
        code = process.wait()
        if code not in CRASHES or stopping or attempt == 2:
            break
        name = Path(command[0]).name
        print(f"{name} crashed with {signal.Signals(-code).name}; starting it once more", file=sys.stderr)
    return code


def main() -> None:
    """Run the command line."""
    code = run(sys.argv[1:])
    raise SystemExit(code if code >= 0 else 128 - code)
