"""URDF of an object that is spawned: its collision shapes, with every joint at zero, as one rigid body.

In: URDF text, a name, a pose. Out: a `Body`.
"""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ET
from typing import Dict, List, Optional, Tuple

from husky_highlevel_controller.datatypes import Body, Box, Cylinder, Geometry, Pose, Shape, Sphere
from husky_highlevel_controller.geometry import compose
from husky_highlevel_controller.urdf import (
    DescriptionError,
    Elements,
    ends_of,
    label_of,
    number_of,
    origin_of,
    read_urdf,
    shape_of,
)  # fmt: skip

log = logging.getLogger(__name__)


def is_urdf(text: str) -> bool:
    """Whether the text of a model has a URDF's root element; its XML is checked by its reader."""
    return "<robot" in text and "<sdf" not in text


def parse_urdf_object(text: str, name: str, pose_in_world: Pose) -> Body:
    """A body called `name` of the text of a URDF; it never moves without mass, or where <gazebo> says static.

    Raises:
        DescriptionError: the text is broken, or nothing in it has a collision shape.
    """
    robot, links, joints = read_urdf(text)
    geometries: List[Geometry] = []
    mass = 0.0
    for link_name, pose in _poses(links, joints).items():
        link = links[link_name]
        for collision in link.findall("collision"):
            shape = _shape(collision, label_of(link))
            if shape is not None:
                geometries.append(Geometry(shape, compose(pose, origin_of(collision, label_of(link)))))
        element = link.find("inertial/mass")
        mass += 0.0 if element is None else number_of(element, "value", label_of(link))
    if not geometries:
        raise DescriptionError(f"nothing in '{name}' has a <collision> of a box, cylinder or sphere")
    static = any((item.text or "").strip() in ("true", "1") for item in robot.iterfind("gazebo/static"))
    shapes = tuple(geometries)
    return Body(name, pose_in_world, shapes, shapes, 0.0 if static else mass)


def _poses(links: Elements, joints: Elements) -> Dict[str, Pose]:
    """Poses of all links in the one that is no joint's child."""
    children: Dict[str, List[Tuple[str, ET.Element]]] = {name: [] for name in links}
    for joint in joints.values():
        parent, child = ends_of(joint, links)
        children[parent].append((child, joint))
    roots = set(links) - {child for joined in children.values() for child, _ in joined}
    if len(roots) != 1:
        names = ", ".join(sorted(roots)) or "none"
        raise DescriptionError(f"one link must be no joint's child; here it is: {names}")
    poses = {name: Pose() for name in roots}
    queue = list(roots)
    for name in queue:
        for child, joint in children[name]:
            if child in poses:
                raise DescriptionError(f"link '{child}' is the child of two joints")
            poses[child] = compose(poses[name], origin_of(joint, label_of(joint)))
            queue.append(child)
    return poses


def _shape(collision: ET.Element, where: str) -> Optional[Shape]:
    shape_and_sizes = shape_of(collision, where)
    tag, sizes = (shape_and_sizes[0].tag, shape_and_sizes[1]) if shape_and_sizes else ("", ())
    if tag == "box":
        x, y, z = sizes
        return Box((x, y, z))
    if tag in ("cylinder", "sphere"):
        return Cylinder(*sizes) if tag == "cylinder" else Sphere(*sizes)
    log.warning("%s: only a <collision> of a box, cylinder or sphere is simulated", where)
    return None
