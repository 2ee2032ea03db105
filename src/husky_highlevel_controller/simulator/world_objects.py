"""Bodies of the world: add, delete, move and reset them, and build the lidar's scene.

In: bodies. Out: their poses; a scene to cast rays into.
"""

from __future__ import annotations

from functools import partial
from typing import Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple

from husky_highlevel_controller.datatypes import (
    Body,
    Geometry,
    ModelMotion,
    Plane,
    Pose,
    Shape,
    TriangleMesh,
)
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.simulator.bullet.world import ROBOT, BulletWorld, PlacementError
from husky_highlevel_controller.simulator.model_motion import velocity_at
from husky_highlevel_controller.simulator.sensors.raycast import RayScene, make_scene


def model_of_body(name: str) -> str:
    """Return the name of the model to which a body of this name belongs."""
    return name.split("::")[0]


class _MovableShape(NamedTuple):
    """Collision shape of a movable body, and the function that moves this shape in the lidar's scene."""

    set_pose_in_scene: Callable[[Pose], None]  # takes the new pose of the shape in the world
    body: str  # name of the body
    geometry: Geometry  # the shape, and its pose in the body


class WorldObjects:
    """All bodies of a world except the robot: those in Bullet, and those that are only drawn.

    A model is one body, or several bodies that are moved and deleted together. The name of a body is `model`,
    or `model::link` in a model of several bodies. A body without a collision shape is not in Bullet, because
    it is only drawn.
    """

    def __init__(self, bullet: BulletWorld) -> None:
        self._bullet = bullet
        self._bodies: Dict[str, Body] = {}
        # Bullet does not know a body that is only drawn, so its pose in the world is kept here, by name. A
        # body that is only drawn and has no entry is at its initial pose.
        self._drawn_poses: Dict[str, Pose] = {}

    @property
    def bodies(self) -> Mapping[str, Body]:
        """Bodies by name; the pose in a `Body` is its initial pose, not its present pose."""
        return self._bodies

    def load(self, bodies: Sequence[Body]) -> None:
        """Put the bodies of a world into an empty Bullet world."""
        self._bodies, self._drawn_poses, self._scene_is_stale = {}, {}, True
        for body in bodies:
            self._put(body)

    def add(self, bodies: Sequence[Body]) -> None:
        """Add all new bodies, or none. Raises PlacementError if a name is taken, or if a body has no room."""
        added: List[str] = []
        models = {model_of_body(body.name) for body in bodies}
        if ROBOT in models:
            raise PlacementError(f"'{ROBOT}' is the name of the robot; choose another name")
        # a new body with the name of an existing model would become a part of that model
        taken = models.intersection(self.models)
        if taken:
            raise self._name_is_taken(min(taken))
        try:
            for body in bodies:
                if self.members(body.name):  # a body before it in `bodies` has the same name
                    raise self._name_is_taken(body.name)
                self._put(body)
                added.append(body.name)
                if body.collisions:
                    self._bullet.check_room(body.name)
        except Exception:
            for name in added:
                self._drop(name)
            raise

    def _put(self, body: Body) -> None:
        """Add one body, without a check of its name and its room."""
        self._bullet.add_body(body)
        self._bodies[body.name] = body
        self._scene_is_stale = True

    def members(self, name: str) -> List[str]:
        """Return the name of the body with this name, or of all bodies in the model with this name."""
        return [body for body in self._bodies if body == name or body.startswith(name + "::")]

    def delete(self, name: str) -> None:
        """Remove a body, or all bodies of a model. Raises PlacementError if nothing has this name."""
        members = self.members(name)
        if not members:
            raise self._unknown(name)
        for member in members:
            self._drop(member)

    def _drop(self, name: str) -> None:
        """Remove the body with this name."""
        body = self._bodies.pop(name)
        if body.collisions:
            self._bullet.remove_body(name)
        self._drawn_poses.pop(name, None)
        self._scene_is_stale = True

    def move(self, name: str, pose_in_world: Pose) -> None:
        """Put a body somewhere else, at rest.

        Raises:
            PlacementError: no object has this name, the object is a plane or has no collision shape, or
                another object is in the way; then nothing changes.
        """
        if name not in self._bodies:
            raise self._unknown(name)
        if not self._bodies[name].collisions:
            raise PlacementError(f"'{name}' has no collision shape, so it cannot be moved")
        self._bullet.check_movable(name)
        self._bullet.check_moves({name: pose_in_world}, checked=name)  # only this body moves
        self._bullet.move_body(name, pose_in_world)
        self._scene_is_stale = True

    @property
    def models(self) -> List[str]:
        """Names of the models, each once."""
        return list(dict.fromkeys(map(model_of_body, self._bodies)))

    def motion_of(self, model: str) -> ModelMotion:
        """Return the motion of a model in the world. Raises PlacementError if no model has this name."""
        members = self.members(model)
        if not members:
            raise self._unknown(model)
        # the motion of the model is that of its first body in Bullet, or of its first body if all are only
        # drawn
        members_in_bullet = [name for name in members if self._bodies[name].collisions]
        body = self._bodies[(members_in_bullet or members)[0]]
        pose_of_body = self.pose_of(body.name)
        pose_of_model = compose(pose_of_body, body.pose_model_in_body)
        # a static body, and a body that is only drawn, have no velocity
        if not body.collisions or body.mass == 0.0:
            return ModelMotion(pose_of_model)
        # if the body turns, the origin of the model has another velocity than the origin of the body
        velocity, spin = self._bullet.velocity_of(body.name)
        velocity_of_model = velocity_at(ModelMotion(pose_of_body, velocity, spin), pose_of_model.position)
        return ModelMotion(pose_of_model, velocity_of_model, spin)

    def place_model(self, model: str, motion_in_world: ModelMotion) -> None:
        """Move a model with all its bodies, and give a velocity to its movable bodies.

        Args:
            model: name of the model.
            motion_in_world: new pose of the model's frame, and its velocity there.

        Raises:
            PlacementError: no model has this name, or another object is in the way; then nothing changes.
        """
        # rigid motion in the world that takes the model from its present pose to its new pose; all bodies of
        # the model make this motion
        shift = compose(motion_in_world.pose, inverse(self.motion_of(model).pose))
        new_poses = {name: compose(shift, self.pose_of(name)) for name in self.members(model)}
        new_poses_in_bullet = {
            name: pose for name, pose in new_poses.items() if self._bodies[name].collisions
        }
        if not new_poses_in_bullet:
            raise PlacementError(f"'{model}' has no collision shape, so it cannot be moved")
        # all bodies are checked before the first one moves, so that an error changes nothing
        for name in new_poses_in_bullet:
            self._bullet.check_movable(name)
            self._bullet.check_moves(new_poses_in_bullet, checked=name)
        for name, pose in new_poses.items():
            if name not in new_poses_in_bullet:
                self._drawn_poses[name] = pose
        for name, pose in new_poses_in_bullet.items():
            self._bullet.move_body(name, pose)
            if self._bodies[name].mass > 0.0:
                velocity = velocity_at(motion_in_world, pose.position)
                self._bullet.set_velocity(name, velocity, motion_in_world.angular_velocity)
        self._scene_is_stale = True

    def reset_poses(self) -> None:
        """Move every body back to its initial pose, also a static body that a service has moved."""
        for name, pose in self.initial_poses.items():
            self._bullet.move_body(name, pose)
        self._drawn_poses.clear()
        self._scene_is_stale = True

    @property
    def initial_poses(self) -> Dict[str, Pose]:
        """Initial poses in the world of the bodies in Bullet without a plane, by name; planes cannot move."""
        return {
            body.name: body.pose_in_world
            for body in self._bodies.values()
            if body.collisions and not any(isinstance(each.shape, Plane) for each in body.collisions)
        }

    def pose_of(self, name: str) -> Pose:
        """Return the pose of a body in the world. Raises PlacementError if no body has this name."""
        if name not in self._bodies:
            raise self._unknown(name)
        body = self._bodies[name]
        if body.collisions:
            return self._bullet.pose_of(name)
        return self._drawn_poses.get(name, body.pose_in_world)

    def _name_is_taken(self, name: str) -> PlacementError:
        """Return the error for a new body whose name is taken, to be raised."""
        return PlacementError(f"a body named '{name}' exists already; choose another name")

    def _unknown(self, name: str) -> PlacementError:
        """Return the error for a name that no body has, to be raised."""
        return PlacementError(f"no body named '{name}'; there are: {', '.join(sorted(self._bodies))}")

    def scene(self) -> RayScene:
        """Return the scene that the lidar sees: all collision shapes except those of the robot.

        The scene is built only after bodies were added, removed or moved by a request. Otherwise only the
        shapes that physics may have moved get their new poses, which is faster.
        """
        if self._scene_is_stale:
            self._build_scene()
        for set_pose_in_scene, body, geometry in self._movable_shapes:
            set_pose_in_scene(compose(self._bullet.pose_of(body), geometry.pose_in_body))
        return self._scene

    def _build_scene(self) -> None:
        """Make the lidar's scene of all collision shapes, and list the shapes that `scene` must move."""
        shapes_and_poses: List[Tuple[Shape, Pose]] = []
        # bodies and geometries of the solid shapes and of the meshes, which the scene counts separately
        solids: List[Tuple[Body, Geometry]] = []
        meshes: List[Tuple[Body, Geometry]] = []
        for body in self._bodies.values():
            for geometry in body.collisions:
                pose = compose(self._bullet.pose_of(body.name), geometry.pose_in_body)
                shapes_and_poses.append((geometry.shape, pose))
                if isinstance(geometry.shape, TriangleMesh):
                    meshes.append((body, geometry))
                elif not isinstance(geometry.shape, Plane):  # a plane never moves
                    solids.append((body, geometry))
        self._scene = make_scene(shapes_and_poses)
        # shapes of the movable bodies, which physics may move from one scan to the next
        self._movable_shapes: List[_MovableShape] = []
        for move, shapes in ((self._scene.move, solids), (self._scene.move_mesh, meshes)):
            for index, (body, geometry) in enumerate(shapes):
                # physics does not move a static body; a request that moves it makes the scene stale
                if body.mass > 0.0:
                    set_pose_in_scene = partial(move, index)
                    self._movable_shapes.append(_MovableShape(set_pose_in_scene, body.name, geometry))
        self._scene_is_stale = False
