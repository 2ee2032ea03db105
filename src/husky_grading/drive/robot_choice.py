"""Choice of the robot that is simulated for a submission, by one rule.

A robot that the teacher names is certain. Otherwise the submission's files name it. Unless that is certain,
it is a guess, and what the submission subscribes to decides, as soon as that is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional

from husky_grading.drive.ros_graph import listens_to
from husky_grading.records import AUTO, MarkingConfig
from husky_grading.submission import Submission


@dataclass(frozen=True)
class RobotChoice:
    """Robot of a drive, and how it came about."""

    config: MarkingConfig  # with the robot
    why: str = ""  # a sentence for the student; empty: the teacher has named it
    is_guess: bool = False

    def after_hearing(self, listened: Optional[MarkingConfig]) -> RobotChoice:
        """Return the choice by the settings of the robot that it listens to; None: that is not seen."""
        if listened is None or not self.is_guess:
            return self
        return RobotChoice(listened, listens_to(listened))

    def settled(self) -> RobotChoice:
        """Return the choice for further drives: the first one has told what there was to tell."""
        return RobotChoice(self.config)


def choose_robot(submission: Submission, config: MarkingConfig) -> RobotChoice:
    """Choose the robot before anything is started."""
    if config.robot != AUTO:
        return RobotChoice(config)
    named = submission.robot
    return RobotChoice(replace(config, robot=named.version), named.why, not named.is_certain)
