"""The examples without ROS run, and docs/evaluation.md shows the first of them as it stands."""

import re
import runpy
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from husky_evaluation import rollout, scenarios
from husky_highlevel_controller.paths import share_folder

SHARE = share_folder()
EXAMPLES = SHARE / "examples"


def run(name):
    command = [sys.executable, EXAMPLES / name]
    done = subprocess.run(
        command, env={"PYTHONPATH": str(SHARE / "src")}, capture_output=True, text=True, timeout=300.0
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_own_world_is_driven_through_without_a_contact():
    assert re.search(r"arrived after \d+\.\d\d s; contacts: none", run("own_world"))


def run_here(name, capsys, monkeypatch, **stand_ins):
    """What an example prints in this process, with stand-ins for what it imports by name."""
    for module in (rollout, scenarios):
        for each in stand_ins.keys() & vars(module).keys():
            monkeypatch.setattr(module, each, stand_ins[each])
    runpy.run_path(str(EXAMPLES / name))
    return capsys.readouterr().out


def assert_shows_earlier_arrivals(output):
    rows = [line.split() for line in output.splitlines() if re.match(r"\s+\d", line)]
    arrivals = [float(arrival) for _, arrival, _ in rows]
    assert len(rows) == 5
    assert arrivals == sorted(arrivals, reverse=True)


@pytest.mark.slow
def test_sweep_gain_shows_that_a_higher_gain_arrives_earlier():
    assert_shows_earlier_arrivals(run("sweep_gain"))


def test_sweep_gain_shows_a_row_for_each_drive(capsys, monkeypatch):
    def made_up(_, control):
        return SimpleNamespace(arrived_at=20.0 / control.p_gain_vel, nearest=np.array([0.5, 0.4]))

    assert_shows_earlier_arrivals(run_here("sweep_gain", capsys, monkeypatch, rollout=made_up))


def test_own_experiment_tells_difference_and_hash(capsys, monkeypatch):
    fewer = scenarios.random_starts(1, seed=0)
    told = run_here("own_experiment", capsys, monkeypatch, random_starts=lambda *_, **__: fewer)
    assert re.search(r"1 mm: [+-]\d\.\d{3} s \[[+-]\d\.\d{3}, [+-]\d\.\d{3}\] until the arrival", told)
    assert re.search(r"results \w{64} by .*numpy", told)


def test_the_docs_show_the_rollout_example():
    code = (EXAMPLES / "rollout").read_text().split('"""\n', 1)[1]
    assert f"```python\n{code}```" in (SHARE / "docs" / "evaluation.md").read_text()


@pytest.mark.parametrize("example", sorted(path.name for path in EXAMPLES.iterdir() if path.is_file()))
def test_every_example_is_installed(example):
    assert f"examples/{example}\n" in (SHARE / "CMakeLists.txt").read_text()
