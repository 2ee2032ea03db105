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
    """Return the names of Debian packages, by the names of the ROS packages, as far as apt knows them.

    Without apt-cache, no package is known.
    """
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
    """Return one sentence on all packages that are not installed."""
    debian = debian_packages(names)
    packages = [
        f"{name} ({f'apt install {debian[name]}' if name in debian else 'not in Debian'})"
        for name in sorted(names)
    ]
    return f"not installed: {', '.join(packages)}; code that needs them may not build"
