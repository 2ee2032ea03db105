"""The drives of a marking, and its command line."""

from math import atan2, hypot

import pytest

from husky_grading.cli import parse
from husky_grading.drive.trials import draw_trials, trial_world
from husky_grading.records import ROBOT_VERSIONS
from husky_highlevel_controller.course import PILLARS
from husky_highlevel_controller.geometry import wrap_angle
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.simulator.models.sdf_world import parse_world


def test_the_first_drive_is_the_course_s_and_the_others_are_the_same_for_a_seed_with_the_pillar_in_view():
    trials = draw_trials(50, seed=3)
    assert trials[0].pillar == (20.0, 5.0)
    assert (trials[0].start.x, trials[0].start.yaw) == (0.0, 0.0)
    assert draw_trials(3, seed=3) == trials[:3]
    assert draw_trials(5, seed=4)[1:] != trials[1:5]
    for trial in trials[1:]:
        dx, dy = trial.pillar[0] - trial.start.x, trial.pillar[1] - trial.start.y
        assert 7.9 <= hypot(dx, dy) <= 20.1
        assert abs(wrap_angle(atan2(dy, dx) - trial.start.yaw)) <= 1.01


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_world_of_a_drive_has_its_pillar_as_the_robot_s_sheets_say(robot):
    trial = draw_trials(2, seed=0)[1]
    (pillar,) = (b for b in parse_world(trial_world(trial, robot), "w").bodies if b.name == "unit_cylinder")
    shape = pillar.collisions[0].shape
    assert pillar.pose_in_world.position[:2] == trial.pillar
    assert (shape.radius, shape.length) == PILLARS[robot]
    assert {version.partition("_")[0] for version in ROBOT_VERSIONS} == set(ROBOTS)


LAUNCH = ["--launch", "p", "f"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ""),
        (["--launch", "only_a_package"], ""),
        (["--node", "p", "n", "--all", "."], ""),
        (["--all", "/no/such/folder"], ""),
        ([*LAUNCH, "--trials", "0"], ""),
        ([*LAUNCH, "--trials", "1001"], ""),
        ([*LAUNCH, "--seed", "-1"], ""),
        ([*LAUNCH, "--exercise", "1"], ""),
        ([*LAUNCH, "--underlay", "/no/such/setup.bash"], ""),
        # its former name
        ([*LAUNCH, "--husky", "melodic"], "--husky is now called --robot; choose from auto, husky, "),
    ],
)
def test_a_command_line_that_makes_no_sense_is_refused(arguments, words, capsys):
    with pytest.raises(SystemExit) as refused:
        parse(arguments)
    assert refused.value.code == 2
    error = capsys.readouterr().err
    assert "error:" in error
    assert words in error
