"""Lets pytest run the .test files here, each by rostest with a master of its own."""

import os
import re
import signal
import subprocess
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from network import Ros

from husky_highlevel_controller.robot import ROBOTS

WALL_LIMIT = 240  # [s], for a rostest that hangs in spite of its own time limits
HERE = os.path.dirname(__file__)
ROSTEST_SCRIPTS = [name[:-5] for name in os.listdir(HERE) if name.endswith(".test")]
collect_ignore = [f"test_{promise}.py" for promise in ROSTEST_SCRIPTS]


@pytest.fixture
def ros(tmp_path):
    """A ROS network of its own."""
    network = Ros(tmp_path)
    yield network
    network.end()


def pytest_collect_file(parent, file_path):
    if file_path.suffix == ".test":
        return RosTestFile.from_parent(parent, path=file_path)
    return None


class RosTestFile(pytest.File):
    def collect(self):
        """Once, or for each robot where the file has an argument `robot`."""
        robots = ROBOTS if '<arg name="robot" default=' in self.path.read_text() else ()
        yield RosTestItem.from_parent(self, name=self.path.stem, arguments=())
        for robot in robots[1:]:
            yield RosTestItem.from_parent(
                self, name=f"{self.path.stem}[{robot}]", arguments=(f"robot:={robot}",)
            )


class RosTestItem(pytest.Item):
    def __init__(self, *, arguments, **kwargs):
        super().__init__(**kwargs)
        self.arguments = arguments

    def runtest(self):
        with tempfile.TemporaryDirectory() as folder:
            self.run_rostest(Path(folder))

    def run_rostest(self, folder):
        # not with --text, which makes rostest exit with 0 whatever happens
        process = subprocess.Popen(
            ["rostest", str(self.path), *self.arguments],
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
            output, _ = process.communicate(timeout=WALL_LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output = process.communicate()[0] + f"\nended after {WALL_LIMIT} s\n"
        ran = re.search(r"TESTS: (\d+)", output)
        if process.returncode != 0 or not ran or ran.group(1) == "0":
            raise RosTestError(why_it_failed(folder, output))

    def repr_failure(self, excinfo, style=None):
        if isinstance(excinfo.value, RosTestError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self):
        return self.path, 0, self.name


def why_it_failed(folder, output):
    """The failed cases and what the nodes logged; all that rostest printed where no case says why."""
    cases = [
        case for path in folder.glob("results/**/*.xml") for case in ElementTree.parse(path).iter("testcase")
    ]
    failures = [
        f"{case.get('name')}: {found.text}"
        for case in cases
        for kind in ("failure", "error")
        for found in case.findall(kind)
    ]
    logs = [f"--- {path.name}\n{path.read_text()}" for path in sorted(folder.glob("log/**/*-stdout.log"))]
    return "\n".join([*(dict.fromkeys(failures) or [output]), *logs])


class RosTestError(Exception):
    """What rostest printed."""
