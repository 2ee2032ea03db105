"""Start of the simulator for a drive: its nodes' names, and what a submission cannot read of it."""

import subprocess
from types import SimpleNamespace

from husky_grading.drive import bring_up
from husky_grading.drive.bring_up import SIMULATOR_LAUNCH, simulate
from husky_grading.drive.trials import draw_trials
from husky_grading.records import MarkingConfig
from husky_grading.submission import SIMULATOR_NODES


def test_the_names_kept_for_the_simulator_are_those_of_its_launch_file():
    command = ["roslaunch", "--nodes", str(SIMULATOR_LAUNCH), "rviz:=false"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    printed = done.stdout.split()
    assert tuple(word for word in printed if word.startswith("/")) == SIMULATOR_NODES


def test_start_and_seed_from_which_the_pillar_could_be_drawn_are_no_parameters_of_a_drive(
    tmp_path, monkeypatch
):
    trial, parameters, config = draw_trials(2, 7)[1], {}, MarkingConfig(robot="husky")
    monkeypatch.setattr(bring_up, "_SETUPS", {config.simulator_arguments: ({}, [])})
    monkeypatch.setattr(bring_up, "set_parameters", lambda _, values: parameters.update(values))
    monkeypatch.setattr(bring_up, "has_service", lambda *_: True)
    seen = []

    def start(*_, **__):
        seen.append(dict(parameters))
        return SimpleNamespace(running=True)

    simulate(SimpleNamespace(folder=tmp_path, uri="", start=start), trial, config)
    secrets = {trial.start.x, trial.start.y, trial.start.yaw, trial.seed}
    assert secrets <= set(seen[0].values()), "the simulator reads them"
    assert secrets.isdisjoint(parameters.values())
