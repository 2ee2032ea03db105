"""Packages that a build needs and that are not installed, with their names in Debian."""

from __future__ import annotations

import os
import re
import subprocess
from itertools import chain
from pathlib import Path
from typing import Collection, Dict, Mapping, Sequence, Set

from husky_highlevel_controller.grading.isolation.files import UnreadableFileError, read_text

APT_DEADLINE = 20.0  # [s] of wall time
MAX_TEXT = 1_000_000  # [bytes] of a CMakeLists.txt
_DEBIAN_NAMES = ("lib{}-dev", "libros-{}-dev", "ros-{}", "python3-{}")  # of a ROS package in Debian
_COMPONENTS = re.compile(r"find_package\s*\(\s*catkin\b([^()]*)\)", re.IGNORECASE)


def missing_packages(
    packages: Mapping[str, Path], needed: Collection[str], env: Mapping[str, str]
) -> Set[str]:
    """Catkin components that the CMakeLists.txt of packages ask for, and that are nowhere.

    Args:
        packages: folders of the hand-in's packages, by name.
        needed: names of those that are read.
        env: environment of the build.
    """
    components: Set[str] = set()
    for name in needed:
        try:
            text = re.sub(r"#.*", "", read_text(packages[name] / "CMakeLists.txt", MAX_TEXT))
        except UnreadableFileError:
            continue
        for arguments in _COMPONENTS.findall(text):
            components |= set(re.findall(r"(?<![\w$])[a-z][\w-]*", arguments))
    prefixes = [Path(prefix) for prefix in env.get("CMAKE_PREFIX_PATH", "").split(os.pathsep) if prefix]
    return {name for name in components - set(packages) if not _is_installed(name, prefixes)}


def _is_installed(name: str, prefixes: Sequence[Path]) -> bool:
    for prefix in [*prefixes, Path("/usr"), Path("/usr/local")]:
        for pattern in (
            f"share/{name}/cmake",
            f"lib/cmake/{name}",
            f"lib/*/cmake/{name}",
            f"share/cmake/{name}*",
        ):
            if next(prefix.glob(pattern), None) is not None:
                return True
    return False


def debian_packages(names: Collection[str]) -> Dict[str, str]:
    """Debian packages that have ROS packages for building, by the ROS package's name, where one is known."""
    candidates = {
        name: [pattern.format(name.replace("_", "-")) for pattern in _DEBIAN_NAMES] for name in names
    }
    command = ["apt-cache", "show", "--no-all-versions", *chain.from_iterable(candidates.values())]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=APT_DEADLINE, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return {}
    known = set(re.findall(r"^Package: (.*)$", answer.stdout, re.MULTILINE))
    matches = {name: [each for each in candidates[name] if each in known] for name in names}
    return {name: packages[0] for name, packages in matches.items() if packages}


def missing_note(names: Collection[str]) -> str:
    """A sentence on packages that are not installed, all at once."""
    debian = debian_packages(names)
    words = [
        f"{name} ({f'apt install {debian[name]}' if name in debian else 'not in Debian'})"
        for name in sorted(names)
    ]
    return f"not installed: {', '.join(words)}; what needs them may not build"
