"""What stands in the world besides the robot, and what the lidar sees of it.

In: things to add, delete, move. Out: where they are; a scene to cast rays into.
Must not know: ROS, PyBullet, the robot.
"""

from __future__ import annotations

from typing import Dict, List, Mapping, Sequence, Tuple

from husky_highlevel_controller.datatypes import Part, Plane, Pose, Thing
from husky_highlevel_controller.engine import Engine, PlacementError
from husky_highlevel_controller.geometry import compose
from husky_highlevel_controller.raycast import Scene, make_scene


class Scenery:
    """The things in an engine; what is called `a::b` is a part of the model `a`."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._things: Dict[str, Thing] = {}

    @property
    def things(self) -> Mapping[str, Thing]:
        """What there is, by name; a thing's own pose is where it was put, not where it is now."""
        return self._things

    def furnish(self, things: Sequence[Thing]) -> None:
        """Put the things of a world into an empty engine."""
        self._things, self._stale = {}, True
        for thing in things:
            self._put(thing)

    def add(self, things: Sequence[Thing]) -> None:
        """Put new things into the world, all or none.

        Raises:
            PlacementError: a name is taken, or something stands there.
        """
        added: List[str] = []
        try:
            for thing in things:
                if self.members(thing.name):
                    raise PlacementError(f"there is a thing named '{thing.name}' already")
                self._put(thing)
                added.append(thing.name)
                if thing.collisions:
                    self._engine.check_room(thing.name)
        except PlacementError:
            for name in added:
                self._drop(name)
            raise

    def _put(self, thing: Thing) -> None:
        self._engine.add_thing(thing)
        self._things[thing.name] = thing
        self._stale = True

    def members(self, name: str) -> List[str]:
        """The thing of that name, or all things of the model of that name."""
        return [known for known in self._things if known == name or known.startswith(name + "::")]

    def delete(self, name: str) -> None:
        """Take a thing, or all things of a model, out of the world.

        Raises:
            PlacementError: there is none of that name.
        """
        members = self.members(name)
        if not members:
            raise self._unknown(name)
        for member in members:
            self._drop(member)

    def _drop(self, name: str) -> None:
        if self._things.pop(name).collisions:
            self._engine.remove_thing(name)
        self._stale = True

    def move(self, name: str, pose_in_world: Pose) -> None:
        """Put a thing somewhere else, at rest.

        Raises:
            PlacementError: there is none of that name, or something stands there; then it stays where it is.
        """
        before = self.pose_of(name)
        if not self._things[name].collisions:
            raise PlacementError(f"'{name}' is only drawn, and stays where it is")
        self._engine.move_thing(name, pose_in_world)
        self._stale = True
        try:
            self._engine.check_room(name)
        except PlacementError:
            self._engine.move_thing(name, before)
            raise

    def put_back(self) -> None:
        """Put every thing back to where it was put first."""
        for thing in self._things.values():
            if thing.mass > 0.0 and thing.collisions:
                self._engine.move_thing(thing.name, thing.pose_in_world)

    def pose_of(self, name: str) -> Pose:
        """Where a thing is now, in the world; PlacementError if there is none of that name."""
        if name not in self._things:
            raise self._unknown(name)
        thing = self._things[name]
        return self._engine.pose_of(name) if thing.collisions else thing.pose_in_world

    def _unknown(self, name: str) -> PlacementError:
        return PlacementError(f"no thing named '{name}'; there are: {', '.join(sorted(self._things))}")

    def scene(self) -> Scene:
        """What the lidar sees now: every part of every thing, and nothing of the robot."""
        if self._stale:
            self._build_scene()
        for index, name, part in self._movable:
            self._scene.move(index, compose(self._engine.pose_of(name), part.pose_in_thing))
        return self._scene

    def _build_scene(self) -> None:
        parts = [(thing, part) for thing in self._things.values() for part in thing.collisions]
        self._scene = make_scene(
            [
                (part.shape, compose(self._engine.pose_of(thing.name), part.pose_in_thing))
                for thing, part in parts
            ]
        )
        solids = [(thing, part) for thing, part in parts if not isinstance(part.shape, Plane)]
        self._movable: List[Tuple[int, str, Part]] = [
            (i, thing.name, part) for i, (thing, part) in enumerate(solids) if thing.mass > 0.0
        ]
        self._stale = False
