"""ROS networks of their own, for the tests that start and kill processes."""

import contextlib
import itertools
import os
import signal
import socket
import subprocess
import time
from pathlib import Path
from xmlrpc.client import ServerProxy

import psutil

from husky_grading.isolation.process import pids_with_variable
from husky_highlevel_controller.paths import share_folder

PACKAGE = "husky_highlevel_controller"
LAUNCH = str(Path(__file__).resolve().parents[2] / "tools" / "launch.py")
DEADLINE = 120.0  # [s], for anything that hangs


def wait_until(condition, what, deadline=DEADLINE):
    end = time.monotonic() + deadline
    while not condition():
        assert time.monotonic() < end, f"waited {deadline} s until {what}"
        time.sleep(0.05)


# below the ports that the kernel gives to whoever wants any: roslaunch's own server once took its master's
_ports = itertools.count(20000 + os.getpid() % 10000)
_claims = []


def free_port():
    """A port that nobody uses, is given, or claims: pytest's workers claim theirs by UDP, until they end."""
    for port in _ports:
        claim = socket.socket(type=socket.SOCK_DGRAM)
        with socket.socket() as free, contextlib.suppress(OSError):
            claim.bind(("127.0.0.1", port))
            free.bind(("127.0.0.1", port))
            _claims.append(claim)
            return port
        claim.close()


class Process:
    """A process with its output in a file, in a session of its own."""

    def __init__(self, command, folder, env):
        self.log = folder / f"{len(list(folder.iterdir()))}.log"
        with self.log.open("w") as file:
            self.popen = subprocess.Popen(
                command,
                stdout=file,
                stderr=subprocess.STDOUT,
                env=env,
                start_new_session=True,
                # a shell's background jobs ignore it, and so would this
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            )

    @property
    def output(self):
        return self.log.read_text()

    def wait(self, deadline=DEADLINE):
        try:
            return self.popen.wait(deadline)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still running after {deadline} s: {self.output}") from None

    def says(self, words):
        wait_until(lambda: words in self.output or self.popen.poll() is not None, f"it says {words!r}")
        assert words in self.output, self.output


class Ros:
    """A ROS network of its own."""

    def __init__(self, folder):
        self.port = free_port()
        uri = f"http://127.0.0.1:{self.port}"
        self.env = {
            **os.environ,
            "ROS_MASTER_URI": uri,
            "ROS_IP": "127.0.0.1",
            "ROS_LOG_DIR": str(folder / "log"),
        }
        self.env.pop("DISPLAY", None)
        self.folder, self.uri, self.processes = folder, uri, []

    def start(self, *command, **env):
        self.processes.append(Process(command, self.folder, {**self.env, **env}))
        return self.processes[-1]

    def run(self, *command):
        """What a command prints; it must succeed."""
        return subprocess.run(
            command, check=True, stdout=subprocess.PIPE, text=True, env=self.env, timeout=DEADLINE
        ).stdout

    def call(self, service, *arguments):
        """What a service answers, as YAML."""
        return self.run("rosservice", "call", service, *arguments)

    def echo(self, topic, *options):
        """The next message of a topic, or the next value of a field in it."""
        return self.run("rostopic", "echo", "-n", "1", *options, topic).rpartition("---")[0].strip()

    def core(self):
        """A master that outlives the launches."""
        process = self.start("roscore", "-p", str(self.port))
        process.says("started core service")
        return process

    def roslaunch(self, file, *arguments, **env):
        return self.start("roslaunch", "-p", str(self.port), PACKAGE, file, "gui:=false", *arguments, **env)

    def rostest(self, file, *options, **env):
        """What `./dev run rostest` prints of a file with one test, which must pass."""
        command = (str(share_folder() / "dev"), "run", "rostest", *options, str(file))
        process = self.start(*command, ROS_TEST_RESULTS_DIR=str(self.folder / "results"), **env)
        assert process.wait() == 0, process.output
        assert "TESTS: 1" in process.output
        return process.output

    def master(self, call, *arguments):
        """What the master answers to a call of its API."""
        with ServerProxy(self.uri) as proxy:
            return getattr(proxy, call)("/test", *arguments)[2]

    def left(self):
        """Every process of this network that still runs, wherever roslaunch has put it."""
        for process in self.processes:
            process.popen.poll()  # or it would be there as a zombie
        return pids_with_variable("ROS_MASTER_URI", self.uri)

    def pids(self, executable):
        """Processes by what they run; one that has just ended runs nothing."""
        found = []
        for pid in self.left():
            with contextlib.suppress(psutil.NoSuchProcess):  # a zombie, too
                if any(word.endswith(f"/{executable}") for word in psutil.Process(pid).cmdline()):
                    found.append(pid)
        return found

    def end(self):
        wait_until(self._kill_left, "everything has ended")
        for process in self.processes:
            process.popen.wait()

    def _kill_left(self):
        """Whether nothing was left; a launch may have started its master since it was looked for."""
        left = self.left()
        for pid in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        return not left

    def subscriptions(self, node):
        """The topics a node subscribes to; empty while there is no master."""
        try:
            _, subscribers, _ = self.master("getSystemState")
        except OSError:
            return set()
        return {topic for topic, nodes in subscribers if node in nodes}


def make_package(folder, name, files):
    """A student's package: its texts by path; those in scripts/ can be executed."""
    manifest = (
        f'<package format="2"><name>{name}</name><version>0.0.1</version><description>x</description>'
        '<maintainer email="a@b.c">a</maintainer><license>BSD</license></package>'
    )
    for path, text in {"package.xml": manifest, **files}.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
        if path.startswith("scripts/"):
            (folder / path).chmod(0o755)
    return folder
