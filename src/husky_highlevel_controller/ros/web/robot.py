"""The robot to look at, from its URDF: rigid groups of visuals, each moving with one TF frame.

In: the text of robot_description. Out: records.
"""

from __future__ import annotations

from typing import Dict, List, NamedTuple, Optional, Tuple, Union
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from husky_highlevel_controller.datatypes import IDENTITY, HuskyError, Pose, Rgba
from husky_highlevel_controller.geometry import compose, quat_from_rpy
from husky_highlevel_controller.ros.web import shapes
from husky_highlevel_controller.ros.web.markers import MeshFile, Solid

PLAIN: Rgba = (0.7, 0.7, 0.7, 1.0)  # of a visual without a material


class Visual(NamedTuple):
    """Shape of the robot."""

    shape: Union[Solid, MeshFile]
    pose_in_frame: Pose


def rigid_groups(description: str) -> Dict[str, List[Visual]]:
    """Visuals by the frame that they are fixed to: the root link, or a link behind a joint that moves.

    Raises:
        HuskyError: the text is no URDF.
    """
    try:
        robot = fromstring(description)
    except (ParseError, DefusedXmlException, ValueError) as error:
        raise HuskyError(f"robot_description is not a URDF: {error}") from None
    colors = {item.get("name", ""): _rgba(item) for item in robot.findall("material")}
    joints = {_name(joint, "child"): joint for joint in robot.findall("joint")}
    groups: Dict[str, List[Visual]] = {}
    for link in robot.findall("link"):
        frame, pose = _fixed_to(link.get("name", ""), joints)
        for visual in link.findall("visual"):
            shape = _shape(visual, colors)
            if shape is not None:
                groups.setdefault(frame, []).append(Visual(shape, compose(pose, _origin(visual))))
    return groups


def _fixed_to(link: str, joints: Dict[str, Element]) -> Tuple[str, Pose]:
    pose = IDENTITY
    for _ in range(len(joints)):
        joint = joints.get(link)
        if joint is None or joint.get("type") != "fixed":
            break
        pose = compose(_origin(joint), pose)
        link = _name(joint, "parent")
    return link, pose


def _name(joint: Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _origin(element: Element) -> Pose:
    origin = element.find("origin")
    if origin is None:
        return IDENTITY
    x, y, z = _numbers(origin.get("xyz", "0 0 0"), 3)
    roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"), 3)
    return Pose((x, y, z), quat_from_rpy(roll, pitch, yaw))


def _shape(visual: Element, colors: Dict[str, Optional[Rgba]]) -> Optional[Union[Solid, MeshFile]]:
    rgba = _material(visual, colors)
    for shape in visual.iterfind("geometry/*"):
        if shape.tag == "mesh":
            x, y, z = _numbers(shape.get("scale", "1 1 1"), 3)
            return MeshFile(shape.get("filename", ""), (x, y, z), rgba)
        if shape.tag == "box":
            return Solid(shapes.scaled(shapes.cube(), _numbers(shape.get("size", ""), 3)), rgba or PLAIN)
        (radius,) = _numbers(shape.get("radius", ""), 1)
        if shape.tag == "cylinder":
            (length,) = _numbers(shape.get("length", ""), 1)
            size = (2.0 * radius, 2.0 * radius, length)
            return Solid(shapes.scaled(shapes.cylinder(), size), rgba or PLAIN)
        if shape.tag == "sphere":
            return Solid(shapes.scaled(shapes.sphere(), [2.0 * radius] * 3), rgba or PLAIN)
    return None


def _material(visual: Element, colors: Dict[str, Optional[Rgba]]) -> Optional[Rgba]:
    material = visual.find("material")
    if material is None:
        return None
    return _rgba(material) or colors.get(material.get("name", ""))


def _rgba(material: Element) -> Optional[Rgba]:
    color = material.find("color")
    if color is None:
        return None
    r, g, b, a = _numbers(color.get("rgba", ""), 4)
    return (r, g, b, a)


def _numbers(text: str, count: int) -> Tuple[float, ...]:
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != count:
        raise HuskyError(f"robot_description: '{text}' is not {count} numbers")
    return values
