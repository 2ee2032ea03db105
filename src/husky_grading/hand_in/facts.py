"""Facts that an exercise needs of a hand-in: which nodes are the student's, for which robot they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Mapping

from husky_grading.hand_in.package_files import named_robot
from husky_grading.isolation.own_files import Own
from husky_grading.submission import STUDENTS_OWN, NamedRobot, Parts, Plan


def no_facts(_: Plan) -> Mapping[str, Any]:
    """Return no facts."""
    return {}


@dataclass(frozen=True)
class Facts:
    """Facts that an exercise needs; by default those of a node that the student wrote."""

    parts: Parts = STUDENTS_OWN  # nodes that count as the student's, though their packages are the robot's
    node: str = "a node of the hand-in"  # that a launch file has to start, in a sentence
    by_content: bool = False  # a launch file is known by what it starts rather than by the number in its name
    own: Own = Own.NOTHING  # use that its nodes make of the grading package
    robot: Callable[[Plan], NamedRobot] = named_robot
    read: Callable[[Plan], Mapping[str, Any]] = no_facts  # what the judge needs of its files, by name
