"""Private ROS network: a master on a free port, programs that use it, and their end.

In: programs to start. Out: processes that use one master.
"""

from __future__ import annotations

import os
import socket
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from husky_grading.isolation.forked import MASTER, MODULES, ForkedProcess
from husky_grading.isolation.process import Process, end_all, wait
from husky_grading.isolation.sandbox import Workspace, clean_environment
from husky_highlevel_controller.datatypes import HuskyError

# [s] if one of our programs has not started after this wall time, marking fails; the time is long, because
# the machine may be very busy
START_DEADLINE = 600.0
START_ATTEMPTS = 10  # at most this number of ports is tried for a ROS master


class MarkingError(HuskyError):
    """Marking itself does not work on this machine, which is not a fault of the submission."""


class Network:
    """ROS master in a folder of its own, and its programs, which all end when it is closed."""

    # command that starts the ROS master; the port is added later
    master: Tuple[str, ...] = (MASTER, "--core")

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.processes: List[Process] = []
        try:
            self._start_master()
        except BaseException:  # every error, such as Ctrl-C, ends the programs that were started
            self.close()
            raise

    def _start_master(self) -> None:
        """Start the master on a free port, and set `port` and `uri`.

        Raises:
            MarkingError: the master does not start.
        """
        # several attempts, because another program may take the free port first
        for _ in range(START_ATTEMPTS):
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                _, self.port = free.getsockname()
            self.uri = f"http://127.0.0.1:{self.port}"
            master = self.start("master", [*self.master, "-p", str(self.port)])
            if wait(partial(_has_started_or_ended, master, self.port), START_DEADLINE) and master.running:
                return
        raise MarkingError(f"{self.master[0]} does not start: " + self.processes[-1].output.strip()[-300:])

    def variables(self) -> Dict[str, str]:
        """Return the environment variables of a program that uses this master."""
        return {
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",  # nodes reach each other without a look-up of this machine's name
            "ROS_LOG_DIR": str(self.folder / "log"),
            "ROS_HOME": str(self.folder / "ros_home"),
            # with these two variables, each line of output is in the log at once
            "PYTHONUNBUFFERED": "1",
            "ROSCONSOLE_STDOUT_LINE_BUFFERED": "1",
        }

    def folder_of(self, name: str) -> Path:
        """Make the working directory of an untrusted program, and return it; it may write only there."""
        folder = self.folder / name
        for path in (folder, folder / "home"):
            path.mkdir(exist_ok=True)
        return folder

    def start(
        self,
        name: str,
        command: Sequence[str],
        workspace: Optional[Workspace] = None,
        handed: Sequence[Any] = (),
        **more: str,
    ) -> Process:
        """Start a program that uses this network's ROS master, and return its process.

        Args:
            name: name of the program's log, and of its folder if the program is untrusted.
            command: program and arguments; or one of the MODULES, and arguments.
            workspace: workspace of an untrusted program, which runs in the sandbox; None for our programs.
            handed: arguments for the main() of one of the MODULES, such as a connection.
            **more: further variables of its environment.
        """
        # an untrusted program must not get passwords or tokens that are in our environment
        env = dict(os.environ) if workspace is None else clean_environment()
        # no program may open a window, or use names from the teacher's own ROS network
        for unwanted in ("DISPLAY", "ROS_HOSTNAME", "ROS_NAMESPACE", "WAYLAND_DISPLAY"):
            env.pop(unwanted, None)
        folder = self.folder if workspace is None else self.folder_of(name)
        env.update(self.variables(), **more)
        if workspace is not None:
            env.update(
                HOME=str(folder / "home"), ROS_HOME=str(folder / "ros_home"), ROS_LOG_DIR=str(folder / "log")
            )
            # `self.folder` is hidden, because it has logs and files of other programs. Only the program's own
            # folder inside it stays visible.
            workspace = replace(workspace, hidden=(*workspace.hidden, self.folder))
        log = self.folder / f"{name}.log"
        process: Process
        if command[0] in MODULES:
            process = ForkedProcess(command, log, env, folder, handed)
        else:
            process = Process(command, log, env, folder, workspace)
        self.processes.append(process)
        return process

    def close(self) -> None:
        """End all programs.

        Raises:
            MarkingError: a process cannot be ended.
        """
        survivors = end_all(self.processes)
        if survivors:
            raise MarkingError(f"processes {survivors} cannot be ended")

    def __enter__(self) -> Network:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _has_started_or_ended(master: Process, port: int) -> bool:
    """Return whether the wait for a master is over, because it has ended, or listens on its port."""
    with socket.socket() as probe:
        return not master.running or probe.connect_ex(("127.0.0.1", port)) == 0
