"""The drives of a marking, its command line, and RViz's configurations."""

from dataclasses import replace
from math import atan2, hypot

import numpy as np
import pytest

from husky_highlevel_controller.geometry import wrap_angle
from husky_highlevel_controller.grading.cli import parse
from husky_highlevel_controller.grading.drive import rviz_check, rviz_setup
from husky_highlevel_controller.grading.drive.plan import Plan, RvizNode
from husky_highlevel_controller.grading.drive.trials import draw_trials, rviz_world, trial_world
from husky_highlevel_controller.simulator.models.sdf_world import load_world

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
    (tmp_path / "a.world").write_text(trial_world(trial, "husky"))
    (pillar,) = (t for t in load_world(tmp_path / "a.world").bodies if t.name == "unit_cylinder")
    assert pillar.pose_in_world.position[:2] == trial.pillar


def test_the_world_for_rviz_has_something_to_see_all_around(tmp_path):
    (tmp_path / "a.world").write_text(rviz_world())
    posts = [t for t in load_world(tmp_path / "a.world").bodies if t.name.startswith("post_")]
    assert len(posts) == 8
    assert min(hypot(*post.pose_in_world.position[:2]) for post in posts) > 1.2


# ---------------------------------------------------------------------------- the command line


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


# ---------------------------------------------------------------------------- RViz's configuration

SCAN, GRID, MODEL = {"Class": "rviz/LaserScan"}, {"Class": "rviz/Grid"}, {"Class": "rviz/RobotModel"}
OFF = {"Class": "rviz/TF", "Enabled": False}
CONFIG = {
    "Visualization Manager": {
        "Displays": [GRID, OFF, {"Class": "rviz/Group", "Displays": [SCAN, MODEL]}],
        "Global Options": {"Background Color": "1; 2; 3"},
    }
}


def put(path, text=""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_one_display_is_left_wherever_it_is():
    kept = rviz_setup.only(CONFIG, "rviz/LaserScan")["Visualization Manager"]["Displays"]
    assert kept == [{"Class": "rviz/Group", "Displays": [SCAN]}]
    assert len(CONFIG["Visualization Manager"]["Displays"]) == 3, "the configuration itself stays"


def test_no_display_asks_for_udp_which_rospy_does_not_speak():
    scan = {**SCAN, "Unreliable": True}
    config = {"Visualization Manager": {"Displays": [scan, {"Class": "rviz/Group", "Displays": [scan]}, 7]}}
    displays = rviz_setup.placed(config)["Visualization Manager"]["Displays"]
    tcp = {**SCAN, "Unreliable": False}
    assert displays == [tcp, {"Class": "rviz/Group", "Displays": [tcp]}]


def test_only_what_is_switched_on_counts(tmp_path):
    put(tmp_path / "a.rviz", "Visualization Manager: {Displays: [{Class: rviz/TF, Enabled: false}]}")
    put(tmp_path / "z" / "b.rviz", "Visualization Manager: {Displays: [{Class: rviz/LaserScan}]}")
    put(tmp_path / "c.rviz", "- no: rviz")
    assert rviz_setup.find_setup(Plan(package_path=tmp_path)).source == "b.rviz"
    assert rviz_setup.find_setup(Plan()) is None


def test_the_file_of_the_rviz_node_is_the_one(tmp_path):
    put(tmp_path / "mine.rviz", "Visualization Manager: {}")
    node = RvizNode("rviz", f"-f odom -d {tmp_path}/mine.rviz", (("/a", "/b"),))
    setup = rviz_setup.find_setup(Plan(rviz=(node,)))
    assert (setup.source, setup.remaps) == ("its rviz node, mine.rviz", ("/a:=/b",))
    assert rviz_setup.find_setup(Plan(rviz=(replace(node, args=""),))) is None, "it is in the student's home"
    (tmp_path / "ws").mkdir()
    assert rviz_setup.find_setup(Plan(rviz=(node,)), tmp_path / "ws") is None, "it is not in the hand-in"


def test_what_is_not_background_is_to_be_seen():
    empty = rviz_setup.background(CONFIG)
    assert empty == [1, 2, 3]
    pixels = np.full((100, 100, 3), empty)
    assert rviz_check.foreground(pixels, empty) == 0
    pixels[50:55, 50:55] = 255
    pixels[:3] = 255  # menus are not looked at
    assert rviz_check.foreground(pixels, empty) == 25
    pixels[:] = 200
    assert rviz_check.foreground(pixels, empty) == 0, "a window that is not drawn yet"
