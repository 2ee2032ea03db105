"""Choice of the robot: the teacher's name stands, then what is heard, then what the files name."""

import pytest

from husky_grading.drive.robot_choice import choose_robot
from husky_grading.records import Launchable, MarkingConfig
from husky_grading.submission import NamedRobot, Submission

LAUNCH = Launchable("launch", "a", "a.launch")
GUESS, CERTAIN = NamedRobot("husky", "by its topic"), NamedRobot("smb", "by its nodes", is_certain=True)
OLDER, OTHER = MarkingConfig(robot="husky_melodic"), MarkingConfig(robot="husky", scans="/laser")


@pytest.mark.parametrize(
    ("teachers", "named", "heard", "robot", "why"),
    [
        ("smb", GUESS, OLDER, "smb", ""),
        ("auto", GUESS, None, "husky", "by its topic"),
        ("auto", GUESS, OLDER, "husky_melodic", "it subscribes to /scan"),
        ("auto", GUESS, OTHER, "husky", "scans are sent on /laser"),
        ("auto", CERTAIN, OLDER, "smb", "by its nodes"),
    ],
)
def test_the_robot_and_why_it_is_that_one(teachers, named, heard, robot, why):
    chosen = choose_robot(Submission(LAUNCH, robot=named), MarkingConfig(robot=teachers))
    chosen = chosen.after_hearing(heard)
    assert chosen.config.robot == robot
    assert why in chosen.why
    assert bool(chosen.why) == bool(why)


def test_once_it_is_heard_it_is_no_guess_and_further_drives_say_nothing_of_it():
    heard = choose_robot(Submission(LAUNCH, robot=GUESS), MarkingConfig(robot="auto")).after_hearing(OLDER)
    assert heard.after_hearing(OTHER) == heard
    assert (heard.settled().why, heard.settled().config) == ("", OLDER)
