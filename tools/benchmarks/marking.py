"""Benchmark of marking: CPU and wall seconds of three hand-ins in a checkout's workspace."""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path
from typing import Dict, Tuple

from checkouts import OURS, PACKAGE, run_in

# submissions of test/submissions: C++, rospy with an RViz file, C++ with an error
SUBMISSIONS = ("drives_in_cpp", "complete", "does_not_build")


def marking(checkout: Path) -> Dict[Tuple[str, str], float]:
    """Mark each submission once, in a class of its own.

    Returns:
        CPU seconds of all programs and wall seconds, by name and unit.
    """
    found = {}
    for name in SUBMISSIONS:
        found[f"marking {name}", "CPU s"], found[f"marking {name}", "s"] = _mark(checkout, name)
    return found


def _mark(checkout: Path, name: str) -> Tuple[float, float]:
    """Mark a class of this submission only; return CPU seconds of all programs, and wall seconds."""
    with tempfile.TemporaryDirectory() as folder:
        packages = str(OURS / "test/submissions/packages.py")
        run_in(checkout, "run", "python", packages, f"{folder}/class", name)
        begin, cpu = time.monotonic(), _children_cpu()
        grade = ("rosrun", PACKAGE, "grade", "--all", f"{folder}/class", "--out", f"{folder}/out")
        run_in(checkout, "run", *grade, accepted=(0, 1))  # 1 means less than full marks
        return _children_cpu() - cpu, time.monotonic() - begin


def _children_cpu() -> float:
    """Return the CPU seconds of all child processes that have ended, and of their own children."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
