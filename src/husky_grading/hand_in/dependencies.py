"""Packages that a build needs and that are not installed, with their names in Debian."""

from __future__ import annotations

import re
import subprocess
from itertools import chain
from typing import Collection, Dict

APT_DEADLINE = 20.0  # [s] of wall time
_DEBIAN_NAMES = ("lib{}-dev", "libros-{}-dev", "ros-{}", "python3-{}")  # of a ROS package in Debian


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
    packages = [
        f"{name} ({f'apt install {debian[name]}' if name in debian else 'not in Debian'})"
        for name in sorted(names)
    ]
    return f"not installed: {', '.join(packages)}; what needs them may not build"
