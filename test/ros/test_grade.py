"""Marking, as a teacher sees it: good and bad controllers get exactly what they deserve, and all end."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor as Pool
from dataclasses import replace
from functools import partial
from pathlib import Path

import psutil
import pytest
from defusedxml import ElementTree
from markings import ATTACKS, CONFIGS, DRIVEN, KEPT, NEAR, check, keep
from network import wait_until
from packages import make_package

from husky_grading import mark as mark_module
from husky_grading.drive.trials import Trial, draw_trials
from husky_grading.records import Job, Launchable
from husky_grading.reports.files import load_result
from husky_highlevel_controller.course import PILLAR_POSITION
from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.paths import share_folder

PACKAGE = "husky_highlevel_controller"
GRADE = ["rosrun", PACKAGE, "grade"]
QUICK = ["--trials", "1", "--deadline", "25", "--pace", "8", "--seed", "0"]
JOBS = 3
BUILT = ("starts_a_map_server",)  # as a hand-in: which packages are its own is known
WAITED_FOR = ("never_publishes", "listens_elsewhere", "hangs")  # in vain, up to a deadline of a minute


@pytest.fixture(scope="module")
def handed_in(tmp_path_factory):
    """A folder of packages that run without a build, and the environment that finds the complete one."""
    folder = tmp_path_factory.mktemp("class")
    for name in [*DRIVEN, *KEPT]:
        if name in ATTACKS:
            make_package("attacks", folder / name)
        elif not name.startswith("reference"):
            make_package(name, folder)
    # some of the others have this package's name
    path = f"{folder / 'complete'}:{os.environ['ROS_PACKAGE_PATH']}"
    return folder, {**os.environ, "ROS_PACKAGE_PATH": path}


def mark_one(folder, out, name):
    """Mark in a process of its own: matplotlib is not for several threads; mostly from half the distance."""
    job = Job(name, str(out / name), CONFIGS.get(name, NEAR), hand_in=str(folder / name))
    near = Trial(1, Pose2D(10.0, 2.5, 0.0), PILLAR_POSITION, 0)
    is_near = job.config.deadline == NEAR.deadline
    mark_module.draw_trials = (lambda count, seed: [near]) if is_near else draw_trials
    if name.startswith("reference"):
        job = replace(job, hand_in="", launchable=Launchable("launch", PACKAGE, "controller.launch"))
    elif name in ATTACKS:
        what = Launchable("launch", "attacks", "attack.launch", (f"attack:={name}",))
        job = replace(job, hand_in="", launchable=what, packages=(str(folder / name),))
    elif not (folder / name / "src").exists() and name not in BUILT:  # it needs no build
        (launch,) = (folder / name / "launch").iterdir()
        what = Launchable("launch", name, launch.name)
        job = replace(job, hand_in="", launchable=what, packages=(str(folder / name),))
    return mark_module.mark(job)


def mark_all(names, folder, out):
    """Results by name, some at a time beside those that do nothing."""
    mark = partial(mark_one, folder, out)
    with Pool() as idle, Pool(JOBS) as busy:
        marked = {name: (idle if name in WAITED_FOR else busy).submit(mark, name) for name in names}
        return {name: result.result() for name, result in marked.items()}


@pytest.fixture(scope="module")
def results(handed_in, tmp_path_factory):
    """Results of the submissions whose end depends on processes."""
    return mark_all(set(DRIVEN) - {"complete"}, handed_in[0], tmp_path_factory.mktemp("out"))


def grade(*arguments, env=None):
    return subprocess.run(
        [*GRADE, *map(str, arguments)], env=env, capture_output=True, text=True, check=False
    )


def with_mounts_of(folder):
    """Processes to which a marking program shows a folder below this one at its neutral place."""
    found = []
    for mounts in Path("/proc").glob("[0-9]*/mountinfo"):
        with contextlib.suppress(OSError):  # it has ended
            if str(folder) in mounts.read_text():
                found.append(mounts.parent.name)
    return found


def starts(out):
    """How often a submission that counts its starts was started."""
    return sum(path.read_text().count("started") for path in out.glob("*/submission/home/starts"))


@pytest.mark.parametrize("name", sorted(set(DRIVEN) - {"complete"}))
def test_everybody_gets_what_they_deserve_and_is_told_why(name, results):
    check(name, results[name])


@pytest.mark.slow
def test_who_is_judged_by_a_kept_recording_gets_the_same_by_driving_and_is_recorded_anew(handed_in, tmp_path):
    results = mark_all(KEPT, handed_in[0], tmp_path)
    for name in KEPT:
        keep(name, tmp_path / name)
    for name in KEPT:
        check(name, results[name])
        assert starts(tmp_path / name) <= 2, "once for its drive, and once more"
    assert starts(tmp_path / "listens_to_laser") == 2, "its files name no robot"


def test_no_page_for_a_student_names_a_folder_of_this_machine(results, tmp_path_factory):
    assert results
    folders = [tmp_path_factory.getbasetemp(), Path(sys.prefix), share_folder(), Path.home()]
    pages = list(tmp_path_factory.getbasetemp().glob("out*/*/feedback.html"))
    assert len(pages) >= len(results)
    for page in pages:
        text = page.read_text()
        assert not [folder for folder in folders if f"{folder}/" in text], page


def test_nobody_is_left_of_them(results, tmp_path_factory):
    """Each of them, also the one that hides, has a folder of this test run in its command line."""
    assert results
    running = [" ".join(process.info["cmdline"] or ()) for process in psutil.process_iter(["cmdline"])]
    ours = str(tmp_path_factory.getbasetemp())
    assert not [line for line in running if ours in line]


def test_a_complete_one_gets_100_from_several_starts(handed_in, tmp_path):
    done = grade(
        "--launch", "complete", "controller.launch", "--trials", "2", "--deadline", "40", "--seed", "7",
        "--out", tmp_path, env=handed_in[1],
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "100/100" in done.stdout
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["points"], result["max_points"], result["full"]) == (100.0, 100.0, True)
    check("complete", load_result(tmp_path / "result.json"))
    assert starts(tmp_path) == 2, "once for each drive"
    (suite,) = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("5", "0")
    for picture in ("drive.png", "moment.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
    feedback = (tmp_path / "feedback.html").read_text()
    for number in (1, 2):
        assert f"run {number}" in (tmp_path / f"drive_{number}" / "replay.html").read_text()
        drive = json.loads((tmp_path / f"drive_{number}" / "recording.json").read_text())
        assert drive["nearest"][0][0] == 0.02, "it is recorded from its first scan on"
        assert drive["markers"][0]["at"] < 0.2
        assert f'title="replay of run {number}"' in feedback


def test_a_file_that_is_not_there_is_told(tmp_path):
    done = grade("--launch", "no_such_package", "a.launch", "--out", tmp_path)
    assert done.returncode == 2, done.stdout
    assert "there is no package 'no_such_package'" in done.stdout


def test_a_class_is_marked_on_from_where_it_was_interrupted(tmp_path):
    names = ["drives_in_cpp", "needs_a_missing_package"]
    for name in names:
        make_package(name, tmp_path / "class")
    out = tmp_path / "out"
    command = [*GRADE, "--all", str(tmp_path / "class"), "--jobs", "1", *QUICK, "--out", str(out)]
    # the first result, then Ctrl-C
    first = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    wait_until(lambda: list(out.glob("hand_ins/*/result.json")), "one submission is marked", 600.0)
    assert with_mounts_of(out)
    first.send_signal(signal.SIGINT)
    printed, _ = first.communicate(timeout=600)
    assert first.returncode == 2, printed
    assert "run the same command again to continue" in printed
    assert not with_mounts_of(out), "nothing of it goes on"
    done = {path: path.stat().st_mtime_ns for path in out.glob("hand_ins/*/result.json")}
    assert len(done) == 1

    second = subprocess.run(command, capture_output=True, text=True, check=False)
    assert second.returncode == 1, second.stdout + second.stderr
    assert {path: path.stat().st_mtime_ns for path in done} == done, "what was marked is not marked again"
    rows = [line.split(",") for line in (out / "results.csv").read_text().splitlines()]
    assert [row[0] for row in rows[1:]] == names
    assert [row[6] for row in rows[1:]] == ["70", "50"]
    assert (out / "index.html").read_text().count("data:image/png;base64,") == len(names)
    notes = second.stdout + (out / "results.csv").read_text()
    assert "not installed: no_such_package (not in Debian)" in notes
    assert "publish(true) and the like were made to compile" in notes
