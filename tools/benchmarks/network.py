"""Private ROS network of a benchmark: starts launch files and probes, measures CPU time and memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable, Dict, Optional, Sequence

import psutil

from husky_grading.isolation import ros_network
from husky_grading.isolation.process import Process, pids_with_variable, wait

HERE = Path(__file__).parent
PACKAGE = "husky_highlevel_controller"
DEADLINE = 60.0  # [s] wall time after which a program counts as hung
POLL_PERIOD = 0.01  # [s] wall time between two looks


class BenchError(Exception):
    """Failure of a measurement; the text has the reason, and the last output of each process."""


class Network(ros_network.Network):
    """A roscore on a free port, and all processes that are started on it; all end with the block."""

    master = ("roscore",)

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._probes: Dict[Path, Process] = {}  # probes by the file of their figures
        self.wait(["rosparam", "get", "/run_id"])

    def variables(self) -> Dict[str, str]:
        """Return the variables as in marking, but with the user's own ROS_HOME, whose caches are warm."""
        return {name: value for name, value in super().variables().items() if name != "ROS_HOME"}

    def launch(self, file: str, *arguments: str) -> None:
        """Start a launch file of this package, without windows."""
        self._roslaunch(PACKAGE, file, "gui:=false", *arguments)

    def launch_text(self, text: str) -> None:
        """Start the nodes of a launch file with this text."""
        file = self.folder / f"bench_{len(self.processes)}.launch"
        file.write_text(text)
        self._roslaunch(str(file))

    def _roslaunch(self, *arguments: str) -> None:
        """Start roslaunch on the master of this network."""
        self.start(str(len(self.processes)), ["roslaunch", "-p", str(self.port), *arguments])

    def probe(self, *arguments: str) -> Path:
        """Start probe.py, and return the file into which it will write its figures."""
        name = str(len(self.processes))
        result = self.folder / f"{name}.json"
        command = [sys.executable, str(HERE / "probe.py"), str(result), *arguments]
        self._probes[result] = self.start(name, command)
        return result

    def read(self, result: Path) -> Dict[str, Any]:
        """Wait for the figures of a probe."""
        self._until(lambda: not self._probes[result].running, "a probe has its metrics")
        if not result.exists():
            raise self._error("a probe has failed")
        found: Dict[str, Any] = json.loads(result.read_text())
        return found

    def wait(self, command: Sequence[str]) -> None:
        """Wait until a command succeeds."""
        env = {**os.environ, **self.variables()}
        self._until(
            lambda: subprocess.run(command, env=env, capture_output=True, check=False).returncode == 0,
            " ".join(command),
        )

    def pid(self, script: str) -> int:
        """Return the number of the only process of this network that runs a script."""
        pids = []
        for pid in pids_with_variable("ROS_MASTER_URI", self.uri):
            words = psutil.Process(pid).cmdline()
            if script in [os.path.basename(word) for word in words]:
                pids.append(pid)
        (only_pid,) = pids  # an error if there is not exactly one
        return only_pid

    def _until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until a condition is true; `what` says in an error for what it waited."""
        if not wait(condition, DEADLINE, POLL_PERIOD):
            raise self._error(f"waited {DEADLINE:g} s until {what}")

    def _error(self, what: str) -> BenchError:
        """Return an error with the last output of each process."""
        return BenchError("\n".join([what, *(process.output[-500:] for process in self.processes)]))


def cpu_seconds(pid: int) -> float:
    """Return the CPU time of all threads of a process so far [s]."""
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


def peak_megabytes(pid: Optional[int] = None) -> float:
    """Return the largest memory that a process, by default this one, has had so far [MB]."""
    status = Path(f"/proc/{pid or 'self'}/status").read_text().splitlines()
    (line,) = [line for line in status if line.startswith("VmHWM:")]  # such as "VmHWM:   123456 kB"
    return int(line.split()[1]) * 1024 / 1e6
