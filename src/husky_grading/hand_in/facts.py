"""Facts of a submission that an exercise needs, such as the robot and the nodes that are the student's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Mapping

from husky_grading.hand_in.package_files import named_robot
from husky_grading.isolation.own_files import VisibleCode
from husky_grading.submission import STUDENTS_OWN, NamedRobot, Parts, Plan


def no_facts(_: Plan) -> Mapping[str, Any]:
    """Return no facts."""
    return {}


@dataclass(frozen=True)
class Facts:
    """Facts that an exercise needs; the defaults fit a node that the student wrote."""

    # packages of the robot whose nodes count as the student's, such as the filter in exercise 4
    parts: Parts = STUDENTS_OWN
    # description of the node that a launch file must start, for an error message
    node: str = "a node of the submission"
    # true if launch files are compared first by their content, and only then by the number in their path
    by_content: bool = False
    # files of the package husky_highlevel_controller that nodes of the submission may use
    visible_code: VisibleCode = VisibleCode.NOTHING
    # function that returns the robot for which the submission was written, by the submission's files
    find_robot: Callable[[Plan], NamedRobot] = named_robot
    # function that reads facts from the submission's files and returns them by name; the exercise needs these
    # facts to give points
    read_facts: Callable[[Plan], Mapping[str, Any]] = no_facts
