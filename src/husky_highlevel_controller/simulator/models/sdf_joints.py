"""SDF joints: links of a movable model that joints hold together become one rigid body.

In: a model's links as bodies, and its joints. Out: bodies; links that joints hold together are one.

Joints do not move here. In Gazebo a model whose joints stand still is one rigid body, so it is one here too:
without that a cart would lose its wheels. Links of one model pass through one another, unless they
`<self_collide>`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Dict, Iterator, List, Set

from husky_highlevel_controller.datatypes import IDENTITY, Body, Geometry, Pose
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.simulator.models.sdf_parser import Node

_WORLD = "world"  # name of the ground at the end of a joint


@dataclass
class Assembly:
    """Links, frames and joints of a model and of the models in it, by their full names."""

    name: str  # name of the model
    pose_in_world: Pose = IDENTITY  # pose of the model
    links: Dict[str, Body] = field(default_factory=dict)
    frames: Dict[str, str] = field(default_factory=dict)  # frame, link or model to which each is attached
    joints: List[Node] = field(default_factory=list)
    scopes: List[str] = field(default_factory=list)  # full name of the model of each joint
    self_colliding: Set[str] = field(default_factory=set)  # links

    def add_joint(self, joint: Node, scope: str) -> None:
        """Add a joint of the model of that full name."""
        self.joints.append(joint)
        self.scopes.append(scope)

    def bodies(self) -> Iterator[Body]:
        """Rigid bodies of the model, in the order of their first links."""
        for body in self._rigid_bodies():
            pose_model_in_body = compose(inverse(body.pose_in_world), self.pose_in_world)
            yield replace(body, pose_model_in_body=pose_model_in_body)

    def _rigid_bodies(self) -> Iterator[Body]:
        """Yield one body for each group of links that joints connect, directly or through other links.

        A group that a joint ties to the world becomes static. Several bodies of one model get the model's
        name, so that they pass through one another, unless one of their links has <self_collide>. A joint of
        a link that does not exist is left out with a note.
        """
        if all(body.mass == 0.0 for body in self.links.values()):
            yield from self.links.values()
            return
        root = {name: name for name in (*self.links, _WORLD)}  # root link of each link's rigid body
        for joint, scope in zip(self.joints, self.scopes):
            ends = [self._end(joint, tag, scope) for tag in ("parent", "child")]
            if "" in ends:
                joint.note("a <joint> of a link that does not exist is left out")
                continue
            if joint.element.get("type") != "fixed":
                joint.note("joints do not move, so a movable model with joints is one rigid body", self.name)
            kept, gone = (root[end] for end in ends)
            root = {name: kept if above == gone else above for name, above in root.items()}
        groups: Dict[str, List[str]] = {}
        for name in self.links:
            groups.setdefault(root[name], []).append(name)
        for group in groups.values():
            body = self._rigid(group, len(groups) == 1)
            fixed = root[group[0]] == root[_WORLD]
            alone = len(groups) == 1 or self.self_colliding.intersection(group)
            yield replace(body, mass=0.0 if fixed else body.mass, model="" if alone else self.name)

    def _end(self, joint: Node, tag: str, scope: str) -> str:
        """Full name of the link at an end of a joint, or _WORLD; empty if there is none."""
        node = joint.child(tag)
        name = node.text if node else ""
        if name == _WORLD:
            return _WORLD
        name = f"{scope}::{name}"
        for _ in self.frames:  # a frame may be attached to a frame
            name = self.frames.get(name, name)
        return name if name in self.links else ""

    def _rigid(self, names: List[str], is_whole: bool) -> Body:
        """Rigid body of several links; if one of them never moves, it never moves."""
        first, *others = bodies = [self.links[name] for name in names]
        if not others:
            return first
        still = any(body.mass == 0.0 for body in bodies)
        parts = [(compose(inverse(first.pose_in_world), body.pose_in_world), body) for body in bodies]
        return Body(
            self.name if is_whole else first.name,
            first.pose_in_world,
            collisions=tuple(_moved(pose, part) for pose, body in parts for part in body.collisions),
            visuals=tuple(_moved(pose, part) for pose, body in parts for part in body.visuals),
            mass=0.0 if still else sum(body.mass for body in bodies),
        )


def _moved(pose_link_in_body: Pose, part: Geometry) -> Geometry:
    return replace(part, pose_in_body=compose(pose_link_in_body, part.pose_in_body))
