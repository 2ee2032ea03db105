"""URDF elements: checked values read from them, and how they are written.

In: XML elements. Out: numbers and poses; a `DescriptionError` names the element and what it says.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from math import atan2, hypot, isfinite
from typing import Mapping, Optional, Sequence, Tuple

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.geometry import matrix_from_quat, quat_from_rpy
from husky_highlevel_controller.simulator.models.description import DescriptionError

MAX_NUMBER = 1e6  # in metres, kilograms or their products: a robot's are far smaller, and physics needs room


def name_of(element: ET.Element) -> str:
    """An element's name, which must be given."""
    name = element.get("name")
    if not name:
        raise DescriptionError(f"a <{element.tag}> has no name")
    return name


def label_of(element: ET.Element) -> str:
    """An element as an error calls it: joint 'front_left_wheel'."""
    return f"{element.tag} '{name_of(element)}'"


def ends_of(joint: ET.Element, links: Mapping[str, ET.Element]) -> Tuple[str, str]:
    """Names of a joint's parent and child."""
    names = []
    for end in ("parent", "child"):
        element = joint.find(end)
        names.append("" if element is None else element.get("link", ""))
        if names[-1] not in links:
            raise DescriptionError(f"{label_of(joint)}: its {end} '{names[-1]}' is not a link")
    parent, child = names
    return parent, child


def numbers_of(
    element: Optional[ET.Element], attribute: str, default: Tuple[float, ...], where: str
) -> Tuple[float, ...]:
    """An attribute's numbers up to MAX_NUMBER, as many as the default has; that where it is not given."""
    text = None if element is None else element.get(attribute)
    if text is None:
        return default
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) != len(default) or not all(map(isfinite, numbers)):
        raise DescriptionError(
            f"{where}: {attribute} is '{text}'; it must be {len(default)} finite number(s)"
        )
    if any(abs(number) > MAX_NUMBER for number in numbers):
        raise DescriptionError(f"{where}: {attribute} is '{text}'; no number may be beyond {MAX_NUMBER:g}")
    return numbers


def number_of(element: Optional[ET.Element], attribute: str, where: str) -> float:
    """An attribute's one finite number, which must be given."""
    if element is None or attribute not in element.attrib:
        raise DescriptionError(f"{where}: {attribute} is missing")
    return numbers_of(element, attribute, (0.0,), where)[0]


def origin_of(element: ET.Element, where: str) -> Pose:
    """Pose from <origin>, in the parent [m]; identity without one."""
    origin = element.find("origin")
    x, y, z = numbers_of(origin, "xyz", (0.0, 0.0, 0.0), where)
    roll, pitch, yaw = numbers_of(origin, "rpy", (0.0, 0.0, 0.0), where)
    return Pose((x, y, z), quat_from_rpy(roll, pitch, yaw))


def write_origin(element: ET.Element, pose: Pose) -> None:
    """Add an <origin>."""
    m = matrix_from_quat(pose.quat_xyzw)
    level = hypot(m[0, 0], m[1, 0])
    if level > 1e-9:
        roll, yaw = atan2(m[2, 1], m[2, 2]), atan2(m[1, 0], m[0, 0])
    else:  # straight up or down, roll and yaw turn about the same axis
        roll, yaw = atan2(-m[1, 2], m[1, 1]), 0.0
    rpy = (roll, atan2(-m[2, 0], level), yaw)
    ET.SubElement(element, "origin", xyz=text_of(pose.position), rpy=text_of(rpy))


def text_of(numbers: Sequence[float]) -> str:
    """Numbers as an attribute, to the last digit."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)  # + 0.0 makes -0.0 plain
