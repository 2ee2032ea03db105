"""Cost of `Workers.map`: ./dev run python tools/benchmarks/many_tasks.py [--cluster tcp://HOST:8786].

Prints overhead for one-second tasks, how much faster two workers are than one, memory over 10 000 short
tasks, and the size of a report of 10 000 drives. Needs two idle cores, and with --cluster two workers.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Callable, List, NamedTuple, Tuple

import numpy as np
import psutil

from husky_evaluation.metrics import DriveResult
from husky_evaluation.setup import parse_axis
from husky_evaluation.sweep import Sweep, write_sweep
from husky_evaluation.tasks.workers import Workers

TASKS, SHORT_TASKS, GROUP = 16, 10000, 20  # short ones are sent in groups, as evaluate sends its scans


def compute(rounds: int) -> float:
    """Compute for some time, with little memory."""
    values = np.ones(1000)
    for _ in range(rounds):
        values = np.sqrt(values + 1.0)
    return float(values[0])


def memory(_: int) -> Tuple[int, int]:
    """Return the number of this process and its resident memory [bytes], as a short task."""
    return os.getpid(), psutil.Process().memory_info().rss


def seconds(work: Callable[[], object]) -> float:
    """Return the wall time of a call [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def rounds_for_a_second() -> int:
    """Return the number of rounds of `compute` that take this machine a second."""
    return int(20000 / min(seconds(lambda: compute(20000)) for _ in range(3)))


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--cluster", default="", help="address of the scheduler (default: processes on this machine)"
    )
    options = parser.parse_args()
    rounds = [rounds_for_a_second()] * TASKS
    without_workers = seconds(lambda: [compute(one) for one in rounds])
    with Workers(2, options.cluster) as workers:
        workers.map(compute, [1, 1])  # imports are done here, so they are not counted
        two = seconds(lambda: workers.map(compute, rounds))
    faster = without_workers / two
    print(
        f"{TASKS} tasks of {without_workers / TASKS:.2f} s: two workers {faster:.2f} times one (wanted: 1.8)"
    )
    if not options.cluster:
        with Workers(1) as workers:
            one = seconds(lambda: workers.map(compute, rounds))
        overhead = 100.0 * (one / without_workers - 1.0)
        print(f"overhead of the seam with one process: {overhead:.2f} % (wanted: 2)")
    print_memory(options.cluster)
    print_report()


class Sample(NamedTuple):
    """Resident memory after a short task [bytes]."""

    number: int  # number of the task
    process: int  # process of the worker
    of_worker: int
    of_client: int


def print_memory(cluster: str) -> None:
    """Print the memory of client and workers after a tenth and after all of the short tasks."""
    with Workers(2, cluster) as workers:
        samples: List[Sample] = []
        start = time.perf_counter()
        for number, (process, used) in workers.as_completed(memory, list(range(SHORT_TASKS)), chunk=GROUP):
            if number % 100 == 0:  # a sample is enough
                samples.append(Sample(number, process, used, psutil.Process().memory_info().rss))
        took = time.perf_counter() - start
    print(f"{SHORT_TASKS} short tasks: {1e3 * took / SHORT_TASKS:.2f} ms each")
    early, late = samples[len(samples) // 10], samples[-1]
    print(
        f"client: {early.of_client / 1e6:.1f} MB after {early.number}, "
        f"{late.of_client / 1e6:.1f} MB after {late.number}"
    )
    for process in sorted({sample.process for sample in samples}):
        own = [sample for sample in samples if sample.process == process]
        early, late = own[len(own) // 10], own[-1]
        print(
            f"worker: {early.of_worker / 1e6:.1f} MB after {early.number}, "
            f"{late.of_worker / 1e6:.1f} MB after {late.number}"
        )
    if cluster:
        from distributed import Client

        with Client(cluster, set_as_default=False) as client:
            held = client.run_on_scheduler(lambda: __import__("psutil").Process().memory_info().rss)
        print(f"scheduler: {held / 1e6:.1f} MB in the end; a second call should print the same")


def print_report() -> None:
    """Print the time to write the report of 10 000 drives, and the size of its page."""
    axes = (parse_axis("p_gain_vel=0.1:10:25"), parse_axis("p_gain_ang=0.1:10:20"))
    scenes = tuple(f"start {number}" for number in range(20))
    drives = tuple(
        DriveResult(
            scene, arrived_at=20.0 + number % 7, bound=15.0, final_error=0.01, gap=0.25, pushed=0.0,
            touched=(), crossings=0, overshoot=0.001 * (number % 5), nearest=0.25,
        )
        for number in range(25 * 20) for scene in scenes
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        took = seconds(lambda: write_sweep(Sweep(axes, scenes, drives), "title", "words", {}, Path(folder)))
        size = (Path(folder) / "index.html").stat().st_size
    print(f"report of {len(drives)} drives: written in {took:.2f} s, page of {size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
