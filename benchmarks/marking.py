"""Marking of five submissions: wall and CPU seconds a hand-in, from archive to result."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import List, Tuple

from rows import SHORT, Effort, Row, compare

SUBMISSIONS = Path(__file__).parents[1] / "test" / "submissions"
sys.path.insert(0, str(SUBMISSIONS))
from packages import make_package  # noqa: E402 - lives beside the submissions

# (wall, CPU) [s] of the version before the marking program, on two cores of an EPYC beside little else
BEFORE = {
    "drives_in_cpp": (30.4, 21.1),
    "complete": (35.3, 26.4),
    "never_publishes": (127.3, 46.1),
    "crashes": (59.1, 19.8),
    "sleeps_by_simulated_time": (146.0, 46.5),
}
AGAINST = "before"


def marking(effort: Effort) -> List[Row]:
    """Each of the submissions alone, by `grade --all`, with the exercise's three drives."""
    rows = []
    for name, before in BEFORE.items():
        runs = [_mark(name, 1 if effort is SHORT else 3) for _ in range(1 if effort is SHORT else 2)]
        for unit, number in (("s", 0), ("s of CPU", 1)):
            pairs = [(run[number], before[number]) for run in runs]
            rows.append(compare(f"marking of {name}", unit, pairs, AGAINST))
    return rows


def _mark(name: str, trials: int) -> Tuple[float, float]:
    """Wall and CPU time [s] of marking a submission, with every process that it starts."""
    with tempfile.TemporaryDirectory(prefix="husky_bench_") as folder:
        make_package(name, Path(folder, "class"))
        out = Path(folder, "out")
        command = ["rosrun", "husky_highlevel_controller", "grade", "--all", f"{folder}/class"]
        begin, before = time.monotonic(), _cpu_time()
        subprocess.run(
            [*command, "--out", str(out), "--trials", str(trials)],
            stdout=subprocess.DEVNULL, env=dict(os.environ), check=False,
        )  # fmt: skip
        took, cpu = time.monotonic() - begin, _cpu_time() - before
        result = json.loads((out / "hand_ins" / name / "result.json").read_text())
        if result["problem"]:
            raise SystemExit(f"{name}: {result['problem']}")
    return took, cpu


def _cpu_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
