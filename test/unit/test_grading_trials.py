"""The drives of a marking, the folder of a class, RViz's configurations, and strangers' processes."""

import contextlib
import os
import sys
from math import atan2, hypot
from pathlib import Path

import numpy as np
import pytest

from husky_highlevel_controller import processes, rviz_view
from husky_highlevel_controller.class_marking import build_error, find_entry, find_packages, fingerprint
from husky_highlevel_controller.geometry import wrap_angle
from husky_highlevel_controller.grade import parse
from husky_highlevel_controller.marking import Plan
from husky_highlevel_controller.processes import (
    LOG_HEAD,
    LOG_TAIL,
    Process,
    end_all,
    namespaces,
    wait,
)
from husky_highlevel_controller.trials import draw_trials, rviz_world, trial_world
from husky_highlevel_controller.world import load_world

# ---------------------------------------------------------------------------- drives


def test_the_first_drive_is_the_course_s_and_all_are_the_same_for_a_seed():
    trials = draw_trials(5, seed=3)
    assert trials[0].pillar == (20.0, 5.0)
    assert (trials[0].start.x, trials[0].start.yaw) == (0.0, 0.0)
    assert draw_trials(3, seed=3) == trials[:3]
    assert draw_trials(5, seed=4)[1:] != trials[1:]


def test_every_pillar_is_in_view_and_in_reach(tmp_path):
    for trial in draw_trials(50, seed=1)[1:]:
        dx, dy = trial.pillar[0] - trial.start.x, trial.pillar[1] - trial.start.y
        assert 7.9 <= hypot(dx, dy) <= 20.1
        assert abs(wrap_angle(atan2(dy, dx) - trial.start.yaw)) <= 1.01


def test_the_world_of_a_drive_has_its_pillar(tmp_path):
    trial = draw_trials(2, seed=0)[1]
    (tmp_path / "a.world").write_text(trial_world(trial))
    (pillar,) = (t for t in load_world(tmp_path / "a.world").things if t.name == "unit_cylinder")
    assert pillar.pose_in_world.position[:2] == trial.pillar


def test_the_world_for_rviz_has_something_to_see_all_around(tmp_path):
    (tmp_path / "a.world").write_text(rviz_world())
    posts = [t for t in load_world(tmp_path / "a.world").things if t.name.startswith("post_")]
    assert len(posts) == 8
    assert min(hypot(*post.pose_in_world.position[:2]) for post in posts) > 1.2


# ---------------------------------------------------------------------------- a class


def put(path, text=""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_every_package_of_a_folder_is_found_once_under_its_own_place(tmp_path):
    for place in ("ann", "bob/husky", "bob/husky/inner", "broken", "ignored"):
        put(tmp_path / place / "package.xml", "<package><name>husky_highlevel_controller</name></package>")
    put(tmp_path / "broken" / "package.xml", "<package>")
    put(tmp_path / "ignored" / "CATKIN_IGNORE")
    found = find_packages(tmp_path)
    assert [(package.name, package.package) for package in found] == [
        ("ann", "husky_highlevel_controller"),
        ("bob/husky", "husky_highlevel_controller"),
        ("broken", ""),
    ]


@pytest.mark.parametrize(
    ("files", "entry"),
    [
        (["launch/a.launch"], "a.launch"),
        (["launch/a.launch", "launch/my_controller.launch"], "my_controller.launch"),
        (["launch/a.launch", "launch/b.launch"], None),
        ([], None),
    ],
)
def test_the_launch_file_is_the_only_one_or_the_one_that_fits(files, entry, tmp_path):
    for name in ["package.xml", *files]:
        put(tmp_path / name, "<package><name>x</name></package>")
    (package,) = find_packages(tmp_path)
    assert find_entry(package, "*controller*.launch") == entry


def test_a_changed_file_changes_the_fingerprint(tmp_path):
    put(tmp_path / "a", "1")
    before = fingerprint(tmp_path)
    assert fingerprint(tmp_path) == before
    put(tmp_path / "a", "12")
    assert fingerprint(tmp_path) != before


@pytest.mark.parametrize(
    ("output", "words"),
    [
        (
            'x\n  Could not find a package configuration file provided by "abc" with\n',
            "package 'abc' is missing",
        ),
        ("a\nsrc/a.cpp:3:1: error: 'x' was not declared\nb", "src/a.cpp:3:1: error: 'x' was not declared b"),
        ("one\ntwo", "one two"),
    ],
)
def test_a_build_that_fails_is_told_in_a_line(output, words):
    assert build_error(output) == words


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--launch", "only_a_package"],
        ["--node", "p", "n", "--all", "."],
        ["--all", "/no/such/folder"],
        ["--launch", "p", "f", "--trials", "0"],
        ["--launch", "p", "f", "--seed", "-1"],
        ["--launch", "p", "f", "--exercise", "4"],
    ],
)
def test_a_command_line_that_makes_no_sense_is_refused(arguments, capsys):
    with pytest.raises(SystemExit) as refused:
        parse(arguments)
    assert refused.value.code == 2
    assert "error:" in capsys.readouterr().err


# ---------------------------------------------------------------------------- RViz's configuration

SCAN, GRID, MODEL = {"Class": "rviz/LaserScan"}, {"Class": "rviz/Grid"}, {"Class": "rviz/RobotModel"}
OFF = {"Class": "rviz/TF", "Enabled": False}
CONFIG = {
    "Visualization Manager": {
        "Displays": [GRID, OFF, {"Class": "rviz/Group", "Displays": [SCAN, MODEL]}],
        "Global Options": {"Background Color": "1; 2; 3"},
    }
}


def test_one_display_is_left_wherever_it_is():
    kept = rviz_view.only(CONFIG, "rviz/LaserScan")["Visualization Manager"]["Displays"]
    assert kept == [{"Class": "rviz/Group", "Displays": [SCAN]}]
    assert len(CONFIG["Visualization Manager"]["Displays"]) == 3, "the configuration itself stays"


def test_only_what_is_switched_on_counts(tmp_path):
    put(tmp_path / "a.rviz", "Visualization Manager: {Displays: [{Class: rviz/TF, Enabled: false}]}")
    put(tmp_path / "z" / "b.rviz", "Visualization Manager: {Displays: [{Class: rviz/LaserScan}]}")
    put(tmp_path / "c.rviz", "- no: rviz")
    assert rviz_view.find_setup(Plan(package_path=str(tmp_path))).source == "b.rviz"
    assert rviz_view.find_setup(Plan(package_path="")) is None


def test_the_file_of_the_rviz_node_is_the_one(tmp_path):
    put(tmp_path / "mine.rviz", "Visualization Manager: {}")
    node = {"name": "rviz", "args": f"-f odom -d {tmp_path}/mine.rviz", "remap": [["/a", "/b"]]}
    setup = rviz_view.find_setup(Plan(rviz=(node,)))
    assert (setup.source, setup.remaps) == ("its rviz node, mine.rviz", ("/a:=/b",))
    assert "without" in rviz_view.find_setup(Plan(rviz=({**node, "args": ""},))).source


def test_what_is_not_background_is_to_be_seen():
    empty = rviz_view.background(CONFIG)
    assert empty == [1, 2, 3]
    pixels = np.full((100, 100, 3), empty)
    assert rviz_view.foreground(pixels, empty) == 0
    pixels[50:55, 50:55] = 255
    pixels[:3] = 255  # menus are not looked at
    assert rviz_view.foreground(pixels, empty) == 25
    pixels[:] = 200
    assert rviz_view.foreground(pixels, empty) == 0, "a window that is not drawn yet"


# ---------------------------------------------------------------------------- strangers


def run(tmp_path, code, **env):
    return Process(
        [sys.executable, "-c", code], tmp_path / "log", {**os.environ, **env}, tmp_path, stranger=True
    )


def test_a_stranger_that_prints_without_end_fills_no_disk(tmp_path):
    process = run(tmp_path, "for i in range(600000): print('0123456789')\nprint('the end')")
    assert wait(lambda: not process.running, 60.0)
    assert wait(lambda: process.output.endswith("the end\n"), 10.0)
    assert len(process.output) <= LOG_HEAD + LOG_TAIL + 1
    assert wait(lambda: (tmp_path / "log").read_bytes().endswith(b"the end\n"), 10.0)
    assert (tmp_path / "log").stat().st_size < LOG_HEAD + LOG_TAIL + 100


def test_a_stranger_gets_no_input(tmp_path):
    keyboard, mine = os.pipe()[0], os.dup(0)
    os.dup2(keyboard, 0)  # nobody types on it, so whoever reads it waits for ever
    try:
        process = run(tmp_path, "import sys; print([sys.stdin.read()])")
        assert wait(lambda: not process.running, 20.0)
        assert wait(lambda: process.output == "['']\n", 10.0)
    finally:
        os.dup2(mine, 0)
        end_all([process], "NOBODY", "")


HIDDEN = """
import os, signal, time
for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(each, signal.SIG_IGN)
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        os.execve("/usr/bin/tail", ["a_hidden_child", "-f", "/dev/null"], {})
    os._exit(0)
time.sleep(1000)
"""


def hidden():
    """Processes that call themselves by the name that HIDDEN gives them."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            lines.append(path.read_bytes())
    return [line for line in lines if line.startswith(b"a_hidden_child\0")]


@pytest.mark.parametrize("apart", [True, False])
def test_nobody_is_left_of_a_stranger_that_hides_its_children(apart, tmp_path, monkeypatch):
    """With process namespaces and without: the child has no parent, no session and no environment of ours."""
    if apart and not namespaces():
        pytest.skip("this machine makes no process namespaces")
    monkeypatch.setattr(processes, "namespaces", lambda: apart)
    process = run(tmp_path, HIDDEN, WHOSE="a test's")
    assert wait(hidden, 30.0)
    assert end_all([process], "WHOSE", "a test's") == []
    assert hidden() == []
    assert not process.running


def test_without_namespaces_what_a_stranger_leaves_behind_ends_with_it(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "namespaces", lambda: False)
    process = run(tmp_path, HIDDEN.replace("time.sleep(1000)\n", "raise SystemExit(3)\n"))
    assert wait(lambda: not process.running, 30.0)
    assert process.popen.returncode == 3
    assert hidden() == []


@pytest.mark.skipif(not namespaces(), reason="this machine makes no process namespaces")
def test_a_stranger_sees_nobody_but_itself(tmp_path):
    code = "import os; print(os.getpid(), sorted(int(p) for p in os.listdir('/proc') if p.isdigit()))"
    process = run(tmp_path, code)
    assert wait(lambda: not process.running, 60.0)
    assert wait(lambda: process.output == "1 [1]\n", 10.0), process.output
