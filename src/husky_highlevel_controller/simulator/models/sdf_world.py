"""SDF world loader: a world file (SDF 1.3 to 1.12, as Gazebo classic reads it) becomes records.

In: SDF text, and for `model://` includes the folders of GAZEBO_MODEL_PATH. Out: a `World` of rigid bodies.

Joints do not move here, so all links that joints connect in a movable model become one body, with a warning.
Elements that the simulation does not use or support are left out, with one warning for each kind of element.
`WorldError` is raised if an element that changes the scene, such as a size, cannot be read.

A "note" is an entry for such a warning: reading goes on, and the warnings are logged at the end.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, field
from functools import partial
from math import hypot
from pathlib import Path
from typing import Iterator, List, Optional, Tuple, Union

from husky_highlevel_controller.datatypes import (
    IDENTITY,
    Body,
    Geometry,
    Plane,
    Pose,
    Shape,
    TriangleMesh,
    Vector3,
    World,
)
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.paths import search_path, share_folder
from husky_highlevel_controller.robot import ROBOTS
from husky_highlevel_controller.simulator.models.mesh_file import MAX_FACES
from husky_highlevel_controller.simulator.models.sdf_frames import FrameScope, frame_of
from husky_highlevel_controller.simulator.models.sdf_geometry import not_thinner, rgba_of, shape_of_geometry
from husky_highlevel_controller.simulator.models.sdf_include import Model, models_in
from husky_highlevel_controller.simulator.models.sdf_joints import Assembly
from husky_highlevel_controller.simulator.models.sdf_parser import Load, Node, open_sdf
from husky_highlevel_controller.simulator.models.sdf_state import SavedState, scaled
from husky_highlevel_controller.simulator.models.sdf_xml import WorldError, read_bytes
from husky_highlevel_controller.simulator.spawn_request import FARTHEST, MASSES, SIZES

MAX_GRAVITY = 1000.0  # [m/s^2] stronger gravity is refused
MAX_INCLUDES = 1000  # largest number of model files that a world may include

# rospy's logger is the parent of this logger, so lines reach /rosout although this module does not import
# rospy
log = logging.getLogger("rosout.world")


def load_world(path: Union[str, Path]) -> World:
    """Read an SDF file with a <world>; `model://` includes are looked up in GAZEBO_MODEL_PATH.

    Raises:
        WorldError: the file, or a model it includes, is missing or broken.
    """
    return parse_world(read_bytes(Path(path)), str(path))


def parse_model(text: str, name: str, pose_in_world: Pose) -> List[Body]:
    """Return the bodies of an SDF model that a service spawns at a pose in the world.

    `name` replaces the name in the text. Raises WorldError if the text cannot be read.
    """
    load = Load()
    try:
        root = open_sdf(text, f"model_xml of '{name}'", load)
        model = root.required("model")
        model.element.set("name", name)
        place = _Place(FrameScope(root), pose_in_world=pose_in_world)
        bodies = _whole_model(Model(model), place)
    except RecursionError:
        raise WorldError(f"model_xml of '{name}': models or frames are nested too deeply") from None
    _log_notes(load)
    # a body without a collision shape is useful only if it is drawn and stays where it is
    if not any(body.collisions or (body.visuals and body.mass == 0.0) for body in bodies):
        raise WorldError(f"model_xml of '{name}': nothing in it has a collision shape, and it is not static")
    return bodies


def find_world(name: str) -> Path:
    """Return the path of a world file, from an absolute path or a name.

    A name is searched in the folders of this package, and then in those of GAZEBO_RESOURCE_PATH. If no file
    is found, its name without folders is searched in the same folders, with a warning.

    Raises:
        WorldError: no file has this name.
    """
    folders = [share_folder() / "worlds", share_folder(), *search_path("GAZEBO_RESOURCE_PATH")]
    for folder in folders:
        path = folder / name  # `name` itself if it is an absolute path
        if os.path.isfile(path):  # `path.is_file` would raise an error for a name that is too long
            return path
    for folder in folders:
        path = folder / Path(name).name
        if os.path.isfile(path):
            log.warning("there is no world %s; using %s, which has the same name", name, path)
            return path
    names = sorted({path.name for folder in folders for path in folder.glob("*.world")})
    raise WorldError(
        f"no world '{name:.200}'; there are {', '.join(names) or 'none'} in {', '.join(map(str, folders))}"
    )


def parse_world(data: Union[str, bytes], source: str) -> World:
    """Read the text of a world file. `source` names it in messages. Raises WorldError like `load_world`."""
    load = Load()
    try:
        root = open_sdf(data, source, load)
        world = root.required("world")
        root.note_unknown()
        for second in list(root.children("world"))[1:]:
            second.note("only the first <world> of a file is read")
        world.note_unknown()
        # a world that Gazebo has saved has a <state>, which changes poses, and deletes and inserts models
        state = SavedState(world.child("state"))
        place = _Place(FrameScope(world), state)
        bodies: List[Body] = []
        for holder in (world, *state.insertions):
            for model in _wanted_models(holder, place):
                bodies.extend(_whole_model(model, place))
        result = World(world.named(), tuple(bodies), _gravity(world))
    except RecursionError:
        raise WorldError(f"{source}: models or frames are nested too deeply") from None
    _log_notes(load)
    _warn_if_lidar_sees_nothing(result, load)
    return result


def _warn_if_lidar_sees_nothing(world: World, load: Load) -> None:
    """Warn if the lidar sees nothing in a world of models, because shapes or models were left out."""
    solids = [part for body in world.bodies for part in body.collisions if not isinstance(part.shape, Plane)]
    if load.model_count and load.missed_by_lidar and not solids:
        log.warning(
            "world '%s': the lidar sees nothing, because no shape of its %d models is left; "
            "see the warnings above",
            world.name,
            load.model_count,
        )


def _log_notes(load: Load) -> None:
    """Log which meshes were made coarser, and one warning for each kind of note.

    A warning names at most three of the places in the file that it is about.
    """
    if load.meshes.coarser:
        files = "; ".join(load.meshes.coarser)
        log.warning("meshes of more than %d triangles are made coarser: %s", MAX_FACES, files)
    for sentence, places in load.notes.items():
        more = f" and {len(places) - 3} more" if len(places) > 3 else ""
        log.warning("%s: %s%s", sentence, "; ".join([*places.values()][:3]), more)


@dataclass(frozen=True)
class _Place:
    """World or model that contains an element, with everything that the element inherits from it."""

    frames: FrameScope  # finds the frame that a <pose> names
    # poses and scales that were saved with the world; they replace those of the file
    state: SavedState = field(default_factory=SavedState)
    # name of the model, after the names of the models that contain it: "outer::inner"; empty for the world
    full_name: str = ""
    pose_in_world: Pose = IDENTITY
    static: bool = False  # true if this model, or a model around it, never moves
    self_collides: bool = False  # true if this model, or a model around it, has <self_collide>

    def full_name_of(self, name: str) -> str:
        """Return the full name of an element in this world or model, such as "outer::inner"."""
        return f"{self.full_name}::{name}" if self.full_name else name


def _wanted_models(holder: Node, place: _Place) -> Iterator[Model]:
    """Yield the models directly in a world or model, except deleted models and models of the robot.

    Args:
        holder: element <world>, <insertions> or <model>.
        place: the world or model itself.
    """
    for model in models_in(holder):
        if model.name in place.state.deletions:
            continue  # this model was deleted before the world was saved
        if place.full_name_of(model.name) in ROBOTS:
            model.node.note("a <model> of the robot is left out; the simulator adds the robot", model.name)
            continue
        yield model


def _whole_model(model: Model, world: _Place) -> List[Body]:
    """Return the bodies of a model directly in the world, and of all models inside this model."""
    # joints may connect links of all these models, so all links are collected before they become bodies
    assembly = Assembly()
    _add_model(model, world, assembly)
    bodies = list(assembly.bodies())
    shapes = [part.shape for body in bodies for part in body.collisions]
    # a model of planes only is a ground; it does not count, so that a world with only a ground gets no
    # warning that the lidar sees nothing
    is_ground = bool(shapes) and all(isinstance(shape, Plane) for shape in shapes)
    if not is_ground:
        model.node.load.model_count += 1
    return bodies


def _add_model(model: Model, parent: _Place, assembly: Assembly) -> None:
    """Add a model, and the models inside it, to the assembly of the outermost model.

    Args:
        model: the model, from a <model> or an <include>.
        parent: world or model that contains the model.
        assembly: collects the links, frames and joints of the outermost model and of all models inside it.

    Raises:
        WorldError: a model includes itself, or more than MAX_INCLUDES models are included.
    """
    if model.include is None:
        _read_model(model, parent, assembly)
    else:
        _read_included(model, model.include, parent, assembly)


def _read_included(model: Model, include: Node, parent: _Place, assembly: Assembly) -> None:
    """Add the model of an <include>, see `_add_model`."""
    load, file = include.load, model.node.source
    if file in load.open_files:
        raise include.error(f"a model includes itself: {' > '.join((*load.open_files, file))}")
    load.include_count += 1
    if load.include_count > MAX_INCLUDES:
        raise include.error(
            f"more than {MAX_INCLUDES} models are included; check whether each includes several others"
        )
    # while the model is read, its file is on this list, so that the check at the beginning of this function
    # finds an <include> of the same file inside the model
    load.open_files.append(file)
    _read_model(model, parent, assembly)
    load.open_files.pop()


def _read_model(model: Model, parent: _Place, assembly: Assembly) -> None:
    """Add a model to an assembly; see `_add_model`.

    A second model of the same name is left out with a note.
    """
    node = model.node
    node.note_unknown()
    name = _name_in_parent(model, parent)
    full_name = parent.full_name_of(name)
    if full_name in node.load.names:
        (model.include or node).note("a second model of the same name is left out, as in Gazebo", name)
        return
    node.load.names.add(full_name)
    place = _place_of_model(model, name, parent)
    is_outermost = not parent.full_name
    if is_outermost:
        assembly.name, assembly.pose_in_world = full_name, place.pose_in_world
    _read_links(node, place, assembly)
    _read_frames(node, place, assembly)
    for joint in node.children("joint"):
        assembly.add_joint(joint, full_name)
    for inner_model in _wanted_models(node, place):
        _add_model(inner_model, place, assembly)
    _attach_to_link(node, place, assembly)


def _name_in_parent(model: Model, parent: _Place) -> str:
    """Return the name of a model in its parent, with a number if the name in an included file is taken.

    A world may include the same file several times without a <name>, and then each of these models has the
    name in the file.
    """
    if model.include and not model.include.child("name"):
        return _free_name(model.name, parent, model.node)
    return model.name


def _read_frames(node: Node, place: _Place, assembly: Assembly) -> None:
    """Add the frames of a <model> to an assembly, each with the frame to which it is attached."""
    for frame in node.children("frame"):
        # SDF attaches a frame without `attached_to` to the model itself
        attached_to = frame.element.get("attached_to") or "__model__"
        assembly.frames[place.full_name_of(frame.named())] = place.full_name_of(attached_to)


def _attach_to_link(model: Node, place: _Place, assembly: Assembly) -> None:
    """Attach the frame of a model to one of the model's links, if the model has a link.

    A joint or a frame may name the model itself, as `__model__` or by its name. This name means the link in
    `canonical_link`, or otherwise the first link, which may be a link of a model inside this model.
    """
    canonical = model.element.get("canonical_link")
    if canonical:
        link = place.full_name_of(canonical)
    else:
        link = next((name for name in assembly.links if name.startswith(f"{place.full_name}::")), "")
    if link:
        for name in (place.full_name, place.full_name_of("__model__")):
            assembly.frames[name] = link


def _read_links(node: Node, model: _Place, assembly: Assembly) -> None:
    """Add the links of a <model> to an assembly."""
    links = list(node.children("link"))
    if not (links or node.child("model") or node.child("include")):
        node.note("a <model> without a <link> is left out")
    is_lone = len(links) == 1
    for link in links:
        # Joints and frames find the link by `link_name`, which is its name in the file. If several links have
        # this name, the second one gets a number, so joints and frames find the first one.
        if is_lone:
            link_name = model.full_name_of(link.named())
            body_name = model.full_name  # users call the model by its name, so its only body has this name
        else:
            link_name = body_name = _reserve_link_name(link, model)
        body = _read_link(link, model, body_name)
        if body:
            assembly.links[link_name] = body
        if model.self_collides or _is_set(link.child("self_collide")):
            assembly.self_colliding.add(link_name)


def _place_of_model(model: Model, name: str, parent: _Place) -> _Place:
    """Return a model as the place of its links: its frames, pose and flags, also those from its parent.

    Args:
        model: the model, whose `name` is the name in the file.
        name: unique name of the model in its parent; it may have a number behind the name in the file.
        parent: place that contains the model.
    """
    pose_in_parent = parent.frames.pose_of(model.pose)
    state = parent.state.of("model", name)
    return _Place(
        # a <pose> refers to the model by its name in the file, so the frames get this name
        frames=FrameScope(model.node, model.name, parent.frames, pose_in_parent),
        state=state,
        full_name=parent.full_name_of(name),
        # if the saved state of the world has a pose for the model, this pose replaces the <pose>
        pose_in_world=state.pose_in_world or compose(parent.pose_in_world, pose_in_parent),
        static=parent.static or bool(model.static and model.static.flag()),
        # SDF allows no <self_collide> in an <include>
        self_collides=parent.self_collides or _is_set(model.node.child("self_collide")),
    )


def _is_set(node: Optional[Node]) -> bool:
    """Return whether a flag is given and true; a flag that cannot be read is left out, with a note."""
    if node is None:
        return False
    return node.unless_broken(node.flag, False, f"a <{node.tag}> that cannot be read is left out")


def _reserve_link_name(link: Node, model: _Place) -> str:
    """Return a full name for the body of a link, and reserve this name, so that no other body gets it."""
    name = link.named()
    free_name = _free_name(name, model, link)
    if free_name != name:
        link.note("a second <link> of the same name gets a number", name)
    full_name = model.full_name_of(free_name)
    link.load.names.add(full_name)
    return full_name


def _free_name(name: str, place: _Place, node: Node) -> str:
    """Return a name that is not taken in a place: the name itself, or the name with a number.

    Some worlds need the number, such as Gazebo's football field, which has two goals of one name.
    """
    free_name, number = name, 1
    while place.full_name_of(free_name) in node.load.names:
        free_name, number = f"{name}_{number}", number + 1
    return free_name


def _read_link(link: Node, model: _Place, full_name: str) -> Optional[Body]:
    """Return a link as a body; None, and a note, if the link is too far away for the engine.

    Args:
        link: the element.
        model: place of the model in the world.
        full_name: name of the body.
    """
    link.note_unknown()
    # gravity and other forces move every movable link of this simulator, so a link that asks for anything
    # else gets a note
    for tag, supported in (("gravity", ("true", "1")), ("kinematic", ("false", "0"))):
        node = link.child(tag)
        if node and node.text.lower() not in supported and not model.static:
            node.note(f"<{tag}> of a link is not supported and is left out", node.text)
    # if the saved state of the world has a pose for the link, this pose replaces the <pose>
    pose_in_model, state = model.frames.pose_of(link.child("pose")), model.state.of("link", link.named())
    pose = state.pose_in_world or compose(model.pose_in_world, pose_in_model)
    if not _is_near(pose):
        link.note(f"a link farther than {FARTHEST:g} m from the origin is left out", full_name)
        link.load.missed_by_lidar += 1  # counted for the warning that the lidar sees nothing
        return None
    collisions, mass = tuple(_geometries(link, "collision", model)), _mass(link, model)
    if mass and any(isinstance(part.shape, Plane) for part in collisions):
        link.note("a <plane> cannot move, so a link with a <plane> never moves", full_name)
        mass = 0.0
    return Body(full_name, pose, collisions, tuple(_geometries(link, "visual", model)), mass)


def _is_near(pose: Pose) -> bool:
    """Return whether a pose is near enough to the origin of its frame for the physics engine."""
    return all(abs(value) <= FARTHEST for value in pose.position)  # false for NaN, too


def _pose_in_link(part: Node, link: Node, model: _Place) -> Pose:
    """Return the pose of a <collision>, <visual> or <inertial> in its link."""
    pose, frames = part.child("pose"), model.frames
    if pose is None:
        return IDENTITY
    if frame_of(pose) in ("", link.named()):
        return pose.pose()
    # the <pose> names another frame, so the poses of the link and of the part in the model are needed
    link_in_model, part_in_model = frames.pose_of(link.child("pose")), frames.pose_of(pose, link.named())
    return compose(inverse(link_in_model), part_in_model)


def _mass(link: Node, model: _Place) -> float:
    """Return the mass of a link [kg], within MASSES; 0 if the model is static.

    The mass defaults to 1 kg, as in SDF.
    """
    mass = 1.0
    inertial = link.child("inertial")
    if inertial:
        inertial.note_unknown()
        _note_unused_inertia(inertial, link, model)
        node = inertial.child("mass")
        # a mass of 0 in a static model has no effect, so it causes no warning
        is_usual_zero = model.static and node is not None and node.text in ("0", "0.0")
        if node and not is_usual_zero:
            mass = node.unless_broken(
                lambda: node.positive()[0], mass, "a mass that is not greater than zero is read as 1 kg"
            )
    if model.static:
        return 0.0
    lightest, heaviest = MASSES
    if not lightest <= mass <= heaviest:
        link.note(
            f"a mass outside of {lightest:g} to {heaviest:g} kg is read as the nearer limit", f"{mass:g}"
        )
    return min(max(mass, lightest), heaviest)


def _note_unused_inertia(inertial: Node, link: Node, model: _Place) -> None:
    """Note what is wrong with an inertia, or not supported.

    The simulation computes the inertia and the centre of mass of a body from its shapes, so the values of the
    file have no effect. But a user who has written broken values, or a centre of mass away from the link's
    origin, should know this.
    """
    for inertia in inertial.children("inertia"):
        for moment in inertia.children():
            # the number itself is not used; reading it only makes the note if it is broken
            no_numbers: Tuple[float, ...] = ()
            sentence = "an inertia that is not a number is left out; the simulation uses no inertia"
            moment.unless_broken(partial(moment.numbers, 1), no_numbers, sentence)
    pose = inertial.unless_broken(
        partial(_pose_in_link, inertial, link, model),
        IDENTITY,
        "a centre of mass that cannot be read is not used",
    )
    # a static model does not move, so it needs no centre of mass
    if pose.position != IDENTITY.position and not model.static:
        inertial.note("a centre of mass (<inertial><pose>) away from the link's origin is not supported")


def _gravity(world: Node) -> Vector3:
    """Return the gravity in the world [m/s^2], from <world>, or from <physics> as in SDF 1.4.

    Without a <gravity>, return the default of SDF.
    """
    for holder in (world, *world.children("physics")):
        node = holder.child("gravity")
        if node:
            x, y, z = node.numbers(3)
            if hypot(x, y, z) > MAX_GRAVITY:
                raise node.error(f"must not be stronger than {MAX_GRAVITY:g} m/s^2, not '{node.text}'")
            return (x, y, z)
    return (0.0, 0.0, -9.8)


def _geometries(link: Node, tag: str, model: _Place) -> Iterator[Geometry]:
    """Yield the shapes of all elements `tag` (collision or visual) of a link.

    A broken <visual> is left out with a note, because it is only drawn. A broken <collision> is a WorldError.
    """
    for node in link.children(tag):
        node.note_unknown()
        read = partial(_geometry, node, link, model)
        if tag == "collision":
            geometry = read()
        else:
            geometry = node.unless_broken(read, None, "a <visual> that cannot be read is left out")
        if geometry is not None:
            yield geometry


def _geometry(node: Node, link: Node, model: _Place) -> Optional[Geometry]:
    """Return the shape of a <collision> or <visual> at its pose; None, and a note, if it is left out.

    Raises:
        WorldError: the pose or size of the shape cannot be read, or the size is out of bounds.
    """
    pose, shape, rgba = _pose_in_link(node, link, model), shape_of_geometry(node), rgba_of(node)
    if shape is None:
        return None
    if isinstance(shape, TriangleMesh) and node.tag == "collision" and not model.static:
        node.note("a movable mesh collides by its convex hull, but the lidar sees its triangles")
    if not _is_near(pose):
        node.note(f"a shape farther than {FARTHEST:g} m from its link is left out")
        node.load.missed_by_lidar += 1
        return None
    shape = _within_sizes(scaled(shape, model.state.scale), node)
    return None if shape is None else Geometry(shape, pose, rgba)


def _within_sizes(shape: Shape, node: Node) -> Optional[Shape]:
    """Return a shape of a size that the physics engine can use, with edges within SIZES.

    A mesh that is too small or too large is left out: the result is None. Any other shape that is too thin
    becomes thicker. Both cause a note. Raises WorldError if a shape other than a mesh is too large.
    """
    if isinstance(shape, Plane):
        return shape
    smallest, largest = SIZES
    if isinstance(shape, TriangleMesh):
        # only the largest edge is checked, because a flat mesh has a size of 0 along its normal
        if not smallest <= max(shape.size) <= largest:
            bounds = f"{smallest:g} to {largest:g} m"
            node.note(f"a mesh whose size is not within {bounds} is left out", f"{max(shape.size):g} m")
            node.load.missed_by_lidar += 1
            return None
        return shape
    if min(shape.size) < smallest:
        node.note(f"a shape thinner than {smallest:g} m is read as that thick")
        shape = not_thinner(shape, smallest)
    if max(shape.size) > largest:
        raise node.error(f"size {shape.size} is not within {smallest:g} to {largest:g} m")
    return shape
