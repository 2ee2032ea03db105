"""Observing stage: which drives are made, and with which robot."""

from dataclasses import replace

import numpy as np
import pytest

from husky_grading.drive import observe as observe_module
from husky_grading.drive.bring_up import simulate
from husky_grading.drive.observe import observe
from husky_grading.drive.run import Driven, not_begun
from husky_grading.drive.trials import draw_trials
from husky_grading.notes import Kind, Note
from husky_grading.recording import recordings_in
from husky_grading.records import Launchable, MarkingConfig
from husky_grading.submission import NamedRobot, Submission

SUBMISSION = Submission(Launchable("launch", "a", "a.launch"), robot=NamedRobot("husky", "by its topic"))
AUTO, OLDER = MarkingConfig(robot="auto"), MarkingConfig(robot="husky_melodic")


@pytest.fixture
def drives(monkeypatch):
    """Drives that were made, as (number, robot); a submission that listens to the older Husky's scans."""
    made, moves = [], {}

    def drive(submission, trial, robot, **_):
        if robot.is_guess and robot.config.robot != OLDER.robot:
            return Driven(robot.after_hearing(OLDER))
        made.append((trial.number, robot.config.robot))
        recording = not_begun(trial, robot.config)
        row = [[1.0, 0.0] if moves.get(trial.number, True) else [0.0, 0.0]]
        return Driven(robot, replace(recording, times=np.array([0.1]), speeds=np.array(row)))

    monkeypatch.setattr(observe_module, "drive_submission", drive)
    monkeypatch.setattr(observe_module, "is_worth_checking", lambda _: True)
    return made, moves


def check_tells(listened, monkeypatch):
    def find_unwritten_variable(submission, trial, robot, folder):
        return "", robot.after_hearing(listened)

    monkeypatch.setattr(observe_module, "find_unwritten_variable", find_unwritten_variable)


@pytest.mark.parametrize("listened", [None, OLDER], ids=["it died in the check", "it listened there"])
def test_the_robot_is_a_guess_until_the_check_or_a_drive_has_seen_what_it_listens_to(
    listened, drives, tmp_path, monkeypatch
):
    check_tells(listened, monkeypatch)
    observe(SUBMISSION, draw_trials(2, 0), AUTO, simulate, tmp_path)
    assert drives[0] == [(1, "husky_melodic"), (2, "husky_melodic")]


def test_only_a_robot_that_never_moves_in_its_first_drive_has_no_further_one(drives, tmp_path, monkeypatch):
    made, moves = drives
    check_tells(None, monkeypatch)
    moves[2] = False
    observe(SUBMISSION, draw_trials(3, 0), AUTO, simulate, tmp_path)
    assert [number for number, _ in made] == [1, 2, 3]
    made.clear()
    moves[1] = False
    observe(SUBMISSION, draw_trials(3, 0), AUTO, simulate, tmp_path)
    assert [number for number, _ in made] == [1]


def test_the_facts_of_a_submission_that_cannot_be_started_are_kept(tmp_path):
    problem = (Note(Kind.LAUNCH_FILE, "the launch file cannot be loaded"),)
    facts = {"players": ["--clock a.bag"], "curves": [["/odometry/x", "/odometry/y"]]}
    submission = replace(SUBMISSION, problem=problem, facts=facts)
    observe(submission, draw_trials(1, 0), MarkingConfig(exercise=4), simulate, tmp_path)
    (recording,) = recordings_in(tmp_path)
    assert recording.watched == facts
