"""Judging of a hand-in by its files: what is told beside the items."""

from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.grading.judge import judge
from husky_highlevel_controller.grading.recording import Recording
from husky_highlevel_controller.grading.records import Job, Launchable, MarkingConfig
from husky_highlevel_controller.grading.submission import Submission

RECORDING = Recording(Pose2D(), (20.0, 5.0), 60.0)
SUBMISSION = Submission(Launchable("launch", "a", "a.launch"))


def notes(drives, **config):
    job = Job("ann", "out", MarkingConfig(robot="husky", **config))
    return " ".join(judge(SUBMISSION, [RECORDING] * drives, job).notes)


def test_fewer_drives_than_asked_for_are_told():
    assert "1 of 3 drives were made" in notes(1, trials=3)
    assert "drives were made" not in notes(3, trials=3)
    assert "drives were made" not in notes(1, trials=3, exercise=5), "it asks for one"
