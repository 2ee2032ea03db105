"""A ROS network of one's own: starts processes, reads what they cost, ends every one of them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

HERE = Path(__file__).parent
PACKAGE = "husky_highlevel_controller"
DEADLINE = 60.0  # [s] of wall time, for anything that hangs
GLANCE = 0.01  # [s] of wall time between two looks
TICK = os.sysconf("SC_CLK_TCK")  # [Hz], of the CPU times in /proc


class BenchError(Exception):
    """A measurement that did not come about; the text says what happened instead."""


class Network:
    """A master on a free port, and whatever is started on it; ends them all on leaving."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = str(free.getsockname()[1])
        self._uri = f"http://127.0.0.1:{self._port}"
        own = {"ROS_MASTER_URI": self._uri, "ROS_IP": "127.0.0.1", "ROS_LOG_DIR": str(folder / "log")}
        self._env = {**os.environ, **own}
        self._env.pop("DISPLAY", None)
        self._folder = folder
        self._processes: List[subprocess.Popen] = []
        self._probes: Dict[Path, subprocess.Popen] = {}  # by where their figures will be

    def __enter__(self) -> Network:
        self.start("roscore", "-p", self._port)
        self.wait(["rosparam", "get", "/run_id"])
        return self

    def __exit__(self, *_: object) -> None:
        # roslaunch ends its nodes itself, but only in several seconds; nothing here is worth the wait
        for pid in self.pids():
            _kill(pid)
        for process in self._processes:
            process.wait()

    def start(self, *command: str) -> subprocess.Popen:
        """Start a process whose output goes into a file."""
        with (self._folder / f"{len(self._processes)}.log").open("w") as log:
            process = subprocess.Popen(
                command, stdout=log, stderr=log, env=self._env, cwd=self._folder, start_new_session=True
            )
        self._processes.append(process)
        return process

    def launch(self, file: str, *arguments: str) -> None:
        """Start a launch file of this package, without windows."""
        self.start("roslaunch", "-p", self._port, PACKAGE, file, "gui:=false", *arguments)

    def launch_text(self, text: str) -> None:
        """Start what a launch file of this text says."""
        file = self._folder / f"bench_{len(self._processes)}.launch"
        file.write_text(text)
        self.start("roslaunch", "-p", self._port, str(file))

    def probe(self, *arguments: str) -> Path:
        """Start probe.py; returns the file in which its figures will be."""
        result = self._folder / f"{len(self._processes)}.json"
        self._probes[result] = self.start(sys.executable, str(HERE / "probe.py"), str(result), *arguments)
        return result

    def read(self, result: Path) -> Dict[str, Any]:
        """Wait for the figures of a probe."""
        self._until(lambda: self._probes[result].poll() is not None, "a probe has its figures")
        if not result.exists():
            raise self._error("a probe has failed")
        found: Dict[str, Any] = json.loads(result.read_text())
        return found

    def wait(self, command: Sequence[str]) -> None:
        """Wait until a command succeeds."""
        self._until(
            lambda: subprocess.run(command, env=self._env, capture_output=True, check=False).returncode == 0,
            " ".join(command),
        )

    def pids(self, script: str = "") -> List[int]:
        """Every process of this network, wherever roslaunch has put it, or those that run a script."""
        mark = f"ROS_MASTER_URI={self._uri}".encode()
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                ours = mark in (item.rstrip(b"/") for item in (entry / "environ").read_bytes().split(b"\0"))
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:  # it has just ended, or is somebody else's
                continue
            if ours and (not script or script in (os.path.basename(word.decode()) for word in words)):
                found.append(int(entry.name))
        return found

    def pid(self, script: str) -> int:
        """The one process that runs a script."""
        (found,) = self.pids(script)
        return found

    def _until(self, condition: Any, what: str) -> None:
        end = time.monotonic() + DEADLINE
        while not condition():
            if time.monotonic() > end:
                raise self._error(f"waited {DEADLINE:g} s until {what}")
            time.sleep(GLANCE)

    def _error(self, what: str) -> BenchError:
        logs = [path.read_text()[-500:] for path in sorted(self._folder.glob("*.log"))]
        return BenchError("\n".join([what, *logs]))


def cpu_seconds(pid: int) -> float:
    """What a process has used of the CPU so far, all its threads [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def peak_megabytes(pid: Optional[int] = None) -> float:
    """The most memory that a process, or this one, has had at a time [MB]."""
    status = Path(f"/proc/{pid or 'self'}/status").read_text().splitlines()
    (peak,) = (line.split()[1] for line in status if line.startswith("VmHWM:"))
    return int(peak) * 1024 / 1e6


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
