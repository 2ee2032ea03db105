"""Sentence on the Python packages that this package needs and this Python lacks, with the install command.

In: a name of a group. Out: a sentence. Imports only the standard library, because programs call
`end_if_missing` before they import anything else. In ./dev's own environment nothing is missing, but a catkin
workspace may have the system's Python.
"""

from __future__ import annotations

import importlib.util
import platform
import re
import shlex
import sys
import sysconfig
from pathlib import Path
from typing import List, NamedTuple, Optional

# true on platforms for which pip has compiled packages (wheels) of the fork pybullet_arm64, but not of
# PyBullet; see requirements/launch.in
FORK = sys.version_info >= (3, 12) or (sys.version_info >= (3, 10) and sys.platform != "linux")
BULLET = "pybullet_arm64==3.2.8" if FORK else "pybullet==3.2.7"


class PythonPackage(NamedTuple):
    """Package of PyPI."""

    module: str
    requirement: str  # requirement for pip, as in requirements/*.in
    oldest: str = ""  # oldest version that has all functions used here; empty if every version has them


ROBOT = (
    PythonPackage("numpy", "numpy", "1.20"),  # oldest version with sliding_window_view and numpy.typing
    PythonPackage("yaml", "PyYAML"),
)
LAUNCH = (
    *ROBOT,
    PythonPackage("pybullet", BULLET),
    PythonPackage("xacro", "xacro==2.1.1"),
    PythonPackage("defusedxml", "defusedxml==0.7.1"),
)
RUN = (
    PythonPackage("matplotlib", "matplotlib"),
    PythonPackage("jinja2", "Jinja2"),
    PythonPackage("markupsafe", "MarkupSafe"),
    PythonPackage("tqdm", "tqdm"),
    PythonPackage("psutil", "psutil"),
)
PAGE = (
    PythonPackage("viser", "viser==1.1.1"),
    PythonPackage("trimesh", "trimesh"),
    PythonPackage("PIL", "pillow"),
    PythonPackage("websockets", "websockets"),
)
# packages for each purpose: "robot" for the nodes on a real robot, "launch" also for the simulator, "run"
# also for the commands, "page" for the web page
GROUPS = {"robot": ROBOT, "launch": LAUNCH, "run": LAUNCH + RUN, "page": ROBOT + PAGE}


def missing_sentence(group: str = "launch") -> Optional[str]:
    """Return a sentence on the packages of a group that are missing or too old; None if there are none.

    The sentence has the command that installs them. `group` is a key of GROUPS.
    """
    lacking: List[str] = []  # texts on packages that are missing or too old, which are joined below
    requirements: List[str] = []
    for package in GROUPS[group]:
        is_found = _is_importable(package.module)
        version = _version(package.module) if is_found and package.oldest else ""
        # an unknown version (empty) does not count as old
        is_old = bool(version) and _numbers(version) < _numbers(package.oldest)
        if is_found and not is_old:
            continue
        if is_old:
            lacking.append(f"{package.module} {package.oldest} or later (there is {version})")
        else:
            lacking.append(package.module)
        requirement = package.requirement
        if package.oldest:
            requirement += f">={package.oldest}"
        # pip must not change the major version of the package, because compiled packages of the system that
        # use it, such as matplotlib, would then fail
        if is_old:
            requirement += f",<{_numbers(version)[0] + 1}"
        requirements.append(requirement)
    if not lacking:
        return None
    *others, last = lacking
    names = f"{', '.join(others)} and {last}" if others else last
    return (
        f"husky_highlevel_controller needs {names}, which {sys.executable} does not have. "
        f"Install with: {_pip(requirements)}"
    )


def end_if_missing(group: str = "launch") -> None:
    """Exit with 1 and a sentence if a package of the group is missing or too old.

    A program calls this before it imports the packages, because a traceback would not say what to install.
    """
    text = missing_sentence(group)
    if text is not None:
        print(f"error: {text}", file=sys.stderr)
        raise SystemExit(1)


def main() -> None:
    """Run the script: exit with 1 and a sentence if a package of a group is missing, or print 'none'.

    The group is the first argument that names a group.
    """
    group = "launch"
    for word in sys.argv[1:]:
        if word in GROUPS:
            group = word
            break
    end_if_missing(group)
    print("none")


def _is_importable(module: str) -> bool:
    """Return whether Python finds a module, without loading it."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):  # the package is broken
        return False


def _version(module: str) -> str:
    """Version of an installed package by the folder of its metadata; empty if it is unknown.

    The folder is numpy-1.24.2.egg-info or numpy-2.4.6.dist-info, for instance. importlib.metadata reads it,
    too, but its import takes 20 ms, and each program of a launch would wait for it.
    """
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        return ""
    folders = sorted(Path(spec.origin).parent.parent.glob(f"{module}-*-info"))
    if not folders:
        return ""
    # the name is split at its hyphens, for example into numpy, 1.24.2.egg and info
    version_and_kind = folders[-1].name.split("-")[1]
    return version_and_kind.rpartition(".")[0]


def _numbers(version: str) -> List[int]:
    """Return the first two numbers of a version, by which two versions are compared."""
    return [int(number) for number in re.findall(r"\d+", version)[:2]]


def _pip(requirements: List[str]) -> str:
    """Return the command line that installs packages with pip on this machine.

    It installs into the virtual environment, or otherwise into the home folder. If pip or a compiler is
    missing, the command line first installs it with apt.
    """
    words = [sys.executable, "-m", "pip", "install"]
    if sys.prefix == sys.base_prefix:  # this Python is not in a virtual environment
        words.append("--user")
        if (Path(sysconfig.get_path("stdlib")) / "EXTERNALLY-MANAGED").is_file():
            # this option is safe here, because with --user pip installs only in the home folder
            words.append("--break-system-packages")
    debian = []  # packages of Debian or Ubuntu that pip needs
    if importlib.util.find_spec("pip") is None:
        debian.append("python3-pip")
    if BULLET in requirements and (platform.machine() != "x86_64" or sys.version_info >= (3, 14)):
        debian += ["g++", "python3-dev"]  # no compiled package (wheel) fits, so pip must compile PyBullet
    first = shlex.join(["sudo", "apt", "install", *debian]) + " && " if debian else ""
    return first + shlex.join([*words, *requirements])
