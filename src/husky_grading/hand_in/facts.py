"""Settings and functions with which an exercise reads a submission, such as the packages that are graded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Mapping

from husky_grading.hand_in.package_files import named_robot
from husky_grading.isolation.own_files import VisibleCode
from husky_grading.submission import NO_ROBOT_PACKAGES, NamedRobot, Plan, RobotPackages


def no_facts(_: Plan) -> Mapping[str, Any]:
    """Return no facts."""
    return {}


@dataclass(frozen=True)
class Facts:
    """Settings and functions of an exercise; the defaults fit an exercise in which students write a node."""

    # packages of ROS whose nodes the exercise uses, such as the filter in exercise 4
    robot_packages: RobotPackages = NO_ROBOT_PACKAGES
    # description of the node that a launch file must start, for an error message
    node: str = "a node of the submission"
    # true if launch files are compared first by their content, such as the world that they name, and only
    # then by the number of the exercise in their path
    by_content: bool = False
    # files of the package husky_highlevel_controller that nodes of the submission may use
    visible_code: VisibleCode = VisibleCode.NOTHING
    # function that returns the robot that the submission's files name
    find_robot: Callable[[Plan], NamedRobot] = named_robot
    # function that reads values for the rubric from the submission's files, such as the bags that its launch
    # file plays, and returns them by name
    read_facts: Callable[[Plan], Mapping[str, Any]] = no_facts
