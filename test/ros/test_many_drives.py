"""Drives that need ROS go through the seam as others do: compared on this machine, marked on a cluster."""

import csv
import os
import subprocess

import pytest
from packages import make_package

ROSRUN = ["rosrun", "husky_highlevel_controller"]
QUICK = ["--seed", "0", "--trials", "1", "--deadline", "25", "--pace", "8"]


def run(*words, folder):
    return subprocess.run(
        [*ROSRUN, *map(str, words)], cwd=folder, capture_output=True, text=True, check=False
    )


def test_a_launch_file_is_compared_with_parameters(tmp_path):
    (tmp_path / "a.yaml").write_text("p_gain_vel: 2.0\n")
    done = run(
        "compare", "a.yaml", "husky_highlevel_controller/controller.launch", "--starts", "1", folder=tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (row,) = csv.DictReader((tmp_path / "compare" / "compare.csv").read_text().splitlines())
    assert float(row["b_arrived_at"]) == pytest.approx(float(row["a_arrived_at"]), abs=0.1)
    assert "B is not worse than A" in done.stdout


def test_a_launch_file_that_starts_nothing_is_named(tmp_path):
    (tmp_path / "a.yaml").write_text("p_gain_vel: 2.0\n")
    done = run(
        "compare", "husky_highlevel_controller/nothing.launch", "a.yaml", "--starts", "1", folder=tmp_path
    )
    assert done.returncode == 2
    assert done.stderr.startswith(
        "compare: husky_highlevel_controller/nothing.launch: the launch file cannot be"
    )


@pytest.mark.slow
def test_a_class_is_marked_by_a_cluster(tmp_path):
    pytest.importorskip("distributed")
    from dask_processes import WORKER, Processes

    make_package("stops_short", tmp_path / "class")
    cluster = Processes(tmp_path)
    try:
        # the sourced workspace's, which has the messages
        cluster.work("worker", *WORKER, "--resources", "ROS=1", path=os.environ["PYTHONPATH"])
        done = run("grade", "--all", "class", "--cluster", cluster.address, *QUICK, folder=tmp_path)
    finally:
        cluster.end()
    assert done.returncode == 1, done.stdout + done.stderr
    _, row = csv.reader((tmp_path / "marking" / "results.csv").read_text().splitlines())
    assert row[:6] == ["stops_short", "20", "0", "", "0", "0"]
    assert (tmp_path / "marking" / "hand_ins" / "stops_short" / "drive_1" / "replay.html").is_file()
    assert "data:image/png;base64," in (tmp_path / "marking" / "index.html").read_text()
