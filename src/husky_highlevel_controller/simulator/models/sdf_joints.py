"""SDF joints: links of a movable model that joints hold together become one rigid body.

In: a model's links as bodies, and its joints. Out: bodies, one for all links that joints hold together.

Joints do not move here, but they hold links together, so that a cart does not lose its wheels.
Links of one model pass through one another, except links with `<self_collide>`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Dict, Iterator, List, Set

from husky_highlevel_controller.datatypes import IDENTITY, Body, Geometry, Pose
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.simulator.models.sdf_parser import Node

_WORLD = "world"  # a joint may have the world, by this name, as its parent or child


@dataclass
class Assembly:
    """Links, frames and joints of a model and of the models in it, by their full names."""

    name: str  # name of the model
    pose_in_world: Pose = IDENTITY  # pose of the model
    links: Dict[str, Body] = field(default_factory=dict)
    # for each frame, name of the frame, link or model to which it is attached
    frames: Dict[str, str] = field(default_factory=dict)
    joints: List[Node] = field(default_factory=list)
    # full names of the models that contain the joints, in the order of `joints`
    scopes: List[str] = field(default_factory=list)
    self_colliding: Set[str] = field(default_factory=set)  # names of links with <self_collide>

    def add_joint(self, joint: Node, scope: str) -> None:
        """Add a joint; `scope` is the full name of its model."""
        self.joints.append(joint)
        self.scopes.append(scope)

    def bodies(self) -> Iterator[Body]:
        """Rigid bodies of the model, in the order of their first links."""
        for body in self._rigid_bodies():
            pose_model_in_body = compose(inverse(body.pose_in_world), self.pose_in_world)
            yield replace(body, pose_model_in_body=pose_model_in_body)

    def _rigid_bodies(self) -> Iterator[Body]:
        """Yield one body for each group of links that joints connect.

        A group with the world is static. Bodies that have the same text in `Body.model` pass through one
        another.
        """
        # links that never move need no joints, so each of them stays a body of its own; as in Gazebo, they
        # may overlap
        is_static = all(body.mass == 0.0 for body in self.links.values())
        if is_static:
            model = self.name if len(self.links) > 1 else ""
            yield from (replace(body, model=model) for body in self.links.values())
            return
        group_of = self._groups()
        links_by_group: Dict[str, List[str]] = {}
        for name in self.links:
            links_by_group.setdefault(group_of[name], []).append(name)
        is_whole = len(links_by_group) == 1
        for group, names in links_by_group.items():
            body = self._rigid_body(names, is_whole)
            is_fixed = group == group_of[_WORLD]  # true if joints connect these links with the world
            # no `model` if the model has no other body, or if a link in this body has <self_collide>
            hits_other_bodies = is_whole or self.self_colliding.intersection(names)
            yield replace(
                body, mass=0.0 if is_fixed else body.mass, model="" if hits_other_bodies else self.name
            )

    def _groups(self) -> Dict[str, str]:
        """Return the name of a group for each link and for the world.

        Joints, directly or through other links, put links into one group. A joint of a link that does not
        exist is left out with a note.
        """
        # at first, each link and the world are groups of their own, with their own names
        group_of = {name: name for name in (*self.links, _WORLD)}
        for joint, scope in zip(self.joints, self.scopes):  # the scope is the model that contains the joint
            ends = [self._link_at_end(joint, tag, scope) for tag in ("parent", "child")]
            if "" in ends:
                joint.note("a <joint> of a link that does not exist is left out")
                continue
            if joint.element.get("type") != "fixed":
                joint.note("joints do not move, so a movable model with joints is one rigid body", self.name)
            # all links in the group of the child link move to the group of the parent link
            parents_group, childs_group = (group_of[end] for end in ends)
            group_of = {
                name: parents_group if group == childs_group else group for name, group in group_of.items()
            }
        return group_of

    def _link_at_end(self, joint: Node, tag: str, scope: str) -> str:
        """Return the full name of the link at one end of a joint, or _WORLD; empty if there is no such link.

        Args:
            joint: the element.
            tag: end of the joint, parent or child.
            scope: full name of the joint's model.
        """
        node = joint.child(tag)
        name = node.text if node else ""
        if name == _WORLD:
            return _WORLD
        name = f"{scope}::{name}"
        # a frame may be attached to another frame, so each round follows one attachment; there are at most as
        # many attachments as frames
        for _ in self.frames:
            name = self.frames.get(name, name)
        return name if name in self.links else ""

    def _rigid_body(self, names: List[str], is_whole: bool) -> Body:
        """Return the rigid body of one or more links, in the frame of the first link.

        If one of the links never moves, the body never moves. Several links get the name of the model if they
        are the whole model (`is_whole`), and otherwise the name of the first link.
        """
        bodies = [self.links[name] for name in names]
        first = bodies[0]
        if len(bodies) == 1:
            return first  # `_read_links` has already given a lone link its name
        is_static = any(body.mass == 0.0 for body in bodies)
        parts = [(compose(inverse(first.pose_in_world), body.pose_in_world), body) for body in bodies]
        return Body(
            self.name if is_whole else first.name,
            first.pose_in_world,
            collisions=tuple(_moved(pose, part) for pose, body in parts for part in body.collisions),
            visuals=tuple(_moved(pose, part) for pose, body in parts for part in body.visuals),
            mass=0.0 if is_static else sum(body.mass for body in bodies),
        )


def _moved(pose_link_in_body: Pose, part: Geometry) -> Geometry:
    return replace(part, pose_in_body=compose(pose_link_in_body, part.pose_in_body))
