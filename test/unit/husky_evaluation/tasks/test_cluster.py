"""A Dask cluster of real processes gives the results of this machine, and uses no worker that would not."""

import os
import re
import shutil
import signal
import sys
from functools import partial
from pathlib import Path

import pytest

from husky_evaluation.metrics import run_scenario
from husky_evaluation.scenarios import random_starts
from husky_evaluation.setup import Setup
from husky_evaluation.tasks.workers import Workers
from husky_grading.batch import Batch, mark_all
from husky_grading.records import MarkingConfig
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.paths import share_folder

pytest.importorskip("distributed")
from dask_processes import WORKER, Processes
from noisy_tasks import noise, noise_after_a_death

SHARE = share_folder()


def fail(number):
    raise HuskyError(f"{number} is not a world")


class Unsendable:
    def __getstate__(self):
        raise OSError("a file is gone")


class Unreadable:
    def __reduce__(self):
        return int, ("no number",)


def unreadable_at_3(number):
    return Unreadable() if number == 3 else number


def no_ros(number):
    return number


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    processes = Processes(tmp_path_factory.mktemp("cluster"))
    yield processes
    processes.end()


@pytest.fixture
def cluster(scheduler):
    """The scheduler, without workers."""
    yield scheduler
    scheduler.dismiss()


def hash_of(task, items, **options):
    with Workers(**options) as workers:
        workers.map(task, items)
        return workers.results_hash


def test_the_hash_is_that_of_this_machine_also_when_a_worker_is_killed(cluster, tmp_path):
    drives, task = random_starts(2, 1), partial(run_scenario, Setup())
    expected, expected_drives = hash_of(noise, range(60), jobs=1), hash_of(task, drives, jobs=2)
    for number in range(2):
        cluster.work(f"worker {number}")
        assert hash_of(noise, range(60), cluster=cluster.address) == expected
    assert hash_of(task, drives, cluster=cluster.address) == expected_drives
    assert hash_of(partial(noise_after_a_death, tmp_path), range(60), cluster=cluster.address) == expected
    assert sorted(process.poll() for process in cluster.started if process.poll()) == [-signal.SIGKILL]
    with Workers(cluster=cluster.address) as workers, pytest.raises(HuskyError, match="0 is not a world"):
        workers.map(fail, [0])
    with Workers(cluster=cluster.address) as workers:
        items = [0, Unsendable()]
        results = workers.as_completed(fail, items, on_error=lambda _, error: str(error))
        assert sorted(results) == [(0, "0 is not a world"), (1, "a file is gone")]
    with Workers(cluster=cluster.address) as workers:
        results = workers.as_completed(
            unreadable_at_3, [2, 3], on_error=lambda _, error: type(error).__name__
        )
        assert sorted(results) == [(0, 2), (1, "ValueError")]
    with Workers(cluster=cluster.address) as workers, pytest.raises(HuskyError, match="--resources ROS=1"):
        workers.map(no_ros, range(2), starts_programs=True)
    cluster.work("ros", *WORKER, "--resources", "ROS=1")
    with Workers(cluster=cluster.address) as workers:
        (pid,) = set(workers.map(lambda _: os.getpid(), range(4), starts_programs=True))
    assert pid == cluster.started[-1].pid


def test_a_worker_of_another_kind_is_refused_by_name(cluster, tmp_path, capfd):
    other = tmp_path / "other"
    shutil.copytree(SHARE / "src", other / "src")
    for name in ("urdf", "worlds", "package.xml"):
        os.symlink(SHARE / name, other / name)
    with (other / "src/husky_highlevel_controller/course.py").open("a") as file:
        file.write("# changed\n")
    cluster.work("bare", path=Path("/nowhere"))
    cluster.work("changed", path=other / "src")
    cluster.work("threads", "--nthreads", "2", *WORKER[2:])
    with Workers(cluster=cluster.address) as workers, pytest.raises(
        HuskyError, match="every worker is rejected"
    ):
        workers.map(noise, range(4))
    cluster.work("good")
    capfd.readouterr()
    assert hash_of(noise, range(20), cluster=cluster.address) == hash_of(noise, range(20), jobs=1)
    told = capfd.readouterr().err
    assert "worker bare at tcp://127.0.0.1:" in told
    assert "is rejected: it has no package husky_evaluation" in told
    assert "worker changed at" in told
    assert re.search(r"; here it is \d+\.\d", told)
    assert "it has 2 threads; start it with --nthreads 1" in told
    assert "worker good" not in told


def test_where_no_scheduler_answers_the_command_says_so(monkeypatch):
    from husky_evaluation.tasks import cluster

    monkeypatch.setattr(cluster, "CONNECT_DEADLINE", 0.5)
    with pytest.raises(HuskyError, match=r"--cluster tcp://127.0.0.1:1: no Dask scheduler answers"):
        Workers(cluster="tcp://127.0.0.1:1")


def test_without_dask_the_message_says_what_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "husky_evaluation.tasks.cluster", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(HuskyError, match=r"pip install -r requirements/cluster.txt"):
        Workers(cluster="tcp://127.0.0.1:8786")


def test_a_class_is_marked_by_a_cluster_as_it_is_here(cluster, tmp_path):
    folder, tables = tmp_path / "class", []
    for name in ("ann", "bob", "eve"):
        (folder / name).mkdir(parents=True)
        (folder / name / "readme.txt").write_text("no package")
    for number in range(2):
        cluster.work(f"worker {number}", *WORKER, "--resources", "ROS=1")
    for name, address in (("here", ""), ("there", cluster.address)):
        results = mark_all(MarkingConfig(), Batch(folder, tmp_path / name, cluster=address))
        assert ["has no catkin package" in result.problem for result in results] == [True] * 3
        tables.append((tmp_path / name / "results.csv").read_text())
    assert tables[0] == tables[1]


def test_a_scheduler_that_dies_is_told(cluster):  # the last: the others have the same
    cluster.work("worker")
    with Workers(cluster=cluster.address) as workers:
        results = workers.as_completed(noise, list(range(100)))
        next(results)
        cluster.started[0].kill()
        with pytest.raises(HuskyError, match=f"--cluster {cluster.address}: the scheduler has gone"):
            list(results)
