"""SDF <state>: poses of the models and links of a saved world, and scales of their shapes.

In: the `Node` of a <state>. Out: poses in the world, scales, inserted and deleted models.

When Gazebo saves a world, it writes the world as it was loaded, and a <state> with all changes since then.
"""

from __future__ import annotations

from typing import Dict, Iterator, Optional, Set, Tuple

from husky_highlevel_controller.datatypes import Box, Cylinder, Pose, Shape, Sphere, TriangleMesh, Vector3
from husky_highlevel_controller.meshes import scaled_mesh
from husky_highlevel_controller.simulator.models.sdf_parser import Node


class SavedState:
    """State of a saved world, or of a model or link in it; empty if nothing was saved.

    Attributes:
        deletions: names of models that were deleted from the world before it was saved.
    """

    def __init__(self, node: Optional[Node] = None) -> None:
        """Read a <state>, or a <model> or <link> inside a <state>; None if nothing was saved."""
        self._node = node
        # saved models and links directly inside `node`, by tag and name; the first one of each name counts
        self._members: Dict[Tuple[str, str], Node] = {}
        self.deletions: Set[str] = set()
        if node is None:
            return
        for child in node.children():
            self._members.setdefault((child.tag, child.element.get("name", "")), child)
        for deletions in node.children("deletions"):
            self.deletions.update(name.text for name in deletions.children("name"))

    def of(self, tag: str, name: str) -> SavedState:
        """Return the saved state of a model or link directly inside this one; `tag` is "model" or "link"."""
        return SavedState(self._members.get((tag, name)))

    @property
    def pose_in_world(self) -> Optional[Pose]:
        """Pose of the model or link in the world (not in its parent); None if not saved."""
        pose = self._node.child("pose") if self._node else None
        return pose.pose() if pose else None

    @property
    def scale(self) -> Vector3:
        """Saved factors by which the shapes of the model grow along x, y and z; 1 if there are none."""
        scale = self._node.child("scale") if self._node else None
        x, y, z = scale.positive(3) if scale else (1.0, 1.0, 1.0)
        return (x, y, z)

    @property
    def insertions(self) -> Iterator[Node]:
        """Elements <insertions>, which contain models that were inserted into the world."""
        return self._node.children("insertions") if self._node else iter(())


def scaled(shape: Shape, scale: Vector3) -> Shape:
    """Return a shape scaled as in Gazebo: a round shape stays round, and a plane keeps its size."""
    x, y, z = scale
    if isinstance(shape, Box):
        return Box((shape.size[0] * x, shape.size[1] * y, shape.size[2] * z))
    if isinstance(shape, Cylinder):
        return Cylinder(shape.radius * max(x, y), shape.length * z)
    if isinstance(shape, TriangleMesh):
        return scaled_mesh(shape, scale)
    if isinstance(shape, Sphere):
        return Sphere(shape.radius * max(scale))
    return shape
