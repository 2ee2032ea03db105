"""SDF <geometry> and <material>: shapes and colours.

In: `Node`s. Out: shapes and colours.
"""

from __future__ import annotations

from functools import partial
from math import inf, sqrt
from typing import Callable, Dict, Optional, Tuple, Union

from husky_highlevel_controller.datatypes import Box, Cylinder, Plane, Rgba, Shape, Sphere, TriangleMesh
from husky_highlevel_controller.meshes import scaled_mesh
from husky_highlevel_controller.simulator.models.mesh_file import MeshError
from husky_highlevel_controller.simulator.models.sdf_parser import Node

Solid = Union[Box, Cylinder, Sphere]
# Colours of Gazebo's named materials: the diffuse colours in gazebo.material of Gazebo classic 11.
# Gazebo/SkyBlue has its ambient colour here, because its diffuse colour is not blue. A material with a
# texture has about the colour that its texture has from a distance.
_SCRIPT_COLOURS: Dict[str, Rgba] = {
    "Gazebo/Grey": (0.7, 0.7, 0.7, 1.0),
    "Gazebo/DarkGrey": (0.175, 0.175, 0.175, 1.0),
    "Gazebo/GreyTransparent": (0.5, 0.5, 0.5, 0.5),
    "Gazebo/White": (1.0, 1.0, 1.0, 1.0),
    "Gazebo/FlatBlack": (0.1, 0.1, 0.1, 1.0),
    "Gazebo/Black": (0.0, 0.0, 0.0, 1.0),
    "Gazebo/Red": (1.0, 0.0, 0.0, 1.0),
    "Gazebo/RedBright": (0.87, 0.26, 0.07, 1.0),
    "Gazebo/Green": (0.0, 1.0, 0.0, 1.0),
    "Gazebo/Blue": (0.0, 0.0, 1.0, 1.0),
    "Gazebo/SkyBlue": (0.13, 0.44, 0.7, 1.0),
    "Gazebo/Yellow": (1.0, 1.0, 0.0, 1.0),
    "Gazebo/ZincYellow": (0.9725, 0.9529, 0.2078, 1.0),
    "Gazebo/Purple": (1.0, 0.0, 1.0, 1.0),
    "Gazebo/Turquoise": (0.0, 1.0, 1.0, 1.0),
    "Gazebo/Orange": (1.0, 0.5088, 0.0468, 1.0),
    "Gazebo/Gold": (0.8, 0.6487, 0.1208, 1.0),
    "Gazebo/Wood": (0.6, 0.45, 0.3, 1.0),
    "Gazebo/WoodFloor": (0.6, 0.45, 0.3, 1.0),
    "Gazebo/Bricks": (0.6, 0.35, 0.3, 1.0),
    "Gazebo/Road": (0.3, 0.3, 0.3, 1.0),
}


def shape_of_geometry(holder: Node) -> Optional[Shape]:
    """Return the shape of a <collision> or <visual>; None, and a note, if it has no supported shape.

    Raises:
        WorldError: a size or a direction cannot be read.
    """
    geometry = holder.child("geometry")
    node = next(geometry.children(), None) if geometry else None
    if node is None:
        holder.note(f"a <{holder.tag}> without a shape is left out")
        return None
    if node.tag == "mesh":
        return _mesh(node)
    if node.tag in _SHAPES:
        return _SHAPES[node.tag](node)
    if node.tag != "empty":
        node.note(f"<{node.tag}> is not supported and is left out")
        # counted for the warning that the lidar sees nothing
        node.load.missed_by_lidar += 1
    return None


def not_thinner(shape: Solid, least: float) -> Solid:
    """Return a shape like this one, but with a thickness of at least `least` along each axis [m]."""
    if isinstance(shape, Box):
        x, y, z = (max(edge, least) for edge in shape.size)
        return Box((x, y, z))
    if isinstance(shape, Cylinder):
        return Cylinder(max(shape.radius, least / 2.0), max(shape.length, least))
    return Sphere(max(shape.radius, least / 2.0))


def _box(node: Node) -> Box:
    x, y, z = node.required("size").positive(3)
    return Box((x, y, z))


def _cylinder(node: Node) -> Cylinder:
    (radius,), (length,) = node.required("radius").positive(), node.required("length").positive()
    return Cylinder(radius, length)


def _sphere(node: Node) -> Sphere:
    (radius,) = node.required("radius").positive()
    return Sphere(radius)


def _plane(node: Node) -> Plane:
    """Return an endless plane from its <normal> and the <size> of the part that is drawn.

    The defaults are those of SDF: a level plane, of which 1 m by 1 m is drawn.
    """
    normal, size = node.child("normal"), node.child("size")
    x, y, z = normal.numbers(3) if normal else (0.0, 0.0, 1.0)
    edges: Tuple[float, ...] = (1.0, 1.0)
    if size:
        sentence = "a <size> of a plane that cannot be read is taken for 1 1; it is only drawn"
        edges = size.unless_broken(partial(size.positive, 2), edges, sentence)
    width, depth = edges
    length = sqrt(x * x + y * y + z * z)
    if normal and not 0.0 < length < inf:
        raise normal.error(f"needs a direction, not '{normal.text}'")
    return Plane((x / length, y / length, z / length), (width, depth))


def _mesh(node: Node) -> Optional[TriangleMesh]:
    """Return the triangles of a <mesh>, scaled as it says; None, and a note, if its file cannot be used."""
    uri_node, submesh, scale = node.child("uri"), node.child("submesh"), node.child("scale")
    x, y, z = scale.numbers(3) if scale else (1.0, 1.0, 1.0)
    if scale and not x * y * z:
        raise scale.error(f"needs numbers other than zero, not '{scale.text}'")
    if submesh and submesh.child("center"):
        submesh.note("<center> of a <submesh> is not supported and is left out")
    # name of the only part of the file that is used; empty for the whole file
    part_node = submesh.child("name") if submesh else None
    part = part_node.text if part_node else ""
    uri = uri_node.text if uri_node else ""
    try:
        mesh = node.load.meshes.read(uri, node.source, part)
    except MeshError as error:
        # the text of a MeshError has no subject, for example "is not on this machine"
        node.note(f"a mesh {error}, and is left out", uri)
        node.load.missed_by_lidar += 1
        return None
    return scaled_mesh(mesh, (x, y, z))


_SHAPES: Dict[str, Callable[[Node], Shape]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "plane": _plane,
}


def rgba_of(node: Node) -> Rgba:
    """Return the colour and the opacity with which a <visual> is drawn.

    The colour is that of <diffuse>; if there is none, of <ambient>; if there is none, of the named material;
    if there is none, grey. <transparency> reduces the opacity.
    """
    rgba: Rgba = _SCRIPT_COLOURS["Gazebo/Grey"]
    material, transparency = node.child("material"), node.child("transparency")
    if material:
        material.note_unknown()
        script = material.child("script")
        if script:
            # the name of the material is in a <name> inside the <script>, or directly in the <script>
            name = script.child("name") or script
            if name.text in _SCRIPT_COLOURS:
                rgba = _SCRIPT_COLOURS[name.text]
            else:
                name.note("a material's colour is not known, so grey is drawn", name.text)
        # <diffuse> is read last, so that its colour replaces the colour of <ambient>
        for colour in (*material.children("ambient"), *material.children("diffuse")):
            rgba = colour.unless_broken(
                partial(_colour, colour), rgba, "a colour that cannot be read is left out"
            )
    if transparency:
        not_transparent: Tuple[float, ...] = (0.0,)
        sentence = "a <transparency> that is not a number is left out"
        (value,) = transparency.unless_broken(partial(transparency.numbers, 1), not_transparent, sentence)
        rgba = (*rgba[:3], rgba[3] * (1.0 - min(max(value, 0.0), 1.0)))
    return rgba


def _colour(node: Node) -> Rgba:
    """Return the colour in the text of an element: red, green and blue, and the opacity if it is given."""
    numbers = node.numbers(3, 4)
    if len(numbers) == 3:
        numbers = (*numbers, 1.0)
    r, g, b, a = map(_colour_value, numbers)
    return (r, g, b, a)


def _colour_value(value: float) -> float:
    """Return a value within 0..1; as in Gazebo, a value above 1 is read on a scale of 0..255."""
    if value > 1.0:
        value /= 255.0
    return min(max(value, 0.0), 1.0)
