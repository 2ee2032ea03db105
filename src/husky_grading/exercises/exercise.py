"""Exercise as marking sees it: items and judge, settings of its drives, and three hooks.

`facts` says what of the hand-in an exercise needs, `bring_up` starts what a drive takes place in, and `watch`
follows the drive. The defaults are those of a node that drives the simulated robot by its scans.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, List, Sequence, Tuple

from husky_grading.displays import RvizView
from husky_grading.drive.bring_up import BringUp, simulate
from husky_grading.exercises.watch import RosAccess, Watch
from husky_grading.hand_in.facts import Facts
from husky_grading.recording import Recording
from husky_grading.records import Item, Rules

# of drives, what RViz showed, topic of the scans, rules
Judge = Callable[[Sequence[Recording], RvizView, str, Rules], List[Item]]


@dataclass(frozen=True)
class Exercise:
    """Exercise of the course."""

    items: Tuple[str, ...]  # names, for a rubric file
    judge: Judge
    pace: float  # simulated seconds a second
    deadline: float  # [s], simulated, of a drive
    random_starts: bool = False  # several drives, each from another place
    facts: Facts = field(default_factory=Facts)
    bring_up: BringUp = simulate
    watch: Callable[[Recording, RosAccess], Watch] = Watch

    def drives(self, trials: int) -> int:
        """Return the number of drives, if a teacher asks for so many trials."""
        return trials if self.random_starts else 1
