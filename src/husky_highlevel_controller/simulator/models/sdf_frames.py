"""SDF frames: poses relative to links, models and <frame>s (SDF 1.7, `relative_to` and `attached_to`).

In: the `Node` of a world or model. Out: poses in it.
"""

from __future__ import annotations

from functools import cached_property
from typing import Dict, List, Optional, Tuple

from husky_highlevel_controller.datatypes import IDENTITY, Pose
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.simulator.models.sdf_include import Model, models_in
from husky_highlevel_controller.simulator.models.sdf_parser import Node


class FrameScope:
    """Frames of a world or model by name, each as a pose in that world or model."""

    def __init__(
        self,
        holder: Node,
        name: str = "world",
        outer: Optional[FrameScope] = None,
        pose: Optional[Pose] = None,
    ) -> None:
        """Frames of `holder`: a world, or the model called `name`, at `pose` in `outer`."""
        self._holder, self._name, self._outer, self._pose = holder, name, outer, pose
        self._known: Dict[str, Pose] = {}
        self._open: List[str] = []  # frames being resolved, the first asked for first

    def inner(self, model: Model, pose: Optional[Pose] = None) -> FrameScope:
        """Frames of a model in this world or model; `pose` in it, if that is known."""
        return FrameScope(model.node, model.name, self, pose)

    @cached_property
    def _models(self) -> List[Model]:
        return list(models_in(self._holder))[::-1]  # the first of a name is the last to enter a dictionary

    @cached_property
    def _inner(self) -> Dict[str, FrameScope]:
        return {model.name: self.inner(model) for model in self._models}

    @cached_property
    def _members(self) -> Dict[str, Tuple[Optional[Node], str]]:
        """<pose> of each link, model and frame, and what it is relative to unless it says so."""
        members = {model.name: (model.child("pose"), "") for model in self._models}
        for node in (*self._holder.children("link"), *self._holder.children("frame")):
            members[node.named()] = node.child("pose"), node.element.get("attached_to", "")
        return members

    def pose_of(self, pose: Optional[Node], usual: str = "") -> Pose:
        """Pose of an element in this world or model.

        Args:
            pose: its <pose>, if it has one.
            usual: the frame that the pose is given in if it names none; empty: this world or model.

        Raises:
            WorldError: broken numbers, or frames that are relative to each other.
        """
        frame = (frame_of(pose) if pose else "") or usual
        origin = self._find(frame, pose or self._holder)
        if origin is None and pose:
            pose.note("a <pose> relative to a frame that is not there is read relative to the parent", frame)
            origin = self._find(usual, pose)
        own = pose.pose() if pose else IDENTITY
        return own if origin is None or origin == IDENTITY else compose(origin, own)

    def _find(self, name: str, asker: Node) -> Optional[Pose]:
        """Pose of a frame in this world or model; None if there is none of that name."""
        if name in ("", "__model__"):
            return IDENTITY
        if name in self._members:
            return self._resolve(name, asker)
        if name == self._name:
            return IDENTITY
        if name == "world":
            return inverse(self._pose_in_world(asker))
        model, _, part = name.partition("::")
        pose_in_model = self._inner[model]._find(part, asker) if model in self._inner else None
        return compose(self._resolve(model, asker), pose_in_model) if pose_in_model else None

    def _resolve(self, name: str, asker: Node) -> Pose:
        if name in self._open:
            circle = " > ".join((*self._open[self._open.index(name) :], name))
            raise asker.error(f"frames are relative to each other: {circle}")
        if name not in self._known:
            self._open.append(name)
            self._known[name] = self.pose_of(*self._members[name])
            self._open.pop()
        return self._known[name]

    def _pose_in_world(self, asker: Node) -> Pose:
        if self._outer is None:
            return IDENTITY
        pose = self._pose if self._pose is not None else self._outer._resolve(self._name, asker)
        return compose(self._outer._pose_in_world(asker), pose)


def frame_of(pose: Node) -> str:
    """Frame that a <pose> names as its own: `relative_to`, or `frame` before SDF 1.7; empty for none."""
    return pose.element.get("relative_to") or pose.element.get("frame") or ""
