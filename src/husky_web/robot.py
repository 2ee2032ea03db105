"""The robot's appearance from its URDF: rigid groups of visuals, each of which moves with one TF frame.

In: the text of robot_description. Out: records.
"""

from __future__ import annotations

from typing import Dict, List, NamedTuple, Optional, Tuple, Union
from xml.etree.ElementTree import Element

from husky_highlevel_controller.datatypes import IDENTITY, Pose, Rgba
from husky_highlevel_controller.geometry import compose
from husky_highlevel_controller.urdf import (
    Elements,
    ends_of,
    label_of,
    numbers_of,
    origin_of,
    read_urdf,
    shape_of,
)
from husky_web import shapes
from husky_web.shapes import PLAIN, MeshFile, Solid


class Visual(NamedTuple):
    """Shape of the robot."""

    shape: Union[Solid, MeshFile]
    pose_in_frame: Pose


def rigid_groups(description: str) -> Tuple[str, Dict[str, List[Visual]]]:
    """Return the name of a robot, and its visuals by the frame that moves them.

    The frame is the root link, or a link behind a joint that is not fixed.

    Raises:
        DescriptionError: the description is not a URDF, or an element cannot be read.
    """
    robot, links, joints = read_urdf(description)
    colors = {item.get("name", ""): _rgba(item) for item in robot.findall("material")}
    # joint between a link and its parent link; the key is the name of the link
    joint_above: Dict[str, Element] = {}
    for joint in joints.values():
        _, child = ends_of(joint, links)
        joint_above[child] = joint
    groups: Dict[str, List[Visual]] = {}
    for name, link in links.items():
        frame, pose = _fixed_to(name, links, joint_above)
        for visual in link.findall("visual"):
            shape = _shape(visual, colors, label_of(link))
            if shape is not None:
                pose_in_frame = compose(pose, origin_of(visual, label_of(link)))
                groups.setdefault(frame, []).append(Visual(shape, pose_in_frame))
    return robot.get("name", ""), groups


def _fixed_to(link: str, links: Elements, joint_above: Elements) -> Tuple[str, Pose]:
    """Return the frame with which a link moves, and the pose of the link in this frame.

    The frame is the first link on the way from this link up to the root that has no fixed joint to its parent
    link. `joint_above` has the joint between each link and its parent link.
    """
    pose = IDENTITY
    # the loop has at most one round for each joint of the robot, so it also ends if the joints form a circle
    for _ in joint_above:
        joint = joint_above.get(link)
        if joint is None or joint.get("type") != "fixed":
            break
        pose = compose(origin_of(joint, label_of(joint)), pose)
        link, _ = ends_of(joint, links)
    return link, pose


def _shape(
    visual: Element, colors: Dict[str, Optional[Rgba]], where: str
) -> Optional[Union[Solid, MeshFile]]:
    """Return the shape of a <visual>; None if it has no geometry.

    Args:
        visual: element of the URDF.
        colors: colours of the robot's named materials.
        where: name of the link for an error.

    Raises:
        DescriptionError: the element cannot be read.
    """
    shape_and_sizes, rgba = shape_of(visual, where), _material(visual, colors)
    if shape_and_sizes is None:
        return None
    shape, sizes = shape_and_sizes  # `sizes` are in metres; for a mesh they are factors along x, y and z
    if shape.tag == "mesh":
        x, y, z = sizes
        return MeshFile(shape.get("filename", ""), (x, y, z), rgba)
    if shape.tag == "box":
        x, y, z = sizes
        return Solid(shapes.cube(), rgba or PLAIN, (x, y, z))
    diameter = 2.0 * sizes[0]  # a URDF gives the radius of a cylinder and of a sphere
    if shape.tag == "cylinder":
        length = sizes[1]
        return Solid(shapes.cylinder(), rgba or PLAIN, (diameter, diameter, length))
    return Solid(shapes.sphere(), rgba or PLAIN, (diameter, diameter, diameter))


def _material(visual: Element, colors: Dict[str, Optional[Rgba]]) -> Optional[Rgba]:
    """Return the colour of a visual, by its own <material> or by a named one; None without a colour."""
    material = visual.find("material")
    if material is None:
        return None
    return _rgba(material) or colors.get(material.get("name", ""))


def _rgba(material: Element) -> Optional[Rgba]:
    """Return the colour of a <material>, or None."""
    color = material.find("color")
    if color is None:
        return None
    r, g, b, a = numbers_of(color, "rgba", "a <material>", 4)
    return (r, g, b, a)
