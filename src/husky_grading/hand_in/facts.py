"""Facts of a submission that an exercise needs, such as the robot and the nodes that are the student's."""

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
    """Facts that an exercise needs; the defaults fit a node that the student wrote."""

    parts: Parts = STUDENTS_OWN  # packages of the robot whose nodes count as the student's
    node: str = "a node of the submission"  # words for the node that a launch file must start
    by_content: bool = False  # true if the content of a launch file counts more than the number in its name
    own: Own = Own.NOTHING  # files of this package that nodes of the submission may use
    robot: Callable[[Plan], NamedRobot] = named_robot
    # function that reads facts for the judge from the files; it returns them by name
    read: Callable[[Plan], Mapping[str, Any]] = no_facts
