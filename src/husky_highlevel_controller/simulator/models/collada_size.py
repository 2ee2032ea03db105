"""Size of a COLLADA scene, computed without building the scene.

In: the XML of a .dae file. Out: numbers of nodes and corners.

A node of a scene may contain several instances (copies) of another node, which again contains several
instances of another node, and so on. So a few lines of XML can describe more nodes than the memory can hold.
The caller refuses a file whose scene is too large.
"""

from __future__ import annotations

from typing import Dict, List, NamedTuple, Set
from xml.etree import ElementTree


class SceneSize(NamedTuple):
    """Numbers of nodes and of corners of triangles in a scene; each instance counts."""

    nodes: int
    corners: int


NOTHING = SceneSize(nodes=0, corners=0)


def scene_size(document: ElementTree.Element) -> SceneSize:
    """Return an upper bound for the size of all scenes in a file.

    Raises ValueError if a node contains itself.
    """
    return _Scene(document).size()


class _Scene:
    """Sizes of all elements in a file, computed once for each element."""

    def __init__(self, document: ElementTree.Element) -> None:
        """List the nodes and geometries of a file by their id."""
        self._document = document
        # nodes and geometries; a broken file may use one id several times
        self._elements_by_id: Dict[str, List[ElementTree.Element]] = {}
        for element in document.iter():
            if _tag(element) in ("node", "geometry"):
                self._elements_by_id.setdefault(element.get("id", ""), []).append(element)
        self._sizes: Dict[ElementTree.Element, SceneSize] = {}  # sizes that are known so far
        # Elements whose sizes are being computed. If the size of an element is needed to compute the size of
        # the same element, the element contains itself, which is an error of the file.
        self._unfinished: Set[ElementTree.Element] = set()

    def size(self) -> SceneSize:
        """Return the size of all scenes in the file together."""
        scenes = [element for element in self._document.iter() if _tag(element) == "visual_scene"]
        return _sum([self._size_of(scene) for scene in scenes])

    def _size_of(self, element: ElementTree.Element) -> SceneSize:
        """Return the size of a scene, node, instance or geometry with its content; 0 for other elements.

        Raises ValueError if a node contains itself.
        """
        if element in self._sizes:
            return self._sizes[element]
        if element in self._unfinished:
            raise ValueError(f"node '{element.get('id')}' contains itself")
        self._unfinished.add(element)
        tag = _tag(element)
        if tag == "geometry":
            size = SceneSize(nodes=0, corners=sum(map(_corners, element.iter())))
        elif tag in ("instance_node", "instance_geometry"):
            targets = self._elements_by_id.get(element.get("url", "").lstrip("#"), [])
            # in a broken file, several elements have this id, and the COLLADA reader uses any one of them, so
            # the largest numbers count
            sizes = [self._size_of(target) for target in targets]
            size = SceneSize(
                nodes=max((each.nodes for each in sizes), default=0),
                corners=max((each.corners for each in sizes), default=0),
            )
        elif tag in ("node", "visual_scene"):
            itself = SceneSize(nodes=1, corners=0)
            size = _sum([itself, *(self._size_of(child) for child in element)])
        else:
            size = NOTHING
        self._unfinished.remove(element)
        self._sizes[element] = size
        return size


def _sum(sizes: List[SceneSize]) -> SceneSize:
    """Return the size of several parts together."""
    return SceneSize(nodes=sum(each.nodes for each in sizes), corners=sum(each.corners for each in sizes))


def _corners(primitive: ElementTree.Element) -> int:
    """Return an upper bound for the corners of a primitive, such as <triangles>; 0 for other elements.

    A primitive lists its corners as indices in its elements <p>. Each corner takes the same number of
    indices, such as one for the position and one for the normal.
    """
    # the `offset` of an <input> is the place of its index among the indices of a corner, counted from 0
    offsets = [child.get("offset", "0") for child in primitive if _tag(child) == "input"]
    indices_per_corner = 1 + max((int(offset) for offset in offsets if offset.isdigit()), default=0)
    indices = 0
    for child in primitive:
        if _tag(child) == "p":
            text = child.text or ""
            # Counting spaces is faster than reading the numbers. Spaces separate the numbers, so there is at
            # most one number more than there are spaces. Each number takes at least two characters, which are
            # a digit and a space.
            spaces = sum(map(text.count, " \t\r\n"))
            indices += min(spaces + 1, (len(text) + 1) // 2)
    return indices // indices_per_corner


def _tag(element: ElementTree.Element) -> str:
    """Return the name of an element without its XML namespace, which stands in front as {NAMESPACE}."""
    return str(element.tag).rpartition("}")[2]
