"""URDF of an object that is spawned: its collision shapes, with every joint at zero, as one rigid body.

In: URDF text, a name, a pose. Out: a `Body`.
"""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ET
from typing import List, Optional

from husky_highlevel_controller import urdf
from husky_highlevel_controller.datatypes import Body, Box, Cylinder, Geometry, Pose, Shape, Sphere
from husky_highlevel_controller.geometry import compose
from husky_highlevel_controller.meshes import scaled_mesh
from husky_highlevel_controller.simulator.models.mesh_file import MeshError, MeshFiles
from husky_highlevel_controller.urdf import DescriptionError

log = logging.getLogger(__name__)


def is_urdf(text: str) -> bool:
    """Return whether the text of a model is URDF and not SDF, judged by its root element.

    The XML is not checked here.
    """
    return "<robot" in text and "<sdf" not in text


def parse_urdf_object(text: str, name: str, pose_in_world: Pose) -> Body:
    """Return a URDF as one rigid body.

    The body is static if the URDF has no mass, if it has <gazebo><static>, or if its root link is `world`.

    Args:
        text: the URDF; its joints do not move.
        name: name of the body.
        pose_in_world: pose of its root link.

    Raises:
        DescriptionError: the text is not a URDF, or has several root links or no usable collision shape.
    """
    robot, links, joints = urdf.read_urdf(text)
    # parent, child, and pose of the child in the parent, for each joint
    joined = urdf.joined_links(links, joints.values())
    roots = set(links) - {child for _, child, _ in joined}
    if len(roots) != 1:
        names = ", ".join(sorted(roots)) or "none"
        raise DescriptionError(
            f"exactly one link must be the root, which is not the child of a joint; here it is: {names}"
        )
    geometries: List[Geometry] = []
    files = MeshFiles()
    mass = 0.0
    # the frame of the body is the frame of the root link
    (root,) = roots
    for link_name, pose_link_in_body in urdf.poses_of_links(root, joined).items():
        link, where = links[link_name], urdf.label_of(links[link_name])
        for collision in link.findall("collision"):
            shape = _shape(collision, where, files)
            if shape is not None:
                pose_in_body = compose(pose_link_in_body, urdf.origin_of(collision, where))
                geometries.append(Geometry(shape, pose_in_body))
        mass += _mass(link, where)
    if not geometries:
        raise DescriptionError(f"nothing in '{name}' has a <collision> of a box, cylinder, sphere or mesh")
    # in Gazebo, a link with the name `world` is the world, so everything that is joined to it cannot move
    is_static = root == "world"
    for element in robot.iterfind("gazebo/static"):
        if (element.text or "").strip() in ("true", "1"):
            is_static = True
    shapes = tuple(geometries)
    # the collision shapes are also drawn; a mass of 0 makes the body static
    return Body(name, pose_in_world, collisions=shapes, visuals=shapes, mass=0.0 if is_static else mass)


def _mass(link: ET.Element, where: str) -> float:
    """Return the mass of a link [kg]; 0 if there is no <mass>; 1 kg, with a warning, if it is not valid.

    1 kg is the default of SDF.
    """
    element = link.find("inertial/mass")
    if element is None:
        return 0.0
    try:
        mass = urdf.number_of(element, "value", where)
        if mass < 0.0:
            raise DescriptionError(f"{where}: value is '{mass:g}'; it cannot be negative")
        return mass
    except DescriptionError as error:
        log.warning("a mass that cannot be used is read as 1 kg: %s", error)
        return 1.0


def _shape(collision: ET.Element, where: str, files: MeshFiles) -> Optional[Shape]:
    """Return the shape of a <collision>, or None, with a warning, if it cannot be used.

    Args:
        collision: the element.
        where: place of the element, for messages.
        files: reads mesh files, each once.
    """
    shape_and_sizes = urdf.shape_of(collision, where)
    if shape_and_sizes is None:
        log.warning("%s: a <collision> that is not a box, cylinder, sphere or mesh is left out", where)
        return None
    element, sizes = shape_and_sizes
    if element.tag == "cylinder":
        return Cylinder(*sizes)
    if element.tag == "sphere":
        return Sphere(*sizes)
    x, y, z = sizes
    if element.tag == "box":
        return Box((x, y, z))
    # the shape is a mesh, and x, y and z are its scale
    uri = element.get("filename", "")
    try:
        # `source` would be the file that contains the URI; the URDF of an object does not come from a file
        return scaled_mesh(files.read(uri, source=""), (x, y, z))
    except MeshError as error:
        log.warning("%s: a mesh %s, and is left out: '%s'", where, error, uri)
        return None
