"""The exercises as data: items, judge, drives, pace, and the driver that takes part.

A further exercise is an entry here and a module of `rubrics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Dict, List, Sequence, Tuple

from husky_grading.displays import RvizView
from husky_grading.drive.call_plan import BAG, FORWARD, SERVICE
from husky_grading.recording import Recording
from husky_grading.records import Item, Rules
from husky_grading.rubrics import exercise_2, exercise_3, exercise_4, exercise_5

# of drives, what RViz showed, topic of the scans, rules
Judge = Callable[[Sequence[Recording], RvizView, str, Rules], List[Item]]


@dataclass(frozen=True)
class Exercise:
    """Exercise of the course."""

    items: Tuple[str, ...]  # names, for a rubric file
    judge: Judge
    pace: float  # simulated seconds a second
    deadline: float  # [s], simulated, of a drive
    driver: str = ""  # that takes part: see `drive.call_plan`
    random_starts: bool = False  # several drives, each from another place; such a drive ends at the pillar


EXERCISES: Dict[int, Exercise] = {
    2: Exercise(exercise_2.ITEMS, exercise_2.judge_exercise_2, 1.0, 60.0, driver=FORWARD),
    3: Exercise(exercise_3.ITEMS, exercise_3.judge_exercise_3, 5.0, 120.0, random_starts=True),
    4: Exercise(exercise_4.ITEMS, exercise_4.judge_exercise_4, 5.0, 90.0, driver=BAG),
    5: Exercise(exercise_5.ITEMS, exercise_5.judge_exercise_5, 2.0, 60.0, driver=SERVICE),
}
