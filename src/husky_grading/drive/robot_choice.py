"""Choice of the robot that is simulated for a submission, by one rule.

A robot that the teacher names is certain. Otherwise the files of the submission name a robot. If the files
leave a doubt, the robot is a guess until the submission subscribes to a topic of scans. That topic decides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional

from husky_grading.records import AUTO, ROBOT_TITLES, MarkingConfig
from husky_grading.submission import Submission


@dataclass(frozen=True)
class RobotChoice:
    """Robot of a run, and the reason for its choice."""

    config: MarkingConfig  # settings of the run; `config.robot` is the chosen robot
    # reason for the choice, in a sentence for the student; empty if the teacher has chosen the robot
    why: str = ""
    # true if the submission's subscription to scans may still change the choice
    is_guess: bool = False

    def after_hearing(self, heard: Optional[MarkingConfig]) -> RobotChoice:
        """Return the choice after the submission has subscribed to scans, which ends a guess.

        `heard` has the settings of a robot that sends these scans. It is None if no robot can send them; the
        choice is then returned unchanged.
        """
        if heard is None or not self.is_guess:
            return self
        if heard.scans:  # no robot uses the submission's topic of scans, so a Husky sends its scans there
            why = f"scans are sent on {heard.scans}, the only topic of scans that it subscribes to"
        else:
            title = ROBOT_TITLES[heard.robot]
            why = f"the simulated robot is the {title}: it subscribes to {heard.scan_topic}"
        return RobotChoice(heard, why)

    def confirmed(self) -> RobotChoice:
        """Return the choice after the submission has subscribed to the scans of the chosen robot.

        A guess was right then, so it becomes certain, and the subscription is named as its reason.
        """
        return self.after_hearing(self.config)

    def settled(self) -> RobotChoice:
        """Return the choice for further runs, whose recordings need not repeat the reason."""
        return RobotChoice(self.config)


def choose_robot(submission: Submission, config: MarkingConfig) -> RobotChoice:
    """Return the robot that the teacher has chosen, otherwise the robot that the submission's files name."""
    if config.robot != AUTO:
        return RobotChoice(config)
    named = submission.robot
    return RobotChoice(replace(config, robot=named.version), named.why, is_guess=not named.is_certain)
