"""`compare` with launch files as contestants: the grader starts them and its recorder watches them.

In: the command line of `compare`. Out: the output of `compare`.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Optional, Sequence

from husky_evaluation import compare
from husky_evaluation.contestant import Outcome, outcome
from husky_evaluation.metrics import DRIVE_SECONDS
from husky_evaluation.scenarios import Scenario
from husky_grading.drive.bring_up import simulate
from husky_grading.drive.robot_choice import RobotChoice
from husky_grading.drive.run import drive_submission
from husky_grading.drive.trials import Trial
from husky_grading.hand_in.plan import plan
from husky_grading.isolation.process import stop_on_signals
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import texts
from husky_grading.recording import RECORDING, Recording
from husky_grading.records import Launchable, MarkingConfig
from husky_grading.submission import Submission
from husky_highlevel_controller.config import load
from husky_highlevel_controller.course import PILLAR_POSITION
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.robot import load_robot

PACE = 5.0  # a run is at most this many times as fast as real time


@dataclass(frozen=True)
class LaunchContestant:
    """Launch file of a controller, which drives in a ROS network of its own."""

    name: str
    launch: Launchable

    @property
    def starts_programs(self) -> bool:
        """Return True, because a launch file starts nodes whose code is not known here."""
        return True

    def drive(self, scenario: Scenario) -> Outcome:
        """Drive a scenario with the course's pillar.

        Raises:
            HuskyError: the launch file starts no node, or ROS fails.
        """
        _check_starts_a_node(self.name, self.launch)
        trial = Trial(number=1, start=scenario.start, pillar=PILLAR_POSITION, seed=scenario.seed)
        config = MarkingConfig(robot="husky", deadline=DRIVE_SECONDS, pace=PACE)
        # the run happens in a ROS network of its own, and its recorder writes the file RECORDING
        with tempfile.TemporaryDirectory(prefix="husky_compare_") as folder:
            drive_submission(
                Submission(self.launch),
                trial,
                robot=RobotChoice(config),
                bring_up=simulate,
                folder=Path(folder),
            )
            recording: Recording = load(Recording, Path(folder, RECORDING))
        if not len(recording.times):  # simulated time has never begun
            why = "; ".join(texts(recording.notes)) or "its node sent and received nothing"
            raise HuskyError(f"{self.name} did not drive in {scenario.name}: {why}")
        judged = outcome(scenario.name, recording.times, recording.poses, trial.pillar, load_robot())
        return replace(judged, notes=tuple(texts(recording.notes)))


@lru_cache(maxsize=4)
def _check_starts_a_node(name: str, launch: Launchable) -> None:
    """Raise a HuskyError if a launch file starts no node; the cache saves reading a file again."""
    with tempfile.TemporaryDirectory(prefix="husky_compare_") as folder:
        # an empty `Workspace`, because the launch file is in a workspace that is sourced already
        planned = plan(launch, Workspace(), Path(folder))
    if not planned.nodes:
        raise HuskyError(f"{name}: {'; '.join(texts(planned.notes)) or 'it starts no node'}")


def launch_contestant(text: str, package: str, file: str, arguments: Sequence[str]) -> LaunchContestant:
    """Return the contestant of PACKAGE/FILE.launch with arguments name:=value."""
    return LaunchContestant(text, Launchable("launch", package, file, tuple(arguments)))


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Run the command."""
    compare.main(arguments, launch_contestant, stop_on_signals)
