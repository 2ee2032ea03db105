"""SDF world loader: a world file (SDF 1.4 to 1.7, as Gazebo classic reads it) becomes records.

In: SDF text, and for `model://` includes the folders of GAZEBO_MODEL_PATH. Out: a `World` of rigid bodies.

Links are read one by one, joints are not: what hangs together in Gazebo falls apart here; a warning says so.
Elements that are not supported are named in one warning per kind; invalid ones raise `WorldError`.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Iterator, List, Optional, Sequence, Union

from husky_highlevel_controller.datatypes import IDENTITY, Body, Geometry, Pose, Vector3, World
from husky_highlevel_controller.geometry import compose, inverse, quat_from_rpy
from husky_highlevel_controller.simulator.models.sdf_geometry import rgba_of, shape_of
from husky_highlevel_controller.simulator.models.sdf_parser import (
    VERSIONS,
    Load,
    Node,
    WorldError,
    bad_version,
    open_sdf,
    read_bytes,
    read_xml,
)
from husky_highlevel_controller.simulator.spawn_request import ObjectError, check_bounds

MAX_GRAVITY = 1000.0  # [m/s^2]
MAX_INCLUDES = 1000  # model files in one world

log = logging.getLogger("rosout.world")  # a child of rospy's logger: reaches /rosout without rospy

# The ground of every Gazebo world: a static plane, 100 m of it drawn (osrf/gazebo_models, ground_plane).
_GROUND_PLANE = """<sdf version="1.7"><model name="ground_plane"><static>true</static><link name="link">
<collision name="ground"><geometry><plane><size>100 100</size></plane></geometry></collision>
<visual name="ground"><geometry><plane><size>100 100</size></plane></geometry></visual>
</link></model></sdf>"""


def load_world(path: Union[str, Path]) -> World:
    """Read a world file.

    Args:
        path: an SDF file with a <world>; `model://` includes are looked up in GAZEBO_MODEL_PATH.

    Raises:
        WorldError: the file, or a model it includes, is missing or broken.
    """
    return parse_world(read_bytes(Path(path)), str(path))


def parse_model(text: str, name: str, pose_in_world: Pose) -> List[Body]:
    """Read the text of an SDF model, called `name`, and put it at a pose in the world.

    Raises:
        WorldError: the text is broken.
    """
    load = Load()
    try:
        model = open_sdf(text, f"model_xml of '{name}'", load).required("model")
        model.element.set("name", name)
        bodies = list(_read_model(model, _Parent(pose_in_world=pose_in_world)))
    except RecursionError:
        raise WorldError(f"model_xml of '{name}': models are nested too deeply") from None
    _tell_notes(load)
    if not any(body.collisions or (body.visuals and body.mass == 0.0) for body in bodies):
        raise WorldError(f"model_xml of '{name}': nothing in it has a collision shape, and it is not static")
    return bodies


def find_world(name: str, folders: Sequence[Path]) -> Path:
    """Resolve the name of a world file: an absolute path, or relative to one of `folders`.

    A path that is not there, such as of a world of Gazebo's, is looked up by its last part, with a warning.

    Raises:
        WorldError: there is no such file.
    """
    for folder in folders:
        path = folder / name  # an absolute name stays as it is
        if path.is_file():
            return path
    for folder in folders:
        path = folder / Path(name).name
        if path.is_file():
            log.warning("there is no world %s; taking %s of the same name", name, path)
            return path
    names = sorted({path.name for folder in folders for path in folder.glob("*.world")})
    raise WorldError(
        f"no world '{name}'; there are {', '.join(names) or 'none'} in {', '.join(map(str, folders))}"
    )


def parse_world(data: Union[str, bytes], source: str) -> World:
    """Read the text of a world file; messages call it `source`. Raises WorldError like `load_world`."""
    load = Load()
    try:
        root = open_sdf(data, source, load)
        world = root.required("world")
        root.note_unknown()
        for second in list(root.children("world"))[1:]:
            second.note("only the first <world> of a file is read")
        world.note_unknown()
        result = World(world.named(), tuple(_bodies_in(world, _Parent())), _gravity(world))
    except RecursionError:
        raise WorldError(f"{source}: models are nested too deeply") from None
    _tell_notes(load)
    _check_bounds(result, source)
    return result


def _check_bounds(world: World, source: str) -> None:
    """Check the bounds within which physics can be computed. Raises WorldError."""
    if hypot(*world.gravity) > MAX_GRAVITY:
        raise WorldError(f"{source}: gravity {world.gravity} is stronger than {MAX_GRAVITY} m/s^2")
    for body in world.bodies:
        try:
            check_bounds(body)
        except ObjectError as error:
            raise WorldError(f"{source}: '{body.name}': {error}") from None


def _tell_notes(load: Load) -> None:
    for sentence, places in load.notes.items():
        more = f" and {len(places) - 3} more" if len(places) > 3 else ""
        log.warning("%s: %s%s", sentence, "; ".join(places[:3]), more)


# ---------------------------------------------------------------------------- models and links


@dataclass(frozen=True)
class _Parent:
    """Enclosing world, model or link of an element."""

    name: str = "world"  # as relative_to calls it
    full_name: str = ""  # with those of the models around it
    pose_in_world: Pose = IDENTITY
    pose_model_in_world: Optional[Pose] = None  # of the innermost model
    static: bool = False

    def scoped(self, name: str) -> str:
        return f"{self.full_name}::{name}" if self.full_name else name


def _pose(node: Optional[Node], parent: _Parent) -> Pose:
    """Pose of an element in the world, from its <pose>; without one, the pose of its parent."""
    if node is None:
        return IDENTITY
    x, y, z, roll, pitch, yaw = node.numbers(6) if node.text else (0.0,) * 6
    pose = Pose((x, y, z), quat_from_rpy(roll, pitch, yaw))
    frame = node.element.get("relative_to") or node.element.get("frame") or parent.name
    if frame == parent.name:
        return pose
    origins = {"world": IDENTITY, "__model__": parent.pose_model_in_world}
    origin = origins.get(frame)
    if origin is None:
        frames = "world, __model__ and the parent"
        node.note(f"a <pose> relative to anything but {frames} is read relative to the parent", frame)
        return pose
    if origin == parent.pose_in_world:
        return pose
    return compose(compose(inverse(parent.pose_in_world), origin), pose)


def _bodies_in(holder: Node, parent: _Parent) -> Iterator[Body]:
    """The bodies of all models and includes of a world or model."""
    for node in holder.children():
        if node.tag == "model":
            yield from _read_model(node, parent)
        elif node.tag == "include":
            yield from _read_include(node, parent)


def _read_model(model: Node, parent: _Parent, include: Optional[Node] = None) -> Iterator[Body]:
    """The bodies of a model; name, pose and static of an include come before the model's own."""
    model.note_unknown()
    children_by_tag = {child.tag: child for node in (model, include) if node for child in node.children()}
    name = include.child("name") if include else None
    full_name = parent.scoped((name.text if name else "") or model.named())
    if include and not name:
        full_name = _free_name(full_name, model)
    _claim(full_name, include or model)
    pose_in_world = compose(parent.pose_in_world, _pose(children_by_tag.get("pose"), parent))
    static = parent.static or ("static" in children_by_tag and children_by_tag["static"].flag())
    me = _Parent(model.named(), full_name, pose_in_world, pose_in_world, static)
    links = list(model.children("link"))
    if not (links or model.child("model") or model.child("include")):
        model.note("a <model> without a <link> is left out")
    for link in links:
        yield _read_link(link, me, full_name if len(links) == 1 else _claim(me.scoped(link.named()), link))
    yield from _bodies_in(model, me)


def _claim(name: str, node: Node) -> str:
    if name in node.load.names:
        raise node.error(f"a second body is called '{name}'; give each its own name")
    node.load.names.add(name)
    return name


def _free_name(name: str, node: Node) -> str:
    """Number the second of two nameless includes: Gazebo's football field has its goals that way."""
    free, number = name, 1
    while free in node.load.names:
        free, number = f"{name}_{number}", number + 1
    return free


def _read_link(link: Node, model: _Parent, full_name: str) -> Body:
    link.note_unknown()
    pose_in_world = compose(model.pose_in_world, _pose(link.child("pose"), model))
    me = _Parent(link.named(), full_name, pose_in_world, model.pose_in_world, model.static)
    for tag, usual in (("gravity", True), ("kinematic", False)):
        node = link.child(tag)
        if node and node.flag() != usual and not me.static:
            node.note(f"<{tag}> of a link is not supported and is left out", node.text)
    return Body(
        full_name,
        pose_in_world,
        collisions=tuple(_geometries(link, "collision", me)),
        visuals=tuple(_geometries(link, "visual", me)),
        mass=_mass(link, me),
    )


def _mass(link: Node, me: _Parent) -> float:
    """Mass [kg]: 1 where nothing is said (SDF's default), 0 for what never moves."""
    mass = 1.0
    inertial = link.child("inertial")
    if inertial:
        inertial.note_unknown()
        for moment in (node for inertia in inertial.children("inertia") for node in inertia.children()):
            moment.numbers(1)
        if _pose(inertial.child("pose"), me).position != IDENTITY.position and not me.static:
            inertial.note("a centre of mass (<inertial><pose>) away from the link's origin is not supported")
        node = inertial.child("mass")
        if node:
            (mass,) = node.numbers(1)
            if mass < 0.0 or (mass == 0.0 and not me.static):
                raise node.error(
                    f"must be greater than zero (<static> is for what never moves), not '{node.text}'"
                )
    return 0.0 if me.static else mass


def _gravity(world: Node) -> Vector3:
    """Gravity in the world [m/s^2]: SDF 1.4 says it in <physics>, later versions in <world>."""
    for holder in (world, *world.children("physics")):
        node = holder.child("gravity")
        if node:
            x, y, z = node.numbers(3)
            return (x, y, z)
    return (0.0, 0.0, -9.8)


# ---------------------------------------------------------------------------- includes


def _read_include(include: Node, parent: _Parent) -> Iterator[Body]:
    include.note_unknown()
    _pose(include.child("pose"), parent)  # broken numbers are an error even where nothing is placed
    uri = include.required("uri").text
    if uri == "model://sun":
        return
    if uri == "model://ground_plane":
        root = open_sdf(_GROUND_PLANE, uri, include.load)
        yield from _read_model(root.required("model"), parent, include)
    elif not uri.startswith("model://"):
        include.note("an <include> of anything but model:// is not supported and is left out", uri)
    else:
        yield from _read_included_file(_find_model(include, uri), include, parent)


def _read_included_file(path: Path, include: Node, parent: _Parent) -> Iterator[Body]:
    open_files = include.load.open_files
    if path in open_files:
        chain = " > ".join(str(file) for file in (*open_files, path))
        raise include.error(f"a model includes itself: {chain}")
    include.load.includes += 1
    if include.load.includes > MAX_INCLUDES:
        raise include.error(
            f"more than {MAX_INCLUDES} models are included; does each include several others?"
        )
    open_files.append(path)
    root = open_sdf(read_bytes(path), str(path), include.load)
    if not root.child("light"):  # a lamp, like model://sun, is nothing to drive against
        yield from _read_model(root.required("model"), parent, include)
    open_files.pop()


def _find_model(include: Node, uri: str) -> Path:
    """The newest SDF file of a model that can be read here."""
    name = uri[len("model://") :].strip("/")
    model_path = os.environ.get("GAZEBO_MODEL_PATH", "")
    for folder in filter(None, model_path.split(os.pathsep)):
        files = (os.path.join(folder, name, file) for file in ("model.config", "model.sdf"))
        config, plain = (Path(os.path.realpath(file)) for file in files)
        if name and os.path.isfile(config):
            return _newest_file(config, plain)
        if name and os.path.isfile(plain):
            return plain
    raise include.error(
        f"no model.config or model.sdf for '{uri}' in the folders of GAZEBO_MODEL_PATH ('{model_path}');"
        " add the folder that holds it"
    )


def _newest_file(config: Path, plain: Path) -> Path:
    root = read_xml(read_bytes(config), str(config))
    offers = [(sdf.get("version", ""), sdf.text or "") for sdf in root.iter("sdf")]
    if not offers:
        return plain
    readable = [offer for offer in offers if offer[0] in ("", *VERSIONS)]
    if not readable:
        raise WorldError(bad_version(str(config), max(offers)[0]))
    return config.parent / max(readable)[1].strip()


def _geometries(link: Node, tag: str, me: _Parent) -> Iterator[Geometry]:
    for node in link.children(tag):
        node.note_unknown()
        pose = _pose(node.child("pose"), me)
        shape = shape_of(node.required("geometry"))
        rgba = rgba_of(node)
        if shape is not None:
            yield Geometry(shape, pose, rgba)
