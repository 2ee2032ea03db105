"""Tuning finds the best values, the same for a seed, goes on after an end; the launch file loads them."""

import re
import sys
from math import inf
from pathlib import Path

import pytest
import yaml

from husky_evaluation import metrics, tune
from husky_evaluation.metrics import DriveResult
from husky_evaluation.scenarios import random_starts
from husky_evaluation.setup import Setup, setup_of
from husky_evaluation.tasks.workers import Workers
from husky_evaluation.tune import Objective, Range, parse_range, parse_weights
from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.result import Table

RANGES = [Range("p_gain_vel", 0.1, 10.0), Range("p_gain_ang", 0.1, 10.0), Range("min_beams", 2, 20)]
CALLS = "calls"


def valley(item):
    """In place of a drive: the best values are 3, 5 and 2."""
    setup, scene = item
    time = 20.0 + (setup.control.p_gain_vel - 3.0) ** 2 + abs(setup.control.p_gain_ang - 5.0)
    return DriveResult(scene.name, time + setup.detector.min_beams, 10.0, 0.0, 0.2, 0.0, (), 0, 0.0, 0.2)


def valley_with_notes(item):
    with Path(CALLS).open("a") as file:
        file.write("x")
    return valley(item)


def search(jobs=2, seed=0, trials=40, resume=None, drive=valley):
    pytest.importorskip("optuna")
    with Workers(jobs, resume=resume) as workers:
        return tune.tune(RANGES, Setup(), random_starts(2, 0), Objective(), trials, seed, workers, drive)


def test_it_finds_the_valley_the_same_for_a_seed_whoever_drives():
    found = search(trials=96)  # Optuna 4.5, the last for Python 3.8, needs more than Optuna 5
    assert found == search(trials=96, jobs=1)
    assert found.trials[:40] != search(seed=1).trials
    assert found.trials[0] == {"p_gain_vel": 2.0, "p_gain_ang": 2.0, "min_beams": 2, "objective": 16.0}, (
        "defaults"
    )
    assert min(row["objective"] for row in found.trials) < 14.5
    assert abs(found.values["p_gain_vel"] - 3.0) < 1.0


def test_an_interrupted_tuning_goes_on_where_it_was(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    search(trials=16, resume=tmp_path / "file", drive=valley_with_notes)
    done = len(Path(CALLS).read_text())
    whole = search(trials=32, resume=tmp_path / "file", drive=valley_with_notes)
    assert whole == search(trials=32)
    assert len(Path(CALLS).read_text()) == 2 * done == 64


def test_the_cost_is_as_it_says():
    drive = DriveResult("a", 12.0, 10.0, 0.0, 0.2, 0.0, (), 2, 0.05, 0.2)
    assert Objective().cost(drive, 180.0) == pytest.approx(2.0 + 5.0 + 2.0)
    assert Objective(crossing=0.0, overshoot=0.0).cost(drive, 180.0) == 2.0
    lost = DriveResult("a", inf, 10.0, 0.0, 0.2, 0.0, ("unit_cylinder",), 0, 0.0, 0.0)
    assert Objective().cost(lost, 180.0) == 170.0 + 60.0 + 30.0
    assert parse_weights(["touch=1", "failure=5"]) == Objective(touch=1.0, failure=5.0)


def late_or_never(item):
    """In place of a drive: with a gain below 1 it arrives late, and else it never arrives."""
    setup, scene = item
    time = 590.0 if setup.control.p_gain_vel < 1.0 else inf
    return DriveResult(scene.name, time, 10.0, 0.0, 0.2, 0.0, (), 0, 0.0, 0.2)


def test_a_run_that_never_arrives_costs_more_than_a_late_arrival():
    pytest.importorskip("optuna")
    base, scenes = setup_of("robot"), random_starts(1, 0)
    with Workers(1) as workers:
        tuned = tune.tune([RANGES[0]], base, scenes, Objective(), 16, 0, workers, late_or_never)
        fails = base.with_values({"p_gain_vel": 2.0})
        assert not tune.check(base, fails, scenes, Objective(), workers, late_or_never).is_better
    assert tuned.values["p_gain_vel"] < 1.0


def test_a_small_value_is_shown_with_its_digits():
    tuned = tune.Tuned({"p_gain_vel": 0.0001234}, [{"p_gain_vel": 0.0001234, "objective": 1.0}])
    fresh = tune.Check(Table("", (), []), True)
    assert "0.0001234" in str(tune.result_of_tuning(tuned, Setup(), Objective(), fresh, "of 1", "by"))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("gain=1:2", "gain is not a numeric controller parameter; there are: arrival_tolerance, "),
        ("search", "search is not a numeric controller parameter"),
        ("lidar/noise=0:1", "lidar/noise is not a numeric controller parameter"),
        ("p_gain_vel=1", "p_gain_vel = '1' is not LOW:HIGH, such as 0.0:10.0"),
        ("min_beams=nan:3", "min_beams = 'nan:3' is not LOW:HIGH"),
        ("p_gain_vel=1:11", "p_gain_vel = 11.0 is out of range"),
        ("p_gain_vel=2:1", "p_gain_vel = 2:1: 2 is not below 1"),
        ("min_beams=3.2:3.8", "min_beams = 3.2:3.8: the range has fewer than two whole numbers"),
        ("min_beams=3.5:4.5", "min_beams = 3.5:4.5: the range has fewer than two whole numbers"),
        (["time=1"], "'time' is not known"),
        (["touch=a"], "'a' is not a number"),
        (["touch=-1"], "-1.0 is out of range"),
    ],
)
def test_what_is_no_range_or_no_weight_is_named(text, sentence):
    with pytest.raises(ConfigError, match=sentence):
        parse_weights(text) if isinstance(text, list) else parse_range(text, Setup())


def test_a_range_without_limits_is_all_that_is_allowed():
    assert parse_range("p_gain_vel", Setup()) == ("p_gain_vel", 0.0, 10.0)
    assert parse_range("min_beams=2:9", Setup()) == ("min_beams", 2.0, 9.0)


def test_a_range_of_whole_numbers_holds_no_number_outside_of_its_limits():
    assert parse_range("min_beams=3.5:6.5", Setup()) == ("min_beams", 4.0, 6.0)


def test_a_parameter_has_one_range(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        tune.main(["p_gain_vel=1:2", "p_gain_vel=3:4", "--out", str(tmp_path)])
    assert "p_gain_vel is given twice; give one range" in capsys.readouterr().err


def test_without_optuna_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(HuskyError, match=r"pip install -r requirements/cluster\.txt"):
        tune._require_optuna()


def test_what_it_writes_is_what_the_launch_file_loads(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")  # a robot may be running
    ranges, scenes = [Range("p_gain_vel", 0.1, 10.0)], random_starts(2, 0)
    with Workers(1) as workers:
        tuned = tune.tune(ranges, Setup(), scenes, Objective(), 8, 0, workers, valley)
        fresh = tune.check(Setup(), Setup().with_values(tuned.values), scenes, Objective(), workers, valley)
        tune.write_tuned(
            tune.result_of_tuning(tuned, Setup(), Objective(), fresh, "of 8", "by"), tuned, "of 8", tmp_path
        )
    told = capsys.readouterr().out
    assert "on 2 fresh starts" in told
    file = tmp_path / "tuned.yaml"
    assert f"controller.launch parameters:={file}" in told
    assert "better than the defaults" not in told
    assert "p_gain_vel" in (tmp_path / "index.html").read_text()
    (value,) = yaml.safe_load(file.read_text()).values()
    roslaunch = pytest.importorskip("roslaunch.config")
    launch = str(share_folder() / "launch" / "controller.launch")
    for arguments, loaded in ([], 2.0), ([f"parameters:={file}"], value):
        config = roslaunch.load_config_default([(launch, ["rviz:=false", *arguments])], None, verbose=False)
        name = "/husky_highlevel_controller/p_gain_vel"
        assert config.params[name].value == loaded
        assert config.params["/husky_highlevel_controller/p_gain_ang"].value == 2.0


def test_the_printed_line_launches_what_was_tuned(tmp_path, capsys, monkeypatch):
    pytest.importorskip("optuna")
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")  # a robot may be running
    monkeypatch.setattr(metrics, "SEARCH_SECONDS", 2.0)
    words = ["p_gain_ang=0.5:4", "--setups", "1", "--starts", "1", "--fresh", "1", "--jobs", "1"]
    tune.main([*words, "--profile", "robot", "--ground", "soft", "--out", str(tmp_path)])
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("roslaunch "))
    assert line.split()[3:] == ["profile:=robot", "ground:=soft", f"parameters:={tmp_path}/tuned.yaml"]
    assert tune.launch_arguments("gazebo", "hard", "smb") == ["robot:=smb"]
    roslaunch = pytest.importorskip("roslaunch.config")
    launch = str(share_folder() / "launch" / "controller.launch")
    config = roslaunch.load_config_default(
        [(launch, ["rviz:=false", *line.split()[3:]])], None, verbose=False
    )
    for name, value in tune.controller_values(setup_of("robot")).items():
        assert config.params[f"/husky_highlevel_controller/{name}"].value == value, name


def test_it_is_told_if_the_defaults_outside_of_the_range_are_better():
    ranges, scenes = [Range("p_gain_vel", 0.1, 1.0)], random_starts(2, 0)
    with Workers(1) as workers:
        tuned = tune.tune(ranges, Setup(), scenes, Objective(), 4, 0, workers, valley)
        fresh = tune.check(Setup(), Setup().with_values(tuned.values), scenes, Objective(), workers, valley)
    result = tune.result_of_tuning(tuned, Setup(), Objective(), fresh, "of 4", "by")
    assert result.verdict == "on the fresh starts, the found values are not better than the defaults"


def test_the_command_drives(tmp_path, capsys):
    pytest.importorskip("optuna")
    words = ["p_gain_vel=1:4", "--setups", "1", "--starts", "1", "--fresh", "1", "--jobs", "1"]
    tune.main([*words, "--out", str(tmp_path)])
    told = capsys.readouterr().out
    assert re.search(r"within 2 cm, no touch \[%\] +100\.000 +100\.000\n", told)
    assert "nothing better than the defaults was found in 1 setups" in told
