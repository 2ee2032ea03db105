"""What a rubric gives: items with points and evidence, and what RViz showed.

In: points of single drives. Out: `Item`s and totals. Must not know: ROS, files, what an exercise asks for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from husky_highlevel_controller.grading.drive.recording import Recording


@dataclass(frozen=True)
class Item:
    """One line of the table."""

    name: str
    points: Optional[float]  # None: a machine cannot judge it
    max_points: float
    evidence: str
    at: Optional[float] = None  # [s], simulated: the moment the evidence is about

    @property
    def full(self) -> bool:
        """All points there are, or nothing a machine could give."""
        return self.points is None or self.points >= self.max_points - 1e-9


@dataclass(frozen=True)
class RvizView:
    """What the submission's RViz showed."""

    source: str = ""  # where its configuration comes from; empty: there is none
    topics: Tuple[str, ...] = ()  # it subscribes to
    tf: bool = False  # frames are to be seen
    robot: bool = False  # the robot model is to be seen
    scan: bool = False  # the laser's points are to be seen
    problem: str = ""  # why there was nothing to look at
    judged: bool = True  # False: RViz is not on this machine, or crashes on it
    fixed_frame: str = ""


def over_trials(recordings: Sequence[Recording], judge: Callable[[Recording], Item]) -> Item:
    """The mean of all drives, with the evidence of the worst."""
    items = [judge(recording) for recording in recordings]
    number = min(range(len(items)), key=lambda n: items[n].points or 0.0)
    worst = items[number]
    if len(items) == 1:
        return worst
    points = round(float(np.mean([item.points or 0.0 for item in items])), 1)
    full = sum(item.full for item in items)
    words = f"full marks in {full} of {len(items)} drives; drive {number + 1}: {worst.evidence}"
    return replace(worst, points=points, evidence=words)


def forfeited(items: Sequence[Item], recordings: Sequence[Recording]) -> List[Item]:
    """Without points where a submission interfered with the simulator or the recording."""
    violations = list(dict.fromkeys(words for recording in recordings for words in recording.violations))
    if not violations:
        return list(items)
    words = f"no points: {'; '.join(violations)}"
    return [item if item.points is None else replace(item, points=0.0, evidence=words) for item in items]


def total(items: Sequence[Item]) -> Tuple[float, float]:
    """Points, and how many a machine can give."""
    judged = [item for item in items if item.points is not None]
    return round(sum(item.points or 0.0 for item in judged), 1), sum(item.max_points for item in judged)
