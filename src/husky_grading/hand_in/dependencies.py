"""Missing packages of a build, with their names in Debian."""

from __future__ import annotations

import re
import subprocess
from itertools import chain
from typing import Collection, Dict

APT_DEADLINE = 20.0  # [s] longest wall time for a question to apt-cache
# possible names of a ROS package in Debian, the preferred one first
_DEBIAN_NAMES = ("lib{}-dev", "libros-{}-dev", "ros-{}", "python3-{}")


def debian_packages(names: Collection[str]) -> Dict[str, str]:
    """Ask apt which Debian packages contain these ROS packages, and return their names by ROS package.

    ROS packages that apt does not know are left out. Without the program apt-cache, no package is known.
    """
    candidates = {  # possible names in Debian, by the name of the ROS package
        name: [pattern.format(name.replace("_", "-")) for pattern in _DEBIAN_NAMES] for name in names
    }
    command = ["apt-cache", "show", "--no-all-versions", *chain.from_iterable(candidates.values())]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=APT_DEADLINE, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return {}
    existing = set(re.findall(r"^Package: (.*)$", answer.stdout, re.MULTILINE))
    found = {}
    for name in names:
        matches = [candidate for candidate in candidates[name] if candidate in existing]
        if matches:
            found[name] = matches[0]  # the preferred name comes first
    return found


def missing_note(names: Collection[str]) -> str:
    """Return one sentence on ROS packages that are not installed, with the commands that install them."""
    debian = debian_packages(names)
    packages = []
    for name in sorted(names):
        advice = f"apt install {debian[name]}" if name in debian else "not in Debian"
        packages.append(f"{name} ({advice})")
    return f"not installed: {', '.join(packages)}; code that needs them may not build"
