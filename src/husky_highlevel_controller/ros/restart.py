"""Program that starts RViz if a display answers, and starts it once more if it crashes.

RViz 1.14 sometimes crashes at its start. In: the command line of RViz, because a launch file names this
program as the launch-prefix of RViz. Out: the exit code of RViz.

RViz opens a copy of its configuration file. Otherwise Ctrl+S would change the file in the checkout.

Measured on Debian 12 without a graphics card: 1 of 70 starts crashed while other programs kept the CPU busy,
and none of 65 starts without such programs. The renderer llvmpipe of Mesa damages the heap while it compiles.
The slower renderer softpipe (GALLIUM_DRIVER=softpipe) does not.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, List, Optional, Sequence

CONFIG_OPTION = "-d"  # option of RViz, which is followed by the configuration file
LOG = "__log:="  # beginning of the argument with the file of the log, which roslaunch gives to every node
# exit codes of a crashed program, which are the negative numbers of signals
CRASHES = {-signal.SIGABRT, -signal.SIGSEGV, -signal.SIGBUS}
DISPLAY_TIMEOUT = 2.0  # [s] longest wait for a connection to a display on another machine


def display_problem(display: str) -> Optional[str]:
    """Return a sentence on an X display that cannot be reached; None if it answers.

    Args:
        display: value of DISPLAY: `:N` on this machine, `HOST:N` by TCP. An empty value and other forms are
            not checked, and cause no sentence.
    """
    # a local display is :N or :N.SCREEN, and may begin with "unix"; a display on the network is HOST:N or
    # HOST:N.SCREEN
    address = re.fullmatch(
        r"(?:unix)?:(?P<local>\d+)(?:\.\d+)?|(?P<host>[\w.-]+):(?P<number>\d+)(?:\.\d+)?", display
    )
    if address is None:
        return None
    try:
        if address["host"]:
            port = 6000 + int(address["number"])  # TCP port of an X11 display
            socket.create_connection((address["host"], port), DISPLAY_TIMEOUT).close()
        else:
            _connect_to_local_display(int(address["local"]))
    except (OSError, OverflowError) as error:
        return f"display {display} does not answer ({getattr(error, 'strerror', None) or error})"
    return None


def _connect_to_local_display(number: int) -> None:
    """Connect to the X server of a display on this machine; ConnectionRefusedError if it does not answer."""
    path = f"/tmp/.X11-unix/X{number}"
    # an X server listens on a socket in the file system, or on an abstract socket, whose name begins with \0
    for name in (path, f"\0{path}"):
        with socket.socket(socket.AF_UNIX) as connection:
            if connection.connect_ex(name) == 0:
                return
    raise ConnectionRefusedError(0, "no X server")


def run_again_after_crash(command: Sequence[str]) -> int:
    """Run a command, and run it once more if it crashes; pass SIGINT and SIGTERM on to its process.

    Returns:
        Exit code of the last run; negative if a signal ended it.
    """
    stop_signal = 0  # number of the signal that this program has received; 0 if it has received none
    process: Optional[subprocess.Popen] = None

    def pass_on(number: int, _frame: Any) -> None:
        """Send a signal to the program, and remember that it must not be started again."""
        nonlocal stop_signal
        stop_signal = number
        if process is not None:
            process.send_signal(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        # the handler is set before the program starts, so that no signal is lost
        signal.signal(number, pass_on)
    for attempt in (1, 2):
        process = subprocess.Popen(list(command))
        if stop_signal:  # the signal came before `process` was set, so it was not passed on
            process.send_signal(stop_signal)
        # negative number of the signal that ended the program, otherwise its exit code
        code = process.wait()
        has_crashed = code in CRASHES
        if not has_crashed or stop_signal or attempt == 2:
            break
        name = Path(command[0]).name
        print(f"{name} crashed with {signal.Signals(-code).name}; starting it once more", file=sys.stderr)
    return code


def with_own_config(command: Sequence[str]) -> List[str]:
    """Copy the configuration file of RViz, and return the command line with the copy in place of the file.

    So RViz saves into the copy, and does not change the original. The copy is written next to the file of the
    log. The command line stays as it is if it has no configuration file (`-d FILE`), if it has no log
    (`__log:=FILE`), or if the file cannot be copied.
    """
    words = list(command)
    log = None
    for word in words:
        if word.startswith(LOG):  # roslaunch gives this argument to every node
            log = word[len(LOG) :]
            break
    if log is None or CONFIG_OPTION not in words[:-1]:  # a -d in the last word has no file behind it
        return words
    config_index = words.index(CONFIG_OPTION) + 1
    config, copy = Path(words[config_index]), Path(log).with_suffix(".rviz")
    try:
        shutil.copyfile(config, copy)
    except OSError:  # RViz itself reports a file that does not exist
        return words
    print(f"RViz shows a copy of {config.name}; Ctrl+S saves to {copy}", file=sys.stderr)
    words[config_index] = str(copy)
    return words


def main() -> None:
    """Run the command line in the arguments of this program, if its display answers."""
    problem = display_problem(os.environ.get("DISPLAY", ""))
    if problem:
        raise SystemExit(f"{Path(sys.argv[1]).name} is not started: {problem}")
    code = run_again_after_crash(with_own_config(sys.argv[1:]))
    raise SystemExit(code if code >= 0 else 128 - code)  # 128 + the signal, as a shell reports it
