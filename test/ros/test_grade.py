"""Marking, as a teacher sees it: good and bad controllers get exactly what they deserve, and all end."""

import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor as Pool
from functools import partial
from pathlib import Path

import psutil
import pytest
from defusedxml import ElementTree
from network import wait_until

from husky_highlevel_controller.course import PILLAR_POSITION
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.grading import mark as mark_module
from husky_highlevel_controller.grading.drive.plan import Submission, plan
from husky_highlevel_controller.grading.drive.trials import Trial
from husky_highlevel_controller.grading.isolation.process import with_variable
from husky_highlevel_controller.grading.records import Job, Launchable, MarkingConfig

SUBMISSIONS = Path(__file__).parents[1] / "submissions"
sys.path.insert(0, str(SUBMISSIONS))
from packages import make_package  # noqa: E402 - lives beside the submissions

GRADE = ["rosrun", "husky_highlevel_controller", "grade"]
REFERENCE = ["--launch", "husky_highlevel_controller", "controller.launch"]
QUICK = ["--trials", "1", "--deadline", "25", "--pace", "8"]
JOBS = 3
WAITED_FOR = ("never_publishes", "listens_elsewhere", "hangs")  # in vain, up to a deadline of a minute

# points of: drives towards it, reaches it, RViz, marker's place, marker in RViz (None: for a person, since no
# RViz configuration was handed in); and words that must be said
DESERVED = {
    "complete": ((20, 30, 20, 20, 10), ["odom, stamp 0: right 100 %", "robot model, laser scan to be seen"]),
    "crashes": (
        (10, 0, None, 0, 0),
        ["ends during the drive (exit code 1): ZeroDivisionError", "stops short"],
    ),
    "hangs": ((10, 0, None, 0, 0), ["does not answer every scan", "stops short: nearest 6."]),
    "never_publishes": ((0, 0, None, 0, 0), ["the robot never moves: nothing came on cmd_vel"]),
    "raises_in_callback": (
        (0, 0, None, 0, 0),
        ["callback on_scan raises NameError: name 'minimum' is not defined (controller:11), first at 0."],
    ),
    "never_advertises": ((0, 0, None, 0, 0), ["the robot never moves: it advertises no cmd_vel"]),
    "floods": ((20, 30, None, 0, 0), ["it floods cmd_vel: "]),
    "drives_away": ((0, 0, None, 0, 0), ["drives away: "]),
    "spins": ((0, 0, None, 0, 0), ["turns round "]),
    "stops_short": ((20, 0, None, 0, 0), ["stops short: nearest 2."]),
    "rams": ((20, 30, None, 0, 0), ["reaches it, at 1.0"]),  # the sheet's "hits the pillar"
    "marks_the_origin": (
        (20, 30, 20, 0, 0),
        ["right 0 % of", ", 0.13), the pillar at (20.00, 5.00): "],
    ),
    "imports_what_is_missing": (
        (0, 0, None, 0, 0),
        ["ModuleNotFoundError: No module named 'no_such_package'"],
    ),
    "needs_a_missing_package": (
        (20, 30, None, 0, 0),
        ["package 'no_such_package' is missing; the <include> that needs it is left out", "stands "],
    ),
    # traps: what students do that a person would not mark down, and the first cause in the chain
    "sleeps_by_simulated_time": ((20, 30, None, 20, None), ["front_laser, stamp 0: right "]),
    "marks_in_base_link": (
        (20, 30, None, pytest.approx(10.1, abs=0.3), None),
        ["0.54 m from the pillar's axis", "m too near, seen from the robot"],
    ),
    "commands_zero": ((0, 0, None, 0, 0), ["the robot never moves: all ", "commands were zero"]),
    "listens_elsewhere": ((0, 0, None, 0, 0), ["it listens to /scan, where nothing is sent"]),
    # attacks
    "teleports": (
        (0, 0, None, 0, 0),
        ["no points: the simulator was asked to interfere", "the robot jumps "],
    ),
    "forges_the_truth": (
        (0, 0, None, 0, 0),
        ["no points: node /controller publishes on /ground_truth/odom, as the simulator does"],
    ),
    "steers_by_the_truth": (
        (0, 0, None, 0, 0),
        ["node /controller subscribes to /husky_simulator/world/update_full, where the simulator tells "],
    ),
    "marks_a_grid": ((20, 30, None, 0, 0), ["196 markers in namespace 'grid'"]),
    "counts_ids": ((20, 30, None, 0, 0), ["half of those drawn must be right"]),
}  # fmt: skip


@pytest.fixture(scope="module")
def handed_in(tmp_path_factory):
    """A folder of packages that run without a build, and the environment that finds them."""
    folder = tmp_path_factory.mktemp("class")
    for name in [*DESERVED, "prints_ranges"]:
        make_package(name, folder)
    return folder, {**os.environ, "ROS_PACKAGE_PATH": f"{folder}:{os.environ['ROS_PACKAGE_PATH']}"}


def mark_near(folder, out, name):
    """Mark from half the distance, in a process of its own: matplotlib is not for several threads."""
    near = Trial(1, Pose2D(10.0, 2.5, 0.0), PILLAR_POSITION, 0)
    mark_module.draw_trials = lambda count, seed: [near]
    config = MarkingConfig(robot="husky", deadline=15.0, pace=8.0, trials=1)
    (launch,) = (folder / name / "launch").iterdir()
    what = Launchable("launch", name, launch.name)
    return mark_module.mark(Job(name, str(out / name), config, what, packages=(str(folder),)))


@pytest.fixture(scope="module")
def results(handed_in, tmp_path_factory):
    """Every submission, marked, by some at a time beside those that do nothing, from half the distance."""
    folder, _ = handed_in
    mark = partial(mark_near, folder, tmp_path_factory.mktemp("out"))
    with Pool() as idle, Pool(JOBS) as busy:
        marked = {name: (idle if name in WAITED_FOR else busy).submit(mark, name) for name in DESERVED}
        return {name: result.result() for name, result in marked.items()}


def grade(*arguments, env=None):
    return subprocess.run(
        [*GRADE, *map(str, arguments)], env=env, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("name", DESERVED)
def test_everybody_gets_what_they_deserve_and_is_told_why(name, results):
    points, words = DESERVED[name]
    result = results[name]
    assert tuple(item.points for item in result.items) == points, result
    said = "\n".join([*(item.evidence for item in result.items), *result.notes])
    for each in words:
        assert each in said


def test_nobody_is_left_of_them(results, tmp_path_factory):
    assert results
    running = [" ".join(process.info["cmdline"] or ()) for process in psutil.process_iter(["cmdline"])]
    ours = str(tmp_path_factory.getbasetemp())
    assert not [line for line in running if "hidden_by_hangs" in line or ours in line]


def test_the_reference_gets_100_from_several_starts(tmp_path):
    done = grade(*REFERENCE, "--trials", "2", "--deadline", "40", "--seed", "7", "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "100/100" in done.stdout
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["points"], result["max_points"], result["full"]) == (100.0, 100.0, True)
    (suite,) = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("5", "0")
    for picture in ("drive.png", "moment.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
    feedback = (tmp_path / "feedback.html").read_text()
    for number in (1, 2):
        assert f"drive {number}" in (tmp_path / f"drive_{number}" / "replay.html").read_text()
        assert f'title="replay of drive {number}"' in feedback


def test_the_start_and_stop_service_of_exercise_5(tmp_path):
    done = grade(*REFERENCE, "--exercise", "5", "--pace", "4", "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "stands after 2 of 2 calls" in done.stdout
    assert "drives after 2 of 2 calls" in done.stdout


def test_the_printed_ranges_of_exercise_2(handed_in, tmp_path):
    done = grade(
        "--node", "prints_ranges", "controller", "--exercise", "2", "--pace", "4", "--out", tmp_path,
        env=handed_in[1],
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr  # what is left is for a person
    points = [item["points"] for item in json.loads((tmp_path / "result.json").read_text())["items"]]
    assert points == [40.0, None, 15.0, None]


def test_a_node_for_an_older_husky(handed_in, tmp_path):
    make_package("complete", tmp_path / "older")
    for path in (tmp_path / "older").rglob("*.rviz"):
        path.unlink()
    env = {**handed_in[1], "ROS_PACKAGE_PATH": f"{tmp_path / 'older'}:{os.environ['ROS_PACKAGE_PATH']}"}
    done = grade(
        "--node", "complete", "controller", "_scan_topic:=/scan", "--robot", "husky_melodic", *QUICK,
        "--out", tmp_path / "out", env=env,
    )  # fmt: skip
    points = [item["points"] for item in json.loads((tmp_path / "out" / "result.json").read_text())["items"]]
    # on a busy machine a node may draw a scan late
    assert points == [20.0, 30.0, None, pytest.approx(20.0, abs=0.3), None], done.stdout


def test_scans_are_sent_where_a_submission_listens(handed_in, tmp_path):
    make_package("listens_to_laser", tmp_path / "class")
    env = {**handed_in[1], "ROS_PACKAGE_PATH": f"{tmp_path / 'class'}:{os.environ['ROS_PACKAGE_PATH']}"}
    done = grade("--node", "listens_to_laser", "controller", *QUICK, "--out", tmp_path / "out", env=env)
    points = [item["points"] for item in json.loads((tmp_path / "out" / "result.json").read_text())["items"]]
    assert points == [10.0, 0.0, None, 0.0, 0.0], done.stdout
    assert "scans are sent on /laser, the only topic of scans that it subscribes to" in done.stdout


def test_a_file_that_is_not_there_is_told(tmp_path):
    done = grade("--launch", "no_such_package", "a.launch", "--out", tmp_path)
    assert done.returncode == 1, done.stderr
    assert "no_such_package" in done.stdout


def test_a_class_is_marked_on_from_where_it_was_interrupted(tmp_path):
    names = ["crashes", "drives_in_cpp", "has_a_wiki_setup", "needs_a_missing_package"]
    for name in names:
        make_package(name, tmp_path / "class")
    out = tmp_path / "out"
    command = [*GRADE, "--all", str(tmp_path / "class"), "--jobs", str(JOBS), *QUICK, "--out", str(out)]
    # the first result, then Ctrl-C
    first = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    wait_until(lambda: list(out.glob("hand_ins/*/result.json")), "one submission is marked", 600.0)
    first.send_signal(signal.SIGINT)
    printed, _ = first.communicate(timeout=600)
    assert first.returncode == 2, printed
    assert "goes on from here" in printed
    for place in out.glob("hand_ins/*/drive_*/assignment.json"):
        assert not with_variable("ROS_LOG_DIR", str(place.parent / "log"))
    done = {path: path.stat().st_mtime_ns for path in out.glob("hand_ins/*/result.json")}
    assert 1 <= len(done) < len(names)

    second = subprocess.run(command, capture_output=True, text=True, check=False)
    assert second.returncode == 1, second.stdout + second.stderr
    assert {path: path.stat().st_mtime_ns for path in done} == done, "what was marked is not marked again"
    rows = [line.split(",") for line in (out / "results.csv").read_text().splitlines()]
    assert [row[0] for row in rows[1:]] == names
    assert [row[6] for row in rows[1:]] == ["10", "70", "50", "50"]
    assert (out / "index.html").read_text().count("data:image/png;base64,") == len(names)
    notes = second.stdout + (out / "results.csv").read_text()
    assert "not installed: no_such_package (not in Debian)" in notes
    assert "publish(true) and its like are made to compile" in notes


@pytest.mark.parametrize(
    ("arguments", "node"), [([], "husky_controller"), (["naive:=true"], "naive_controller")]
)
def test_a_launch_file_gets_its_arguments(arguments, node, tmp_path):
    what = Launchable("launch", "husky_highlevel_controller", "controller.launch", tuple(arguments))
    planned = plan(Submission(what), tmp_path)
    assert planned.nodes == (f"husky_highlevel_controller/{node}",)
