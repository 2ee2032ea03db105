"""Missing Python packages are one sentence with the command that installs them, before anything starts."""

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from husky_highlevel_controller import missing_packages
from husky_highlevel_controller.paths import share_folder

ROOT = share_folder()
WITHOUT_CHECK = {"missing_packages", "restart_once", "husky_highlevel_controller"}


def test_nothing_is_missing_here():
    assert [missing_packages.missing_sentence(group) for group in missing_packages.GROUPS] == [None] * 4


def test_what_is_missing_and_what_is_too_old_are_named_with_one_command(monkeypatch):
    find = missing_packages.importlib.util.find_spec
    absent = lambda name: None if name in ("pybullet", "xacro") else find(name)  # noqa: E731
    monkeypatch.setattr(missing_packages.importlib.util, "find_spec", absent)
    monkeypatch.setattr(missing_packages, "_version", lambda name: "1.17.4")
    monkeypatch.setattr(sys, "executable", "/opt/my python/python3")
    assert missing_packages.missing_sentence() == (
        "husky_highlevel_controller needs numpy 1.20 or later (there is 1.17.4), pybullet and xacro, which "
        "/opt/my python/python3 does not have. Install with: '/opt/my python/python3' -m pip install "
        f"'numpy>=1.20,<2' {missing_packages.BULLET} xacro==2.1.1"
    )
    assert missing_packages.missing_sentence("robot").endswith("pip install 'numpy>=1.20,<2'"), (
        "a robot needs no engine"
    )


def test_where_there_is_no_numpy_any_that_is_new_enough_is_installed(monkeypatch):
    find = missing_packages.importlib.util.find_spec
    absent = lambda name: None if name == "numpy" else find(name)  # noqa: E731
    monkeypatch.setattr(missing_packages.importlib.util, "find_spec", absent)
    assert missing_packages.missing_sentence("robot").endswith(" 'numpy>=1.20'")


@pytest.mark.parametrize("managed", [True, False])
def test_the_system_s_python_gets_packages_for_one_user(managed, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    monkeypatch.setattr(missing_packages.sysconfig, "get_path", lambda _: str(tmp_path))
    if managed:
        (tmp_path / "EXTERNALLY-MANAGED").touch()
    monkeypatch.setattr(missing_packages, "_version", lambda name: "1.17.4")
    words = missing_packages.missing_sentence("robot").partition("-m pip install ")[2].split()
    assert words == ["--user", *(["--break-system-packages"] if managed else []), "'numpy>=1.20,<2'"]


def test_where_no_wheel_of_pybullet_fits_the_compiler_is_installed_first(monkeypatch):
    monkeypatch.setattr(missing_packages.importlib.util, "find_spec", lambda name: name == "pip" or None)
    commands = {}
    for machine in ("x86_64", "aarch64"):
        monkeypatch.setattr(missing_packages.platform, "machine", lambda machine=machine: machine)
        commands[machine] = missing_packages.missing_sentence().partition("Install with: ")[2]
    assert commands["aarch64"] == "sudo apt install g++ python3-dev && " + commands["x86_64"]
    assert "g++" not in missing_packages.missing_sentence("robot"), "a robot needs no engine"


def test_the_versions_are_those_of_the_requirements():
    pinned = (ROOT / "requirements" / "launch.in").read_text() + (
        ROOT / "requirements" / "run.in"
    ).read_text()
    for packages in missing_packages.GROUPS.values():
        for package in packages:
            name, exact, version = package.requirement.partition("==")
            assert re.search(rf"^{name}{exact}{version}\b", pinned, re.MULTILINE), package


def test_every_script_and_launch_file_asks_first():
    for script in set((ROOT / "scripts").iterdir()) - {ROOT / "scripts" / name for name in WITHOUT_CHECK}:
        text = script.read_text()
        assert text.index("\nend_if_missing(") < text.index("import main\n"), script
    for file in (ROOT / "launch").glob("*.launch"):
        names = [param.get("name") for param in ElementTree.parse(file).getroot().findall("param")]
        if file.name != "controller.launch":  # which begins with simulator.launch
            assert names[0] in ("missing_packages", "other_simulator"), file
    ours = "$(find husky_highlevel_controller)/launch/"
    for file in (*(ROOT / "examples").rglob("*.launch"), *(ROOT / "examples").rglob("*.test")):
        included = [include.get("file") for include in ElementTree.parse(file).getroot().iter("include")]
        assert [name for name in included if name.startswith(ours)], f"{file} begins with a file that asks"


@pytest.mark.parametrize(
    "program",
    ["scripts/husky_simulator", "scripts/grade", "scripts/other_simulator", "tools/gazebo_packages.py"],
)
def test_a_program_ends_with_the_sentence(program):
    """A Python without any packages but this one."""
    env = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT / "src")}
    command = [sys.executable, "-S", str(ROOT / program)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: husky_highlevel_controller needs numpy, yaml, pybullet, xacro")
    assert Path(sys.executable).name in line


def test_the_version_of_a_package_is_the_one_that_it_tells_of_itself():
    assert missing_packages._version("numpy") == np.__version__
    assert missing_packages._version("no_such_package") == ""
