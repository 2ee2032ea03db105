"""Two controllers on the same scenes: differences, scenes in which one fails, and the exit code for CI."""

import sys
from dataclasses import replace
from math import dist, inf

import numpy as np
import pytest

from husky_evaluation import compare, metrics
from husky_evaluation.compare import Comparison
from husky_evaluation.contestant import Outcome, contestant, drive_scene, outcome
from husky_evaluation.scenarios import random_starts
from husky_evaluation.setup import Setup
from husky_grading import compare as grading_compare
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.robot import load_robot

BASE = Outcome("start 0", 10.0, 0.3, np.zeros((2, 3)), (20.0, 5.0))
TIMID = '''
from husky_highlevel_controller.controller.behaviour import decide as reference

def decide(state, observation, enabled, control, detector):
    """Far from the pillar it does not dare to move."""
    state, output = reference(state, observation, enabled, control, detector)
    far = output.distance_error > 6.0
    return state, output._replace(twist=type(output.twist)(0.0, 0.0)) if far else output

def broken(state, observation, enabled, control, detector):
    return 1 / 0

def leaves(state, observation, enabled, control, detector):
    raise SystemExit(3)

nothing = 3
'''


def times(*values):
    return tuple(replace(BASE, scene=f"start {n}", arrived_at=value) for n, value in enumerate(values))


def comparison(a, b):
    return Comparison(("a", "b"), times(*a), times(*b))


FAILS = "starts at which only B fails: 1, only A: 0"


@pytest.mark.parametrize(
    ("a", "b", "why"),
    [
        ([10.0, 20.0], [10.0, 20.0], ""),
        ([10.0, 20.0], [10.5, 20.5], ""),
        ([10.0, 20.0], [11.0, 21.0], "it may be 1.000 s slower, and 0.750 s are allowed"),
        ([10.0, 20.0], [10.0, inf], FAILS),
        ([10.0, inf], [10.0, 20.0], ""),
        ([10.0, inf, 10.0], [inf, 20.0, 10.0], ""),
        ([10.0, inf], [inf, 20.0], ""),
        ([inf, inf], [inf, 20.0], ""),
        ([10.0, inf], [inf, inf], FAILS),
    ],
)
def test_worse_is_what_fails_more_often_or_may_be_slower_than_the_margin(a, b, why):
    assert comparison(a, b).worse(0.05) == why


def test_two_sides_that_never_succeed_cannot_be_compared(tmp_path, capsys, monkeypatch):
    with pytest.raises(HuskyError, match="neither A nor B succeeds from any start"):
        comparison([inf, inf], [inf, inf]).result(0.05, "")
    monkeypatch.setattr(metrics, "DRIVE_SECONDS", 2.0)
    (tmp_path / "lazy.yaml").write_text("p_gain_vel: 0")
    with pytest.raises(SystemExit, match="2"):
        compare.main([f"{tmp_path}/lazy.yaml"] * 2 + ["--starts", "1", "--jobs", "1", "--out", str(tmp_path)])
    assert "neither A nor B succeeds from any start" in capsys.readouterr().err


def test_times_are_compared_where_both_succeed():
    result = comparison([10.0, 20.0, inf], [9.0, 19.0, 1.0])
    assert result.values("arrived_at") == ([10.0, 20.0], [9.0, 19.0])
    assert "-1.000 s [-1.000, -1.000]" in str(result.figures())
    (line,) = (line for line in str(result.result(0.05, "")).splitlines() if "start 2" in line)
    assert [text.strip() for text in line.split("  ") if text] == [
        "start 2: only A fails", "not at the pillar in the end", "at the pillar after 1.00 s"
    ]  # fmt: skip


def test_an_outcome_is_judged_by_the_poses():
    seconds = np.arange(0.0, 10.0, 0.1)
    poses = np.zeros((100, 3))
    poses[:, 0] = np.minimum(seconds, 4.0)  # stops with the hull's front at 4.49 m
    there = outcome("s", seconds, poses, (5.0, 0.0), load_robot())
    assert there.success
    assert there.arrived_at == pytest.approx(4.1)
    assert there.nearest == pytest.approx(5.0 - 0.2 - 4.0 - 0.4937, abs=1e-3)
    assert not outcome("s", seconds, poses, (5.6, 0.0), load_robot()).success, "too far away"
    assert outcome("s", seconds, poses, (4.68, 0.0), load_robot()).summary.endswith("touched the pillar")
    poses[:, 0] = seconds
    assert outcome("s", seconds, poses, (10.5, 0.0), load_robot()).arrived_at == inf, "it still drives"


def test_the_command_draws_where_one_fails_and_ends_with_1(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(metrics, "DRIVE_SECONDS", 40.0)
    (tmp_path / "timid.py").write_text(TIMID)
    (tmp_path / "quick.yaml").write_text("{p_gain_vel: 3.0, start_enabled: true}")
    distances = {
        scene.name: dist((20.0, 5.0), (scene.start.x, scene.start.y)) for scene in random_starts(2, 8)
    }
    (far,) = (name for name, distance in distances.items() if distance > 7.5)
    arguments = [f"{tmp_path}/quick.yaml", f"{tmp_path}/timid.py:decide", "--starts", "2", "--seed", "8"]
    with pytest.raises(SystemExit, match="1"):
        compare.main([*arguments, "--jobs", "1", "--out", str(tmp_path / "out")])
    assert f"{far}: only B fails  at the pillar after" in capsys.readouterr().out
    (picture,) = (tmp_path / "out").glob("*.png")
    assert picture.stem == f"only_b_fails_{far.replace(' ', '_')}"
    assert "B is worse than A: starts at which only B fails" in (tmp_path / "out" / "index.html").read_text()
    assert (tmp_path / "out" / "compare.csv").read_text().count("\n") == 3


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a", "'a' is not a valid controller; give FILE.yaml"),
        ("nowhere.yaml", "nowhere.yaml: .*No such file"),
        ("nowhere.py:decide", "nowhere.py is not a Python file or module that can be read"),
        ("no_module:decide", "no_module is not a Python file or module that can be read"),
        ("FILE:nothing", "nothing is not a function"),
        ("FILE:other", "has no attribute 'other'"),
        ("package/file.launch", "package/file.launch: a launch file needs ROS; run rosrun"),
        ("nowhere.yaml extra", "'nowhere.yaml extra' is not a valid controller"),
        ("o'brien", "\"?'o'brien' is not a valid controller"),
        ("EXITS:decide", r"exits\.py:decide: SystemExit: 0"),
        ("FILE:leaves", r"timid\.py:leaves fails in start 0: SystemExit: 3"),
        ("FILE:broken", r"timid\.py:broken fails in start 0: ZeroDivisionError"),
    ],
)
def test_what_is_no_contestant_or_fails_is_named(tmp_path, text, sentence):
    (tmp_path / "timid.py").write_text(TIMID)
    (tmp_path / "exits.py").write_text("import sys\ndecide = None\nsys.exit(0)\n")
    text = text.replace("FILE", f"{tmp_path}/timid.py").replace("EXITS", f"{tmp_path}/exits.py")
    with pytest.raises(HuskyError, match=sentence):
        drive_scene((contestant(text, Setup()), random_starts(1, 0)[0]))


def test_a_function_may_import_files_beside_its_own_and_modules_of_its_package(tmp_path, monkeypatch):
    for name, text in (
        ("a_helper.py", TIMID),
        ("mine.py", "from a_helper import decide\n"),
        ("a_package/__init__.py", ""),
        ("a_package/base.py", TIMID),
        ("a_package/fast.py", "from .base import decide\n"),
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert callable(contestant(f"{tmp_path}/mine.py:decide", Setup()).controller)
    sys.path.append(str(tmp_path))
    assert callable(contestant("a_package.fast:decide", Setup()).controller)


@pytest.mark.parametrize("name", ["my gains", "o'brien"])
def test_the_name_of_a_file_may_have_a_space_or_an_apostrophe(name, tmp_path):
    gains, code = tmp_path / f"{name}.yaml", tmp_path / f"{name}.py"
    gains.write_text("p_gain_vel: 0.4")
    code.write_text(TIMID)
    assert contestant(str(gains), Setup()).setup.control.p_gain_vel == 0.4
    assert contestant(f"{code}:decide", Setup()).function == "decide"


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        (("--profile", "robot"), "--profile robot does not work with a launch file; use --profile gazebo"),
        (("--robot", "smb"), "--robot smb does not work with a launch file; use --robot husky"),
    ],
)
def test_a_launch_file_is_known_by_its_package_and_drives_with_one_profile_only(
    option, sentence, tmp_path, capsys
):
    text = "husky_highlevel_controller/controller.launch naive:=true"
    one = contestant(text, Setup(), grading_compare.launch_contestant)
    assert one.launch.command[1:] == ("husky_highlevel_controller", "controller.launch", "naive:=true")
    with pytest.raises(SystemExit, match="2"):
        grading_compare.main([one.name, one.name, *option, "--out", str(tmp_path)])
    assert sentence in capsys.readouterr().err
