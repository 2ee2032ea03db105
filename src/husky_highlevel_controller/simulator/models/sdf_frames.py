"""SDF frames: poses relative to links, models and <frame>s (SDF 1.7, `relative_to` and `attached_to`).

In: the `Node` of a world or model, and a <pose> in it. Out: the pose in the frame of this world or model.

A <pose> in SDF may name the frame in which its numbers are given: a link, a model or a <frame>, whose own
<pose> may name another frame, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Dict, List, Optional, Tuple

from husky_highlevel_controller.datatypes import IDENTITY, Pose
from husky_highlevel_controller.geometry import compose, inverse
from husky_highlevel_controller.simulator.models.sdf_include import Model, models_in
from husky_highlevel_controller.simulator.models.sdf_parser import Node


@dataclass
class FrameScope:
    """Frames of one world or model, in which a name of a frame is looked up.

    The members of a world or model are its links, the models in it and its <frame>s. Each member is a frame.
    The empty name means this world or model itself.
    """

    holder: Node  # element <world> or <model> that contains these frames
    name: str = "world"  # name of the model, or "world"
    outer: Optional[FrameScope] = None  # frames of the world or model around this model; None for the world
    pose_in_outer: Optional[Pose] = None  # pose in `outer`; None if it is not known yet
    # poses of the members that have been looked up so far, by name; each pose is in the frame of this world
    # or model
    _resolved: Dict[str, Pose] = field(default_factory=dict)
    # names of the members whose poses are being computed. The pose of each member in this list depends on the
    # pose of the next member. If a pose depends on a member that is already in the list, the frames form a
    # circle.
    _unfinished: List[str] = field(default_factory=list)

    @cached_property
    def _models(self) -> Dict[str, Model]:
        """Models directly in this world or model, by name; of several models with one name, the first."""
        # a dictionary keeps the last entry of each name, so the models are taken from the last to the first
        return {model.name: model for model in reversed(list(models_in(self.holder)))}

    @cached_property
    def _members(self) -> Dict[str, Tuple[Optional[Node], str]]:
        """Return the <pose> of each member (None if it has none) and the name of its default frame.

        The numbers of a <pose> are relative to the default frame if the <pose> names no frame. The default
        frame of a <frame> is the frame in its `attached_to`. The default frame of any other member is the
        empty name, which means this world or model.
        """
        members = {name: (model.pose, "") for name, model in self._models.items()}
        for node in (*self.holder.children("link"), *self.holder.children("frame")):
            members[node.named()] = node.child("pose"), node.element.get("attached_to", "")
        return members

    @cached_property
    def _inner(self) -> Dict[str, FrameScope]:
        """Frames inside each model in this world or model, by the name of the model."""
        return {name: FrameScope(model.node, name, self) for name, model in self._models.items()}

    def pose_of(self, pose: Optional[Node], default_frame: str = "") -> Pose:
        """Return the pose of an element in this world or model, whatever frame its <pose> names.

        Args:
            pose: <pose> of the element; None if the element stands at the origin of its default frame.
            default_frame: name of the frame if the <pose> names none; empty for this world or model.

        Raises:
            WorldError: broken numbers, or frames that are relative to each other.
        """
        frame = frame_of(pose) if pose else ""
        if not frame:
            frame = default_frame
        frame_in_holder = self._find(frame)
        if frame_in_holder is None and pose:  # no frame has this name
            pose.note("a <pose> relative to an unknown frame is read relative to the parent", frame)
            frame_in_holder = self._find(default_frame)
        pose_in_frame = pose.pose() if pose else IDENTITY
        # the default frame may be unknown, too; then the pose is relative to this world or model
        if frame_in_holder is None or frame_in_holder == IDENTITY:
            return pose_in_frame
        return compose(frame_in_holder, pose_in_frame)

    def _find(self, name: str) -> Optional[Pose]:
        """Return the pose of a frame in this world or model; None if no frame has the name.

        A name may have these meanings, and the first one that fits counts:

        - empty or `__model__`: this world or model
        - name of a link, model or <frame> in this world or model
        - name of this world or model: this world or model
        - `world`: the world
        - `MODEL::NAME`: the frame NAME of the model MODEL in this world or model
        """
        if name in ("", "__model__"):
            return IDENTITY
        if name in self._members:
            return self._resolve(name)
        if name == self.name:
            return IDENTITY
        if name == "world":
            return inverse(self._pose_in_world())
        model, _, name_in_model = name.partition("::")
        if model not in self._inner:
            return None
        pose_in_model = self._inner[model]._find(name_in_model)
        return compose(self._resolve(model), pose_in_model) if pose_in_model else None

    def _resolve(self, name: str) -> Pose:
        """Return the pose of a member in this world or model. Raises WorldError if it depends on itself."""
        pose_element, default_frame = self._members[name]  # the element <pose> is None if the member has none
        # `pose_of` below looks up the frame of this member, and so calls `_resolve` for another member. If
        # such calls come back to a member that is not finished, the member depends on itself.
        if name in self._unfinished:
            first = self._unfinished.index(name)
            circle = " > ".join([*self._unfinished[first:], name])
            # the error names the line of the <pose>, or of this world or model if there is no <pose>
            element = pose_element or self.holder
            raise element.error(f"frames are relative to each other: {circle}")
        if name not in self._resolved:
            self._unfinished.append(name)
            self._resolved[name] = self.pose_of(pose_element, default_frame)
            self._unfinished.pop()
        return self._resolved[name]

    def _pose_in_world(self) -> Pose:
        """Pose of this world or model in the world."""
        if self.outer is None:
            return IDENTITY
        pose_in_outer = self.pose_in_outer or self.outer._resolve(self.name)
        return compose(self.outer._pose_in_world(), pose_in_outer)


def frame_of(pose: Node) -> str:
    """Return the name of the frame that a <pose> names; empty if it names none.

    The attribute is `relative_to`, or `frame` before SDF 1.7.
    """
    return pose.element.get("relative_to") or pose.element.get("frame") or ""
