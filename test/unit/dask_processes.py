"""A Dask scheduler on a free port, and workers, as processes of a test."""

import ctypes
import json
import os
import signal
import subprocess
import sys
import time

import distributed

from husky_highlevel_controller.paths import share_folder

SOURCES = share_folder() / "src"
SET_PARENT_DEATH_SIGNAL = 1  # of prctl(2)
DEADLINE = 60.0  # [s] for a process to be up
WORKER = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0"]


def _die_with_parent():
    ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


class Processes:
    """A scheduler on a free port, and workers."""

    def __init__(self, folder):
        self.folder, self.started = folder, []
        file = folder / "scheduler.json"
        self.start("scheduler", ["dask_scheduler", "--port", "0", "--no-dashboard", "--host", "127.0.0.1",
                                 "--scheduler-file", str(file)])  # fmt: skip
        self.wait(lambda: file.exists() and file.read_text().strip().endswith("}"))
        self.address = json.loads(file.read_text())["address"]

    def start(self, name, words, path=SOURCES):
        log = self.folder / f"{name}.log"
        env = {**os.environ, "PYTHONPATH": str(path), "DASK_TEMPORARY_DIRECTORY": str(self.folder)}
        with log.open("wb") as output:
            command = [sys.executable, "-m", f"distributed.cli.{words[0]}", *words[1:]]
            how = dict(stdout=output, stderr=output, env=env, cwd=self.folder)
            self.started.append(subprocess.Popen(command, preexec_fn=_die_with_parent, **how))

    def work(self, name, *options, path=SOURCES):
        known = len(self.workers())
        self.start(name, ["dask_worker", self.address, "--name", name, *(options or WORKER)], path)
        self.wait(lambda: len(self.workers()) > known)

    def workers(self):
        with distributed.Client(self.address, set_as_default=False) as client:
            return client.scheduler_info(n_workers=-1)["workers"]

    def wait(self, condition):
        end = time.monotonic() + DEADLINE
        while not condition():
            logs = "\n".join(path.read_text() for path in self.folder.glob("*.log"))
            assert time.monotonic() < end, logs
            assert self.started[-1].poll() is None, logs
            time.sleep(0.1)

    def dismiss(self):
        """End the workers."""
        for process in self.started[1:]:
            process.kill()
            process.wait()
        del self.started[1:]
        if self.started[0].poll() is None:
            self.wait(lambda: not self.workers())

    def end(self):
        for process in self.started:
            process.kill()
            process.wait()
