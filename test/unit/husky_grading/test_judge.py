"""Judging of a hand-in by its files: what is told beside the items, and to whom it could not be marked."""

from dataclasses import replace

import numpy as np
import pytest

from husky_grading.displays import RvizConfig, RvizDisplay
from husky_grading.exercises.exercise_3 import SHOWS_DISPLAYS
from husky_grading.judge import judge, unmarked
from husky_grading.mark import mark
from husky_grading.recording import Recording
from husky_grading.records import Job, Launchable, MarkingConfig
from husky_grading.submission import Submission
from husky_highlevel_controller.datatypes import Pose2D

RECORDING = Recording(Pose2D(), (20.0, 5.0), 60.0)
SUBMISSION = Submission(Launchable("launch", "a", "a.launch"))


def notes(drives, **config):
    job = Job("ann", "out", MarkingConfig(robot="husky", **config))
    return " ".join(judge(SUBMISSION, [RECORDING] * drives, job).notes)


def test_fewer_drives_than_asked_for_are_told():
    assert "1 of 3 runs were made" in notes(1, trials=3)
    assert "runs were made" not in notes(3, trials=3)
    assert "runs were made" not in notes(1, trials=3, exercise=5), "it asks for one"


DISPLAYS = (
    RvizDisplay("rviz/TF"),
    RvizDisplay("rviz/RobotModel", "/robot_description"),
    RvizDisplay("rviz/LaserScan", "/front/scan"),
)
FIXED_FRAMES = {"base_footprint": "base_link", "map": "odom", "front_laser": "base_link"}


@pytest.mark.parametrize(
    ("fixed_frame", "times", "points"),
    [("odom", [], 20.0), ("map", [], 20.0), ("nowhere", [], 0.0), ("odom", [0.02], 0.0)],
)
def test_a_node_that_ends_before_the_odometry_begins_keeps_its_points_for_rviz(fixed_frame, times, points):
    config = RvizConfig("its rviz node, a.rviz", fixed_frame, DISPLAYS)
    poses = {
        "times": np.array(times),
        "poses": np.zeros((len(times), 3)),
        "speeds": np.zeros((len(times), 2)),
    }
    recording = replace(RECORDING, frames=FIXED_FRAMES, **poses)
    result = judge(
        replace(SUBMISSION, rviz=config), [recording], Job("ann", "out", MarkingConfig(robot="husky"))
    )
    assert {item.name: item.points for item in result.items}[SHOWS_DISPLAYS] == points, result


JOB = Job("O'Brien", "/var/tmp/marking_0/hand_in", MarkingConfig(), hand_in="/home/me/my class/O'Brien")


@pytest.mark.parametrize(
    ("problem", "shown"),
    [
        ("File name too long: /var/tmp/marking_0/hand_in/ws/src/a", "File name too long: ws/src/a"),
        ("/home/me/my class/O'Brien: more than 9 files", "O'Brien: more than 9 files"),
        ("No such file or directory: '/usr/lib/x/a.py'", "No such file or directory: 'a.py'"),
        ("/husky_simulator/step and src/a/b.cpp, 1/2", "/husky_simulator/step and src/a/b.cpp, 1/2"),
    ],
)
def test_a_student_reads_no_path_of_the_marking_machine(problem, shown):
    assert unmarked(JOB, problem).problem == shown


def test_a_marking_that_is_judged_again_at_the_teachers_folder_names_no_neutral_path_either():
    problem = "its launch file names /var/tmp/marking_1000/hand_in/ws/src/a.rviz"
    assert unmarked(replace(JOB, out="/home/me/results/ann"), problem).problem == (
        "its launch file names ws/src/a.rviz"
    )


def test_a_package_whose_name_no_file_can_have_is_named_without_a_path(tmp_path):
    folder = tmp_path / "class" / "ann" / "p"
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(f"<package><name>{'n' * 300}</name></package>")
    result = mark(Job("ann", str(tmp_path / "out"), MarkingConfig(), hand_in=str(folder.parent)))
    assert "and 220 more characters, which is not a valid name of a package" in result.problem
    for page in ("feedback.html", "table.txt", "junit.xml"):
        assert str(tmp_path) not in (tmp_path / "out" / page).read_text()
