"""For every test: long-running ones are named, so that the suite is never silent for long."""

import os
import signal
import threading
import time

import pytest
from hypothesis import settings

QUIET = 20.0  # [s] without a line after which the tests that run are named

# properties try the same examples in every run, however long one takes
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("repeatable")


class Heartbeat:
    """Names the tests that are running when nothing was printed for a while."""

    def __init__(self, output):
        self._output, self._running, self._printed = output, {}, time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def pytest_runtest_logstart(self, nodeid):
        self._running[nodeid] = time.monotonic()

    def pytest_runtest_logfinish(self, nodeid):
        self._running.pop(nodeid, None)
        self._printed = time.monotonic()

    def pytest_unconfigure(self):
        self._ended.set()
        self._thread.join()
        self._output.close()

    def _watch(self):
        while not self._ended.wait(1.0):
            now = time.monotonic()
            if self._running and now - self._printed > QUIET:
                self._printed = now
                running = ", ".join(f"{test} ({now - since:.0f} s)" for test, since in self._running.items())
                print(f"\nstill running: {running}", file=self._output, flush=True)


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    # a closed terminal or a time limit ends the tests as Ctrl-C does: fixtures end the processes they started
    for ending in (signal.SIGHUP, signal.SIGTERM):
        signal.signal(ending, signal.default_int_handler)
    reporter = config.pluginmanager.getplugin("terminalreporter")
    if reporter and not hasattr(config, "workerinput"):
        # past pytest's capture, which takes whatever is printed while a test runs for the test's own
        with config.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
            output = os.fdopen(os.dup(1), "w")
        config.pluginmanager.register(Heartbeat(output), "heartbeat")


@pytest.fixture
def launch_files_read_here(monkeypatch):
    """Marking reads launch files by the program that starts submissions, here without a process for each."""
    from roslaunch import substitution_args

    from husky_grading.hand_in import plan
    from husky_grading.nodes import submission
    from husky_grading.submission import OWN_RVIZ
    from husky_highlevel_controller.paths import share_folder

    def describe(launchables, workspace, events, parts):
        places = [*map(str, workspace.packages), str(share_folder()), "/usr/share"]
        monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(places))
        monkeypatch.setattr(substitution_args, "_rospack", None)
        reporter = submission.Reporter(str(events))
        for launchable in launchables:
            ours = submission.OwnNames(nodes=[], rviz=OWN_RVIZ, files=[], places=[], **vars(parts))
            submission.describe(list(launchable.command), reporter, ours)
        reporter.close()
        return ""

    monkeypatch.setattr(plan, "_write_events", describe)
