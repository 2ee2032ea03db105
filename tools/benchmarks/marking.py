"""Benchmark of marking: CPU and wall seconds of three hand-ins, by turns with another checkout's marking."""

from __future__ import annotations

import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path
from typing import List, Tuple

from network import HERE
from rows import Effort, Row, compare, reaching

OURS = HERE.parents[1]
# of test/submissions: C++, rospy with an RViz file, C++ with an error; wanted ratios of CPU seconds
SUBMISSIONS = {"drives_in_cpp": 0.75, "complete": 0.55, "does_not_build": 0.3}
ENVIRONMENT = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "LANG": "C.UTF-8"}
PACKAGE = "husky_highlevel_controller"


def marking(effort: Effort) -> List[Row]:
    """Seconds a hand-in, against the checkout of `--against`."""
    if effort.against is None:
        raise SystemExit(
            "marking needs --against CHECKOUT, whose grading is measured alternating with this one"
        )
    for checkout in (OURS, effort.against):
        _run(checkout, "true")  # built before the clock runs
    rows = []
    for name, goal in SUBMISSIONS.items():
        pairs = [(_mark(OURS, name), _mark(effort.against, name)) for _ in range(effort.markings)]
        for number, unit in enumerate(("CPU s", "s")):
            runs = [(ours[number], other[number]) for ours, other in pairs]
            row = compare(f"marking {name}", unit, runs, effort.against.name)
            rows.append(reaching(row, f"<= {goal}", row.ratio, maximum=goal) if unit == "CPU s" else row)
    return rows


def _mark(checkout: Path, name: str) -> Tuple[float, float]:
    """CPU seconds of all programs, and seconds, of marking a class of one."""
    with tempfile.TemporaryDirectory() as folder:
        _run(checkout, "python", str(OURS / "test/submissions/packages.py"), f"{folder}/class", name)
        begin, cpu = time.monotonic(), _children_cpu()
        _run(checkout, "rosrun", PACKAGE, "grade", "--all", f"{folder}/class", "--out", f"{folder}/out")
        return _children_cpu() - cpu, time.monotonic() - begin


def _run(checkout: Path, *command: str) -> None:
    """Run a command in a checkout's workspace; exit code 1 is a hand-in without full marks."""
    done = subprocess.run(
        [str(checkout / "dev"), "run", *command], env={**ENVIRONMENT, "HOME": os.environ["HOME"]},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1):
        raise SystemExit(f"{checkout}: {' '.join(command)}: {done.stdout[-500:]}{done.stderr[-500:]}")


def _children_cpu() -> float:
    """CPU seconds of all processes that have ended below this one."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
