"""SDF joints: links of a movable model that joints hold together become one rigid body.

In: a model's links as bodies, and its joints. Out: bodies, one for all links that joints connect.

This simulator has no joints that move. But joints must hold links together, so that a cart does not lose its
wheels. Bodies of one model pass through one another, as in Gazebo, except links with `<self_collide>`.
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
    """Links, frames and joints of an outermost model, and of all models inside it.

    An outermost model is directly in the world. Links and frames have full names, such as "model::link". The
    world loader first adds all links, frames and joints, and then `bodies` makes rigid bodies of the links.
    """

    name: str = ""  # name of the outermost model
    pose_in_world: Pose = IDENTITY  # pose of the outermost model
    links: Dict[str, Body] = field(default_factory=dict)
    # for each frame, name of the frame, link or model to which it is attached
    frames: Dict[str, str] = field(default_factory=dict)
    joints: List[Node] = field(default_factory=list)
    # full name of the model that contains the joint, for each joint
    scopes: List[str] = field(default_factory=list)
    self_colliding: Set[str] = field(default_factory=set)  # names of links with <self_collide>

    def add_joint(self, joint: Node, scope: str) -> None:
        """Add a joint; `scope` is the full name of its model."""
        self.joints.append(joint)
        self.scopes.append(scope)

    def bodies(self) -> Iterator[Body]:
        """Yield the rigid bodies of the model, in the order of their first links."""
        for body in self._rigid_bodies():
            pose_model_in_body = compose(inverse(body.pose_in_world), self.pose_in_world)
            yield replace(body, pose_model_in_body=pose_model_in_body)

    def _rigid_bodies(self) -> Iterator[Body]:
        """Yield one body for each group of links that joints connect.

        A group that joints connect with the world is static. Bodies with the same name in `Body.model` pass
        through one another; a body with the empty name collides with every body.
        """
        # links that never move need no joints, so each of them stays a body of its own
        is_static = all(body.mass == 0.0 for body in self.links.values())
        if is_static:
            model = self.name if len(self.links) > 1 else ""
            for body in self.links.values():
                yield replace(body, model=model)
            return
        group_of = self._groups()
        links_by_group: Dict[str, List[str]] = {}
        for name in self.links:
            links_by_group.setdefault(group_of[name], []).append(name)
        is_whole = len(links_by_group) == 1  # true if one body is the whole model
        for group, names in links_by_group.items():
            body = self._rigid_body(names, is_whole)
            is_fixed_to_world = group == group_of[_WORLD]
            self_collides = bool(self.self_colliding.intersection(names))
            yield replace(
                body,
                mass=0.0 if is_fixed_to_world else body.mass,
                model="" if is_whole or self_collides else self.name,
            )

    def _groups(self) -> Dict[str, str]:
        """Return the name of its group for each link, and for the world.

        Two links are in one group if joints connect them, directly or through other links. The name of a
        group is the name of any link in it, or of the world. A joint of a link that does not exist is left
        out with a note.
        """
        # at first, each link and the world are groups of their own
        group_of = {name: name for name in (*self.links, _WORLD)}
        for joint, scope in zip(self.joints, self.scopes):
            ends = [self._link_at_end(joint, tag, scope) for tag in ("parent", "child")]
            if "" in ends:
                joint.note("a <joint> of a link that does not exist is left out")
                continue
            if joint.element.get("type") != "fixed":
                joint.note("joints do not move, so a movable model with joints is one rigid body", self.name)
            # all links in the group of the child link come into the group of the parent link
            parents_group, childs_group = (group_of[end] for end in ends)
            for name, group in group_of.items():
                if group == childs_group:
                    group_of[name] = parents_group
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
        # The name may be that of a frame, which is attached to a link or to another frame. Each round goes
        # from a frame to what it is attached to. There are as many rounds as frames. This is enough to reach
        # a link, and the loop also ends if the frames are attached in a circle.
        for _ in self.frames:
            name = self.frames.get(name, name)
        return name if name in self.links else ""

    def _rigid_body(self, names: List[str], is_whole: bool) -> Body:
        """Return the rigid body of the links with these names, in the frame of the first link.

        If one of the links never moves, the body never moves. A body of several links gets the name of the
        model if the links are the whole model (`is_whole`), and otherwise the name of the first link.
        """
        links = [self.links[name] for name in names]
        first = links[0]
        if len(links) == 1:
            # if the model has only this link, `_read_links` has given the model's name to the link
            return first
        collisions: List[Geometry] = []
        visuals: List[Geometry] = []
        for link in links:
            link_in_body = compose(inverse(first.pose_in_world), link.pose_in_world)
            collisions.extend(_moved(link_in_body, part) for part in link.collisions)
            visuals.extend(_moved(link_in_body, part) for part in link.visuals)
        is_static = any(link.mass == 0.0 for link in links)
        return Body(
            self.name if is_whole else first.name,
            first.pose_in_world,
            collisions=tuple(collisions),
            visuals=tuple(visuals),
            mass=0.0 if is_static else sum(link.mass for link in links),
        )


def _moved(pose_link_in_body: Pose, part: Geometry) -> Geometry:
    """Return a shape of a link with its pose in the body, from its pose in the link."""
    return replace(part, pose_in_body=compose(pose_link_in_body, part.pose_in_body))
