"""SDF world loader: a world file (SDF 1.3 to 1.12, as Gazebo classic reads it) becomes records.

In: SDF text, and for `model://` includes the folders of GAZEBO_MODEL_PATH. Out: a `World` of rigid bodies.

Links are read one by one, joints are not: what hangs together in Gazebo falls apart here; a warning says so.
Elements that are not supported are named in one warning per kind; invalid ones raise `WorldError`.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from typing import Iterator, List, Union

from husky_highlevel_controller.datatypes import IDENTITY, Body, Geometry, Pose, Vector3, World
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.simulator.models.sdf_frames import FrameScope, frame_of
from husky_highlevel_controller.simulator.models.sdf_geometry import rgba_of, shape_of_geometry
from husky_highlevel_controller.simulator.models.sdf_include import Model, models_in
from husky_highlevel_controller.simulator.models.sdf_parser import Load, Node, open_sdf
from husky_highlevel_controller.simulator.models.sdf_state import SavedState, scaled
from husky_highlevel_controller.simulator.models.sdf_xml import WorldError, read_bytes
from husky_highlevel_controller.simulator.spawn_request import ObjectError, check_bounds

MAX_GRAVITY = 1000.0  # [m/s^2]
MAX_INCLUDES = 1000  # model files in one world

log = logging.getLogger("rosout.world")  # a child of rospy's logger: reaches /rosout without rospy


def load_world(path: Union[str, Path]) -> World:
    """Read an SDF file with a <world>; `model://` includes are looked up in GAZEBO_MODEL_PATH.

    Raises:
        WorldError: the file, or a model it includes, is missing or broken.
    """
    return parse_world(read_bytes(Path(path)), str(path))


def parse_model(text: str, name: str, pose_in_world: Pose) -> List[Body]:
    """Read the text of an SDF model, called `name`, at a pose in the world; WorldError if it is broken."""
    load = Load()
    try:
        root = open_sdf(text, f"model_xml of '{name}'", load)
        model = root.required("model")
        model.element.set("name", name)
        bodies = list(_read_model(Model(model), _Place(FrameScope(root), pose_in_world=pose_in_world)))
    except RecursionError:
        raise WorldError(f"model_xml of '{name}': models or frames are nested too deeply") from None
    _tell_notes(load)
    if not any(body.collisions or (body.visuals and body.mass == 0.0) for body in bodies):
        raise WorldError(f"model_xml of '{name}': nothing in it has a collision shape, and it is not static")
    return bodies


def find_world(name: str) -> Path:
    """Resolve the name of a world file: an absolute path, or one in this package or GAZEBO_RESOURCE_PATH.

    A path that is not there, such as of a world of Gazebo's, is looked up by its last part, with a warning.

    Raises:
        WorldError: there is no such file.
    """
    gazebo = filter(None, os.environ.get("GAZEBO_RESOURCE_PATH", "").split(os.pathsep))
    folders = [share_folder() / "worlds", share_folder(), *map(Path, gazebo)]
    for folder in folders:
        path = folder / name  # an absolute name stays as it is
        if os.path.isfile(path):  # false for a name that is too long, too
            return path
    for folder in folders:
        path = folder / Path(name).name
        if os.path.isfile(path):
            log.warning("there is no world %s; taking %s of the same name", name, path)
            return path
    names = sorted({path.name for folder in folders for path in folder.glob("*.world")})
    raise WorldError(
        f"no world '{name:.200}'; there are {', '.join(names) or 'none'} in {', '.join(map(str, folders))}"
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
        state = SavedState(world.child("state"))
        place = _Place(FrameScope(world), state)
        bodies = [body for holder in (world, *state.insertions) for body in _bodies_in(holder, place)]
        result = World(world.named(), tuple(bodies), _gravity(world))
    except RecursionError:
        raise WorldError(f"{source}: models or frames are nested too deeply") from None
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


@dataclass(frozen=True)
class _Place:
    """World, model or link that holds an element."""

    frames: FrameScope  # of the world or the model
    state: SavedState = field(default_factory=SavedState)
    full_name: str = ""  # with those of the models around it
    pose_in_world: Pose = IDENTITY
    static: bool = False

    def scoped(self, name: str) -> str:
        return f"{self.full_name}::{name}" if self.full_name else name


def _bodies_in(holder: Node, place: _Place) -> Iterator[Body]:
    """The bodies of all models of a world or model."""
    for model in models_in(holder):
        if model.name in place.state.deletions:
            continue
        if place.scoped(model.name) in ROBOTS:
            model.node.note("the robot's own <model> is left out: the simulator has the robot", model.name)
        elif model.include:
            yield from _read_included(model, model.include, place)
        else:
            yield from _read_model(model, place)


def _read_included(model: Model, include: Node, place: _Place) -> Iterator[Body]:
    load, file = include.load, model.node.source
    if file in load.open_files:
        raise include.error(f"a model includes itself: {' > '.join((*load.open_files, file))}")
    load.includes += 1
    if load.includes > MAX_INCLUDES:
        raise include.error(
            f"more than {MAX_INCLUDES} models are included; does each include several others?"
        )
    load.open_files.append(file)
    yield from _read_model(model, place)
    load.open_files.pop()


def _read_model(model: Model, parent: _Place) -> Iterator[Body]:
    """The bodies of a model, which stands where the saved state says, else where its <pose> does."""
    node, names, name = model.node, model.node.load.names, model.name
    node.note_unknown()
    if model.include and not model.include.child("name"):
        name = _free_name(name, parent, node)
    full_name = parent.scoped(name)
    if full_name in names:
        (model.include or node).note("a second model of one name is left out, as in Gazebo", name)
        return
    names.add(full_name)
    pose, state = parent.frames.pose_of(model.child("pose")), parent.state.of("model", name)
    static = model.child("static")
    me = _Place(
        FrameScope(node, model.name, parent.frames, pose),
        state,
        full_name,
        state.pose_in_world or compose(parent.pose_in_world, pose),
        parent.static or bool(static and static.flag()),
    )
    links = list(node.children("link"))
    if not (links or node.child("model") or node.child("include")):
        node.note("a <model> without a <link> is left out")
    for link in links:
        yield _read_link(link, me, full_name if len(links) == 1 else _claim_link(link, me))
    yield from _bodies_in(node, me)


def _claim_link(link: Node, model: _Place) -> str:
    full_name = model.scoped(link.named())
    if full_name in link.load.names:
        raise link.error(f"a second body is called '{full_name}'; give each its own name")
    link.load.names.add(full_name)
    return full_name


def _free_name(name: str, place: _Place, node: Node) -> str:
    """Number the second of one name: Gazebo's football field has its goals that way."""
    free, number = name, 1
    while place.scoped(free) in node.load.names:
        free, number = f"{name}_{number}", number + 1
    return free


def _read_link(link: Node, model: _Place, full_name: str) -> Body:
    link.note_unknown()
    for tag, usual in (("gravity", True), ("kinematic", False)):
        node = link.child(tag)
        if node and node.flag() != usual and not model.static:
            node.note(f"<{tag}> of a link is not supported and is left out", node.text)
    pose_in_model, state = model.frames.pose_of(link.child("pose")), model.state.of("link", link.named())
    return Body(
        full_name,
        state.pose_in_world or compose(model.pose_in_world, pose_in_model),
        collisions=tuple(_geometries(link, "collision", model)),
        visuals=tuple(_geometries(link, "visual", model)),
        mass=_mass(link, model),
    )


def _pose_in_link(part: Node, link: Node, model: _Place) -> Pose:
    pose, frames = part.child("pose"), model.frames
    if pose is None or frame_of(pose) in ("", link.named()):
        return pose.pose() if pose else IDENTITY
    return compose(inverse(frames.pose_of(link.child("pose"))), frames.pose_of(pose, link.named()))


def _mass(link: Node, model: _Place) -> float:
    """Mass [kg]: 1 where nothing is said (SDF's default), 0 for what never moves."""
    mass = 1.0
    inertial = link.child("inertial")
    if inertial:
        inertial.note_unknown()
        for moment in (node for inertia in inertial.children("inertia") for node in inertia.children()):
            moment.numbers(1)
        if _pose_in_link(inertial, link, model).position != IDENTITY.position and not model.static:
            inertial.note("a centre of mass (<inertial><pose>) away from the link's origin is not supported")
        node = inertial.child("mass")
        if node:
            (mass,) = node.numbers(1)
            if mass < 0.0 or (mass == 0.0 and not model.static):
                raise node.error(
                    f"must be greater than zero (<static> is for what never moves), not '{node.text}'"
                )
    return 0.0 if model.static else mass


def _gravity(world: Node) -> Vector3:
    """Gravity in the world [m/s^2]: SDF 1.4 says it in <physics>, later versions in <world>."""
    for holder in (world, *world.children("physics")):
        node = holder.child("gravity")
        if node:
            x, y, z = node.numbers(3)
            return (x, y, z)
    return (0.0, 0.0, -9.8)


def _geometries(link: Node, tag: str, model: _Place) -> Iterator[Geometry]:
    for node in link.children(tag):
        node.note_unknown()
        pose = _pose_in_link(node, link, model)
        shape = shape_of_geometry(node.required("geometry"))
        rgba = rgba_of(node)
        if shape is not None:
            yield Geometry(scaled(shape, model.state.scale), pose, rgba)
