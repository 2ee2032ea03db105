"""`pip install .`: the library and its commands in a virtual environment without ROS or catkin."""

import ast
import re
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [ROOT / "src" / name for name in ("husky_highlevel_controller", "husky_evaluation")]
COMMANDS = ("evaluate", "sweep", "tune", "compare")
NAMES = {"yaml": "pyyaml"}  # of a module and of the package that brings it, where they differ
ROS_OF_A_HAND_IN = {"catkin_pkg", "rospy", "roslib", "rosgraph", "roslaunch", "rospkg", "genpy"}


def run(folder, *command):
    done = subprocess.run(
        [folder / "bin" / "python", *command],
        cwd=folder, env={"PATH": "/usr/bin"}, capture_output=True, text=True, timeout=300.0, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A virtual environment that sees this one's packages, but no ROS; the library is in it."""
    pytest.importorskip("hatchling", reason="./dev test installs it")
    folder = tmp_path_factory.mktemp("bare")
    venv.create(folder)
    # Python does not read .pth files in a folder that a .pth file names, such as Debian's
    (purelib,) = folder.glob("lib/python3*/site-packages")
    (purelib / "packages.pth").write_text(sysconfig.get_path("purelib") + "\n")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run(
        [*pip, "--prefix", folder, "--ignore-installed", ROOT], check=True, cwd=folder, timeout=100.0
    )
    return folder


def test_rollout_of_the_readme_arrives_without_ros(bare):
    run(bare, "-c", "from importlib.util import find_spec as f; assert not (f('rospy') or f('catkin_pkg'))")
    output = run(bare, ROOT / "examples" / "rollout")
    assert re.search(r"arrived after 23\.\d\d s at \(19\.\d\d, 4\.\d\d\) m", output)
    assert "contacts: none; fastest 1.00 m/s" in output


def test_one_command_is_there_and_explains_its_commands(bare):
    brought = {path.name for path in (bare / "bin").iterdir()}
    assert "husky" in brought
    assert not brought & set(COMMANDS), "a bare name may hide a program of the system"
    told = run(bare, bare / "bin" / "husky", "--help")
    assert [
        line.split()[0] for line in told.splitlines() if line.split()[:1] and line.split()[0] in COMMANDS
    ] == [*COMMANDS]
    told = run(bare, bare / "bin" / "husky", "evaluate", "--help")
    assert all(text in told for text in ("usage: husky evaluate", "--seed", "--scans", "--starts", "--jobs"))


def test_compare_drives_two_functions_and_a_controller_is_not_worse_than_itself(bare):
    (bare / "mine.py").write_text("from husky_highlevel_controller.controller.behaviour import decide\n")
    reference = "husky_highlevel_controller.controller.behaviour:decide"
    told = run(
        bare, bare / "bin" / "husky", "compare", "--starts", "1", "--jobs", "2", reference, "mine.py:decide"
    )
    assert "+0.000 s [+0.000, +0.000]" in told
    assert "B is not worse than A" in told


@pytest.mark.slow
def test_pip_fetches_all_that_it_needs(tmp_path):
    venv.create(tmp_path, with_pip=True)
    subprocess.run([tmp_path / "bin" / "pip", "install", "-q", ROOT], check=True, cwd=tmp_path, timeout=600.0)
    assert re.search(r"arrived after 23\.\d\d s", run(tmp_path, ROOT / "examples" / "rollout"))
    run(tmp_path, tmp_path / "bin" / "husky", "sweep", "p_gain_vel=0.5,1", "--starts", "1")
    few = ("--setups", "1", "--starts", "1", "--fresh", "1")
    run(tmp_path, tmp_path / "bin" / "husky", "tune", "p_gain_vel=0.5:1", *few)


def imported(path):
    """Names of the libraries that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module.split(".")[0]


def test_pyproject_declares_what_is_imported():
    tomllib = pytest.importorskip("tomllib")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    requirements = [*project["dependencies"], *project["optional-dependencies"]["cluster"]]
    declared = {re.match(r"[\w-]+", text).group().lower() for text in requirements}
    files = [path for folder in SOURCES for path in folder.rglob("*.py") if "ros" not in path.parts]
    libraries = {name for path in files for name in imported(path)} - set(sys.stdlib_module_names)
    libraries -= {
        "husky_highlevel_controller",
        "husky_evaluation",
        "pybullet_data",
        "pyarrow",
        *ROS_OF_A_HAND_IN,
    }
    assert {NAMES.get(name, name).lower() for name in libraries} <= declared


def test_the_changelog_begins_with_the_version_of_package_xml():
    version = re.search(r"<version>([^<]+)</version>", (ROOT / "package.xml").read_text())[1]
    changelog = (ROOT / "CHANGELOG.rst").read_text()
    first = re.search(r"^(Forthcoming|\d+\.\d+\.\d+) ?.*\n-+$", changelog, re.MULTILINE)[1]
    assert first in ("Forthcoming", version)
