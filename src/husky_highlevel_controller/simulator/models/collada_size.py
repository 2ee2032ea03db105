"""Size of a COLLADA scene with all its instances, counted without making them.

In: the XML of a .dae file. Out: numbers of nodes and corners.

A node may be an instance of a node that has several instances, and so on. So a few lines of XML can stand for
more nodes than any memory holds.
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
    """Return an upper bound for the size of all scenes in a file. ValueError if a node contains itself."""
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
        # elements whose sizes are being computed, each inside the element before it
        self._unfinished: Set[ElementTree.Element] = set()

    def size(self) -> SceneSize:
        return _sum([self._size_of(each) for each in self._document.iter() if _tag(each) == "visual_scene"])

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
            # several elements may have this id, and the COLLADA reader uses any one of them, so the largest
            # size counts; NOTHING counts if there is no such element
            sizes = [self._size_of(target) for target in targets]
            size = SceneSize(*(max(numbers) for numbers in zip(NOTHING, *sizes)))
        elif tag in ("node", "visual_scene"):
            itself = SceneSize(nodes=1, corners=0)
            size = _sum([itself, *map(self._size_of, element)])
        else:
            size = NOTHING
        self._unfinished.remove(element)
        self._sizes[element] = size
        return size


def _sum(sizes: List[SceneSize]) -> SceneSize:
    return SceneSize(*map(sum, zip(NOTHING, *sizes)))


def _corners(primitive: ElementTree.Element) -> int:
    """Return an upper bound for the corners of a primitive, such as <triangles>; 0 for other elements.

    The bound is the number of indices in all <p>, divided by the number of indices that each corner takes.
    """
    # each corner has several indices, such as position and normal; the `offset` of an <input> is the place of
    # its index, counted from 0
    offsets = [child.get("offset", "0") for child in primitive if _tag(child) == "input"]
    indices_per_corner = 1 + max((int(offset) for offset in offsets if offset.isdigit()), default=0)
    indices = 0
    for child in primitive:
        if _tag(child) == "p":
            text = child.text or ""
            # the text has at most one number more than spaces, and each number takes at least two characters
            # (a digit and a space)
            spaces = sum(map(text.count, " \t\r\n"))
            indices += min(spaces + 1, (len(text) + 1) // 2)
    return indices // indices_per_corner


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]
