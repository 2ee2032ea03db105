"""Marking's own ROS programs, forked from a process that has imported their common modules.

In: module and arguments. Out: running processes with the methods of `Process`, which start in milliseconds.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import Any, Dict, Iterator, Optional, Sequence

from husky_grading.isolation.process import Process

_NODES, _SIMULATOR = "husky_grading.nodes.", "husky_highlevel_controller.ros.simulator."
MASTER, RECORDER, SIMULATOR_SETUP = (_NODES + name for name in ("master", "recorder", "simulator_setup"))
SIMULATOR, BAG_PLAYER = _SIMULATOR + "node", _SIMULATOR + "bag_player"
# Python modules that run as programs of their own; each module has a function main()
MODULES = (MASTER, RECORDER, SIMULATOR, SIMULATOR_SETUP, BAG_PLAYER)
# lock that lets one thread at a time replace `__main__`, which each start of a program does for a moment
_SCRIPT_LOCK = threading.Lock()
STDOUT, STDERR = 1, 2  # file descriptors of the output streams of each program
_CONTEXT = multiprocessing.get_context("forkserver")


def import_early() -> None:
    """Start the process from which our programs are forked; it imports their modules in the background.

    If this is called long before a program starts, the program need not wait for its imports.
    """
    # All programs in MODULES are forked from one server process, which imports their modules only once. It
    # does not import the bag player, because the other programs do not need the modules of the bag player.
    _CONTEXT.set_forkserver_preload([name for name in MODULES if name != BAG_PLAYER])
    forkserver.ensure_running()


class ForkedProcess(Process):
    """Program from MODULES; it starts no other program, and ends when this program ends."""

    def __init__(
        self, command: Sequence[str], log: Path, env: Dict[str, str], folder: Path, handed: Sequence[Any] = ()
    ) -> None:
        """Start the program as `Process` does; main() gets the arguments `handed`, such as a connection."""
        self._handed = handed
        super().__init__(command, log, env, folder)

    def _popen(self, command: Sequence[str], env: Dict[str, str], folder: Path) -> Any:
        """Fork the program; `Process` calls this in place of starting a command."""
        return _Child(command, env, folder, self._handed)


class _Child:
    """Forked program with the methods of subprocess.Popen that `Process` calls."""

    def __init__(
        self, command: Sequence[str], env: Dict[str, str], folder: Path, handed: Sequence[Any] = ()
    ) -> None:
        """Fork the program. Its output comes through a pipe.

        Args:
            command: module of MODULES, and its arguments.
            env: environment.
            folder: working directory.
            handed: arguments for the function main() of the module.
        """
        import_early()  # starts the process that forks the program, if it does not run yet
        # pipe from the program's output to this process
        read_descriptor, write_descriptor = os.pipe()
        self.stdout = open(read_descriptor, "rb", buffering=0)  # noqa: SIM115 - `Process._read` closes it
        # a Connection, because `multiprocessing` cannot send a plain file descriptor to the program
        output = Connection(write_descriptor)
        # The program gets a copy of `output`. Our `output` is closed after the start, because the pipe ends
        # only when every copy is closed.
        with output, _hidden_main_script():
            arguments = (command, env, folder, output, handed)
            self._process = _CONTEXT.Process(target=_run, args=arguments, daemon=True)
            self._process.start()
        # the id of a started process is never None; `or 0` tells this to mypy
        self.pid = self._process.pid or 0

    def poll(self) -> Optional[int]:
        """Return the exit code of the program, or None while it runs."""
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal to the program, if it still runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Kill the program."""
        self._process.kill()

    def wait(self, timeout: float) -> None:
        """Wait for the end of the program.

        Raises:
            subprocess.TimeoutExpired: the program did not end within `timeout` [s].
        """
        self._process.join(timeout)
        if self.poll() is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout)


@contextmanager
def _hidden_main_script() -> Iterator[None]:
    """Put an empty module in the place of our main script; otherwise a child process would run it again."""
    with _SCRIPT_LOCK:
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = script


def _run(
    command: Sequence[str], env: Dict[str, str], folder: Path, output: Connection, handed: Sequence[Any]
) -> None:
    """Turn the forked process into the program of a command: set it up, and call main() of its module.

    stdout and stderr go to `output`. main() gets the arguments `handed`, such as a connection.
    """
    # in a session of its own, this program gets no Ctrl-C from the terminal, and `kill` ends its whole group
    os.setsid()
    threading.Thread(target=_end_with_marking, daemon=True).start()
    os.environ.clear()
    os.environ.update(env)
    os.chdir(folder)
    for stream in (STDOUT, STDERR):
        os.dup2(output.fileno(), stream)
    output.close()
    module, *_ = command
    sys.argv = list(command)
    importlib.import_module(module).main(*handed)


def _end_with_marking() -> None:
    """Kill this program when marking has ended.

    The kernel could send this program a signal only at the end of the process that has forked it, and that is
    the server process, not marking. So a thread of this program waits for the end of marking.
    """
    # for `multiprocessing`, marking is the parent, because marking has asked the server process to fork
    marking = multiprocessing.parent_process()
    assert marking is not None
    marking.join()
    os.kill(os.getpid(), signal.SIGKILL)
