"""URDF reader: checked links, joints, shapes, numbers and poses of a robot description; writer of <origin>.

In: URDF text and its XML elements. Out: values; a `DescriptionError` names the element and its text.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from math import isfinite
from typing import Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import defusedxml
import defusedxml.ElementTree

from husky_highlevel_controller.datatypes import HuskyError, Pose
from husky_highlevel_controller.geometry import compose, inverse, quat_from_rpy, rpy_from_quat

MAX_NUMBER = 1e6  # a URDF with a larger number is refused; the numbers of real robots are far smaller
# for each shape, the names of the attributes with its sizes, separated by a space, and how many numbers each
# attribute has
SIZES = {"box": ("size", 3), "cylinder": ("radius length", 1), "sphere": ("radius", 1), "mesh": ("scale", 3)}

Elements = Dict[str, ET.Element]  # elements by name


class DescriptionError(HuskyError):
    """A robot description that cannot be made or used."""

    def __init__(self, problem: str) -> None:
        super().__init__(f"robot description: {problem}")
        self.problem = problem


def read_urdf(text: str) -> Tuple[ET.Element, Elements, Elements]:
    """Return the root element of a URDF, and its links and joints by name.

    Raises:
        DescriptionError: the text is not a URDF, or a link or joint has no name.
    """
    try:
        robot = defusedxml.ElementTree.fromstring(text)
    except (ET.ParseError, defusedxml.DefusedXmlException, ValueError) as error:
        raise DescriptionError(f"is not valid XML: {error!r}") from None
    if robot.tag != "robot":
        raise DescriptionError(f"the root element is <{robot.tag}>; a URDF starts with <robot>")
    links = {name_of(link): link for link in robot.findall("link")}
    joints = {name_of(joint): joint for joint in robot.findall("joint")}
    return robot, links, joints


def name_of(element: ET.Element) -> str:
    """Return the name of an element; DescriptionError if it has none."""
    name = element.get("name")
    if not name:
        raise DescriptionError(f"a <{element.tag}> has no name")
    return name


def label_of(element: ET.Element) -> str:
    """Return an element's kind and name for an error, such as: joint 'front_left_wheel'."""
    return f"{element.tag} '{name_of(element)}'"


def ends_of(joint: ET.Element, links: Mapping[str, ET.Element]) -> Tuple[str, str]:
    """Return the names of a joint's parent link and child link; DescriptionError if one is not a link."""
    names = []
    for end in ("parent", "child"):
        element = joint.find(end)
        name = "" if element is None else element.get("link", "")
        if name not in links:
            raise DescriptionError(f"{label_of(joint)}: its {end} '{name}' is not a link")
        names.append(name)
    parent, child = names
    return parent, child


def numbers_of(
    element: Optional[ET.Element],
    attribute: str,
    where: str,
    count: int,
    default: Optional[Tuple[float, ...]] = None,
) -> Tuple[float, ...]:
    """Return the numbers of an attribute, or the default if the attribute is not given.

    Args:
        element: element with the attribute; None for a missing element.
        attribute: name of the attribute.
        where: place of the element, for messages.
        count: how many numbers there must be.
        default: numbers of a missing attribute; None if it must be given.

    Raises:
        DescriptionError: the attribute is missing, or is not `count` finite numbers up to MAX_NUMBER.
    """
    text = None if element is None else element.get(attribute)
    if text is None:
        if default is None:
            raise DescriptionError(f"{where}: {attribute} is missing")
        return default
    try:
        numbers = tuple(map(float, text.split()))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(isfinite, numbers)):
        raise DescriptionError(f"{where}: {attribute} is '{text}'; it must be {count} finite number(s)")
    if any(abs(number) > MAX_NUMBER for number in numbers):
        raise DescriptionError(f"{where}: {attribute} is '{text}'; no number may be beyond {MAX_NUMBER:g}")
    return numbers


def number_of(element: Optional[ET.Element], attribute: str, where: str) -> float:
    """Return the one number of an attribute; DescriptionError if it is missing, not finite or too large."""
    return numbers_of(element, attribute, where, 1)[0]


def shape_of(element: ET.Element, where: str) -> Optional[Tuple[ET.Element, Tuple[float, ...]]]:
    """Return the shape of a <collision> or <visual>, and its sizes; None if it has no shape of SIZES.

    The sizes are the edges of a box [m], radius and length of a cylinder [m], the radius of a sphere [m], or
    the three factors by which a mesh is scaled.
    """
    shape = element.find("geometry/*")
    if shape is None or shape.tag not in SIZES:
        return None
    names, count = SIZES[shape.tag]
    default = (1.0, 1.0, 1.0) if shape.tag == "mesh" else None
    sizes = [numbers_of(shape, name, where, count, default) for name in names.split()]
    return shape, sum(sizes, ())  # the tuples of all attributes become one


def origin_of(element: ET.Element, where: str) -> Pose:
    """Return the pose of an element in its parent, from <origin>; identity if there is no <origin>."""
    origin = element.find("origin")
    x, y, z = numbers_of(origin, "xyz", where, 3, (0.0, 0.0, 0.0))
    roll, pitch, yaw = numbers_of(origin, "rpy", where, 3, (0.0, 0.0, 0.0))
    return Pose((x, y, z), quat_from_rpy(roll, pitch, yaw))


def joined_links(
    links: Mapping[str, ET.Element], joints: Iterable[ET.Element]
) -> Tuple[Tuple[str, str, Pose], ...]:
    """Return parent, child and the pose of the child in the parent for each joint, at position 0."""
    joined = []
    for joint in joints:
        parent, child = ends_of(joint, links)
        joined.append((parent, child, origin_of(joint, label_of(joint))))
    return tuple(joined)


def poses_of_links(root: str, joined: Iterable[Tuple[str, str, Pose]]) -> Dict[str, Pose]:
    """Return the poses of all links that joints connect with the link `root`, in the frame of `root`.

    The other links may be below or above `root`. `joined` is a result of `joined_links`.
    """
    # for each link, its neighbours (the links that a joint connects with it), and their poses in the link
    neighbours: Dict[str, List[Tuple[str, Pose]]] = defaultdict(list)
    for parent, child, pose_child_in_parent in joined:
        neighbours[parent].append((child, pose_child_in_parent))
        neighbours[child].append((parent, inverse(pose_child_in_parent)))
    poses = {root: Pose()}
    queue = [root]
    for link in queue:  # the loop also visits the links that it appends
        for neighbour, pose_in_link in neighbours[link]:
            if neighbour not in poses:
                poses[neighbour] = compose(poses[link], pose_in_link)
                queue.append(neighbour)
    return poses


def write_origin(element: ET.Element, pose: Pose) -> None:
    """Add an <origin> with a pose to an element."""
    ET.SubElement(element, "origin", xyz=text_of(pose.position), rpy=text_of(rpy_from_quat(pose.quat_xyzw)))


def text_of(numbers: Sequence[float]) -> str:
    """Return numbers as the text of an attribute, with all digits."""
    # `+ 0.0` turns -0.0 into 0.0
    return " ".join(repr(float(number) + 0.0) for number in numbers)
