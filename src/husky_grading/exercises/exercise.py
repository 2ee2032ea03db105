"""Exercise of the course, as marking needs it: its items, its judge, and the parts of its runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, List, Sequence, Tuple

from husky_grading.displays import RvizView
from husky_grading.drive.bring_up import BringUp, simulate
from husky_grading.exercises.watch import RosAccess, Watch
from husky_grading.hand_in.facts import Facts
from husky_grading.recording import Recording
from husky_grading.records import Item, Rules

# function that gives points; arguments: recordings, RViz view, topic of the scans, rules
Judge = Callable[[Sequence[Recording], RvizView, str, Rules], List[Item]]


@dataclass(frozen=True)
class Exercise:
    """Exercise of the course; the defaults fit a node that drives the simulated robot by its scans."""

    items: Tuple[str, ...]  # names of the graded items; rubric files use the same names
    judge: Judge
    pace: float  # maximum real-time factor
    deadline: float  # [s] longest simulated time of a run
    random_starts: bool = False  # true if there are several runs, each from another start pose
    facts: Facts = field(default_factory=Facts)  # rules by which a submission is prepared
    bring_up: BringUp = simulate  # function that starts the simulator, or the player of a bag instead
    # function that returns the watch of a run; arguments: recording before the run, access to ROS
    watch: Callable[[Recording, RosAccess], Watch] = Watch

    def number_of_runs(self, trials: int) -> int:
        """Return the number of runs, if a teacher asks for this number of trials."""
        return trials if self.random_starts else 1
