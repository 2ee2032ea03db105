"""A sweep drives the same scenes at every point, as its table, picture and page say."""

import csv
import math
import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing

import psutil
import pytest

from husky_evaluation import sweep
from husky_evaluation.metrics import DriveResult, run_scenario
from husky_evaluation.plots import draw_sweep
from husky_evaluation.scenarios import random_starts
from husky_evaluation.setup import Setup, parse_axis
from husky_evaluation.tasks.workers import Workers
from husky_highlevel_controller.paths import share_folder

SHARE = share_folder()
PNG = b"\x89PNG"


def made_up(item):
    """In place of a drive: 20 s over the gain; with a gain of 0 it never arrives."""
    setup, scene = item
    gain = setup.control.p_gain_vel
    return DriveResult(scene.name, 20.0 / gain if gain else math.inf, 10.0, 0.0, 0.2, 0.0, (), 0, 0.01, 0.3)


def swept(axes, scenes, resume=None):
    with Workers(1, resume=resume) as workers:
        result = sweep.sweep(list(map(parse_axis, axes)), random_starts(scenes, 0), Setup(), workers, made_up)
        return result, workers.summary


def test_table_and_page_have_a_row_for_each_drive_and_point_in_the_order_of_the_grid(tmp_path):
    result, source = swept(["p_gain_vel=1,4", "stop_distance=0.4,1"], 2)
    sweep.write_sweep(result, "title", source, {}, tmp_path)
    rows = list(csv.DictReader((tmp_path / "sweep.csv").read_text().splitlines()))
    assert [(row["p_gain_vel"], row["stop_distance"], row["scene"]) for row in rows][:3] == [
        ("1.0", "0.4", "start 0"), ("1.0", "0.4", "start 1"), ("1.0", "1.0", "start 0")
    ]  # fmt: skip
    assert [float(row["arrived_at"]) for row in rows] == [20.0] * 4 + [5.0] * 4
    page = (tmp_path / "index.html").read_text()
    assert (tmp_path / "sweep.png").read_bytes().startswith(PNG)
    assert (page.count("<img"), page.count("<tr>")) == (4, (1 + 3) + (1 + 4)), "best points, every point"
    assert "results " in page


def test_the_best_points_are_told_and_points_that_fail_are_hatched(tmp_path, capsys):
    result, source = swept(["p_gain_vel=0,1,4,2", "stop_distance=0.4,1"], 2)
    sweep.write_sweep(result, "title", source, {}, tmp_path)
    told = capsys.readouterr().out
    best = told.split("Best points\n")[1].splitlines()[1:4]
    assert [tuple(map(float, line.split())) for line in best] == [
        (4.0, 0.4, 100.0, 5.0), (4.0, 1.0, 100.0, 5.0), (2.0, 0.4, 100.0, 10.0)
    ]  # fmt: skip
    assert "Every run succeeds at 6 of 8 points" in told
    assert result.panels()[0].hatched.tolist() == [[True, True], *[[False, False]] * 3]


def test_small_values_of_the_best_points_stay_different(tmp_path, capsys):
    result, source = swept(["p_gain_vel=0.00012,0.00034"], 2)
    sweep.write_sweep(result, "title", source, {}, tmp_path)
    lines = capsys.readouterr().out.split("Best points\n")[1].splitlines()[1:3]
    assert [line.split()[0] for line in lines] == ["0.00034", "0.00012"]


def test_the_command_drives_what_a_drive_alone_gives_and_the_second_time_takes_it_from_the_file(tmp_path):
    words = ["p_gain_vel=4", "--starts", "1", "--jobs", "1", "--out", str(tmp_path)]
    sweep.main(words)
    first = (tmp_path / "results.sqlite").stat().st_mtime_ns
    (row,) = csv.DictReader((tmp_path / "sweep.csv").read_text().splitlines())
    alone = run_scenario(Setup().with_values({"p_gain_vel": 4.0}), random_starts(1, 0)[0])
    assert row == {"p_gain_vel": "4.0", **{k: str(v) for k, v in sweep.row(alone).items()}}
    assert (row["success"], float(row["nearest"]) > 0.2) == ("True", True)
    sweep.main(words)
    assert (tmp_path / "results.sqlite").stat().st_mtime_ns == first, "nothing was driven"


@pytest.mark.parametrize(
    ("axes", "sentence"),
    [(["p_gain_vel=1:2"], "p_gain_vel = '1:2'"), (["p_gain_vel=1", "p_gain_vel=2"], "twice")],
)
def test_bad_input_is_a_sentence_and_exit_code_2(axes, sentence, capsys, tmp_path):
    with pytest.raises(SystemExit, match="2"):
        sweep.main([*axes, "--out", str(tmp_path)])
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("how", "code", "sentence"),
    [
        (
            signal.SIGINT,
            130,
            "sweep: stopped; if results are kept in a file, the same command goes on where it was\n",
        ),
        (signal.SIGKILL, -signal.SIGKILL, ""),
    ],
)
def test_a_sweep_that_is_ended_keeps_what_was_driven_and_leaves_no_process(how, code, sentence, tmp_path):
    running = start_sweep(tmp_path)
    workers = psutil.Process(running.pid).children()
    running.send_signal(how)
    try:
        _, told = running.communicate(timeout=120.0)
    finally:
        running.kill()
    end = "".join(line for line in told.splitlines(True) if not line.startswith("runs: "))  # without progress
    assert (running.returncode, end) == (code, sentence)
    assert 1 <= kept(tmp_path / "results.sqlite") < 12 * 20
    assert workers
    assert not psutil.wait_procs(workers, timeout=60.0)[1]


def start_sweep(folder):
    """A long sweep that has kept its first result."""
    running = subprocess.Popen(
        [sys.executable, SHARE / "scripts" / "sweep", "p_gain_vel=1:4:12", "--jobs", "1", "--out", folder],
        env={**os.environ, "PYTHONPATH": str(SHARE / "src")},
        stderr=subprocess.PIPE,
        text=True,
        # a shell's background jobs ignore it, and so would this
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    end = time.monotonic() + 120.0
    while not kept(folder / "results.sqlite"):
        assert time.monotonic() < end
        assert running.poll() is None
        time.sleep(0.1)
    return running


def kept(path):
    """How many results a file has."""
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as file:
            return file.execute("SELECT count(*) FROM results").fetchone()[0]
    except sqlite3.OperationalError:  # not there yet
        return 0


def test_one_axis_gives_curves_and_drives_that_never_arrive_have_no_time():
    axis = parse_axis("p_gain_vel=0,2")
    result, _ = swept(["p_gain_vel=0,2"], 1)
    never, soon = result.panels()[0].values
    assert math.isnan(never)
    assert soon == 10.0
    marks = sweep.marks([axis], "gazebo", "husky")
    assert marks == {"defaults": [2.0], "the course's gains": [0.1]}
    assert draw_sweep(result.axes, result.panels(), marks, "title").startswith(PNG)


def test_two_axes_without_any_arrival_give_a_picture():
    result, _ = swept(["p_gain_vel=0", "p_gain_ang=0.3,1"], 1)
    assert all(map(math.isnan, result.panels()[0].values.flat))
    assert draw_sweep(result.axes, result.panels(), {}).startswith(PNG)


def test_marks_that_are_not_in_the_picture_or_equal_are_left_out():
    axes = [parse_axis("p_gain_ang=0.3:3:4"), parse_axis("stop_distance=0.1:1:2")]
    assert sweep.marks(axes, "robot", "husky") == {
        "defaults": [2.0, 0.4], "the course's gains": [0.4, 0.4], "robot.launch's gains": [1.0, 0.4]
    }  # fmt: skip
    assert list(sweep.marks(axes[1:], "robot", "husky")) == ["defaults"]


def test_the_marked_defaults_are_those_of_the_robot_that_is_swept():
    axes = [parse_axis("p_gain_vel=0:3:4"), parse_axis("stop_distance=0.1:1:2")]
    assert sweep.marks(axes, "gazebo", "smb") == {"defaults": [2.0, 0.6], "the course's gains": [0.1, 0.6]}
