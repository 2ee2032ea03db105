"""What a machine gets of PyBullet: the markers of pyproject.toml and lock files, and docs/install.md."""

import re
import runpy
import sys

import pytest
from packaging.requirements import Requirement
from test_dev import ROOT

from husky_highlevel_controller import missing_packages

WHEELS = runpy.run_path(str(ROOT / "tools" / "wheels.py"))


def pybullets(lines):
    return [Requirement(line) for line in lines if line.startswith("pybullet")]


def chosen(requirements, python, system):
    """Names of the requirements that hold for a Python on a system."""
    env = {"python_version": python, "python_full_version": f"{python}.0", "sys_platform": system}
    return [one.name for one in requirements if one.marker.evaluate(env)]


@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
@pytest.mark.parametrize("python", WHEELS["PYTHONS"])
def test_every_machine_gets_one_pybullet_and_the_same_from_pip_as_from_dev(python, system):
    library = pybullets(re.findall(r'^    "(.+)",$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE))
    pinned = pybullets((ROOT / "requirements" / "launch.in").read_text().splitlines())
    fork = python in ("3.12", "3.13", "3.14") or (python in ("3.10", "3.11") and system != "linux")
    expected = ["pybullet_arm64" if fork else "pybullet"]
    assert chosen(library, python, system) == chosen(pinned, python, system) == expected


def test_a_catkin_workspace_is_told_to_install_the_same_pybullet():
    pinned = pybullets((ROOT / "requirements" / "launch.in").read_text().splitlines())
    here = f"{sys.version_info[0]}.{sys.version_info[1]}"
    assert missing_packages.BULLET.partition("==")[0] in chosen(pinned, here, sys.platform)


def test_the_table_of_the_manual_has_every_python_and_system():
    rows = re.findall(r"^\| (3\.\d+) \|(.*)\|$", (ROOT / "docs" / "install.md").read_text(), re.MULTILINE)
    assert tuple(python for python, _ in rows) == WHEELS["PYTHONS"]
    assert {cells.count("|") + 1 for _, cells in rows} == {len(WHEELS["SYSTEMS"])}
    assert "| Python | " + " | ".join(WHEELS["SYSTEMS"]) + " |" in (ROOT / "docs" / "install.md").read_text()
