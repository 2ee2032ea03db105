"""The drives of a marking, its command line, and RViz's configurations."""

from math import atan2, hypot

import pytest

from husky_highlevel_controller.geometry import wrap_angle
from husky_highlevel_controller.grading.cli import parse
from husky_highlevel_controller.grading.drive.trials import draw_trials, trial_world
from husky_highlevel_controller.simulator.models.sdf_world import load_world


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
    (tmp_path / "a.world").write_text(trial_world(trial, "husky"))
    (pillar,) = (t for t in load_world(tmp_path / "a.world").bodies if t.name == "unit_cylinder")
    assert pillar.pose_in_world.position[:2] == trial.pillar


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--launch", "only_a_package"],
        ["--node", "p", "n", "--all", "."],
        ["--all", "/no/such/folder"],
        ["--launch", "p", "f", "--trials", "0"],
        ["--launch", "p", "f", "--trials", "1001"],
        ["--launch", "p", "f", "--seed", "-1"],
        ["--launch", "p", "f", "--exercise", "1"],
        ["--launch", "p", "f", "--underlay", "/no/such/setup.bash"],
    ],
)
def test_a_command_line_that_makes_no_sense_is_refused(arguments, capsys):
    with pytest.raises(SystemExit) as refused:
        parse(arguments)
    assert refused.value.code == 2
    assert "error:" in capsys.readouterr().err


def test_the_former_name_of_an_option_names_the_new_one(capsys):
    with pytest.raises(SystemExit):
        parse(["--launch", "p", "f", "--husky", "melodic"])
    assert "--husky melodic: it is --robot now: auto, husky, husky_melodic, smb" in capsys.readouterr().err
