"""Lets pytest run the .test files here, each by rostest with a master of its own, and shows their cases."""

import ast
import os
import signal
import subprocess
import sys
import tempfile
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import pytest
from network import LAUNCH, PACKAGE, Ros

import husky_highlevel_controller
from husky_highlevel_controller.robot import ROBOTS

# pytest finds the sources first, and catkin makes the messages and services elsewhere
husky_highlevel_controller.__path__.extend(
    str(made) for made in (Path(path) / PACKAGE for path in sys.path) if (made / "srv").is_dir()
)

WALL_LIMIT = 360  # [s], for a rostest that hangs in spite of its own time limits
HERE = Path(__file__).parent


# those that take half a minute and more, the longest first: the others fill what is left of the workers' time
LONGEST = (
    "test_page_in_browser.py",
    "test_grade.py",
    "test_attacks.py",
    "test_bad_peer.py",
    "test_launch_command.py",
    "test_faults.py",
    "test_lockstep_repeats.py",
    "stops_after_crash.test",
    "test_sheets_launch_file.py",
    "test_smb_sheets.py",
    "test_processes.py",
    "drives_under_guard.test",
    "test_bag_gives_one_path.py",
)


def pytest_collection_modifyitems(items):
    def rank(item):
        name = item.path.name
        return LONGEST.index(name) if name in LONGEST else len(LONGEST)

    items.sort(key=rank)


def scripts_of(test_file):
    """Scripts whose cases a .test file runs, also those of a file that it includes."""
    tree = ElementTree.parse(test_file)
    for test in tree.iter("test"):
        yield from (HERE / f"test_{promise}.py" for promise in test.get("args").split())
    for include in tree.iter("include"):
        if "/test/ros/" in include.get("file"):
            yield from scripts_of(HERE / Path(include.get("file")).name)


def cases_of(script):
    """Class and method of each case of a script, in the order of their run."""
    for part in ast.parse(script.read_text()).body:
        if isinstance(part, ast.ClassDef):
            methods = sorted(each.name for each in part.body if isinstance(each, ast.FunctionDef))
            yield from ((part.name, method) for method in methods if method.startswith("test"))


collect_ignore = [
    "together.py",
    *{str(script) for file in HERE.glob("*.test") for script in scripts_of(file)},
]


@pytest.fixture
def ros(tmp_path):
    """A ROS network of its own."""
    network = Ros(tmp_path)
    yield network
    network.end()


@pytest.fixture
def launch(ros):
    """Starts a launch file as `./dev launch FILE` does."""

    def start(file, *arguments, **env):
        return ros.start(sys.executable, LAUNCH, str(file), "-p", str(ros.port), *arguments, **env)

    return start


def pytest_collect_file(parent, file_path):
    if file_path.suffix == ".test":
        return RosTestFile.from_parent(parent, path=file_path)
    return None


class RosTestFile(pytest.File):
    def collect(self):
        """The cases of one launch; again for each other robot where the file has an argument `robot`."""
        others = ROBOTS[1:] if '<arg name="robot" default=' in self.path.read_text() else ()
        for words, mark in [((), ""), *(((f"robot:={robot}",), f"[{robot}]") for robot in others)]:
            launch = RosTest(self.path, words)
            for script in scripts_of(self.path):
                for case in cases_of(script):
                    yield RosTestItem.from_parent(self, name="::".join(case) + mark, launch=launch, case=case)


class RosTestItem(pytest.Item):
    def __init__(self, *, launch, case, **kwargs):
        super().__init__(**kwargs)
        self.launch, self.case = launch, case

    def runtest(self):
        failure = self.launch.results.get(self.case, f"it did not run\n{self.launch.output}")
        if failure:
            raise RosTestError(f"{failure}\n{self.launch.logs}")

    def repr_failure(self, excinfo, style=None):
        if isinstance(excinfo.value, RosTestError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self):
        return self.path, 0, self.name


class RosTest:
    """One run of rostest, started by the first of its cases that is looked at."""

    output, logs = "", ""

    def __init__(self, path, arguments):
        self._command = ["rostest", str(path), *arguments]

    @cached_property
    def results(self):
        """What failed in each case; empty: nothing did."""
        with tempfile.TemporaryDirectory() as folder:
            return self._run(Path(folder))

    def _run(self, folder):
        # not with --text, which makes rostest exit with 0 whatever happens
        process = subprocess.Popen(
            self._command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            env={
                **os.environ,
                "ROS_LOG_DIR": str(folder / "log"),
                "ROS_TEST_RESULTS_DIR": str(folder / "results"),
            },
        )
        try:
            self.output, _ = process.communicate(timeout=WALL_LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            self.output = process.communicate()[0] + f"\nended after {WALL_LIMIT} s\n"
        warnings = [line for line in self.output.splitlines() if "[WARN" in line or "[ERROR" in line]
        files = sorted(folder.glob("log/**/*-stdout.log"))
        self.logs = "\n".join([*warnings, *(f"--- {path.name}\n{path.read_text()}" for path in files)])
        cases = [
            case
            for path in folder.glob("results/**/*.xml")
            for case in ElementTree.parse(path).iter("testcase")
        ]
        return {
            (case.get("classname").rsplit(".", 1)[-1], case.get("name")): "\n".join(
                part.text for part in case if part.tag in ("failure", "error")
            )
            for case in cases
        }


class RosTestError(Exception):
    """What failed, and what the nodes logged."""
