"""SDF parser: XML elements, and the place of each element in its file, for messages.

In: bytes or text of an SDF file. Out: `Node`s to read numbers and names from.

An element that is left out, or read in another way than it is written, gets a note. The notes are collected,
and logged as warnings when the file has been read. An element that must not be left out raises WorldError.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, inf, isfinite, radians
from typing import Callable, Dict, Iterator, List, Optional, Set, Tuple, TypeVar, Union
from xml.etree import ElementTree

from husky_highlevel_controller.datatypes import IDENTITY, Pose
from husky_highlevel_controller.geometry import quat_from_rpy
from husky_highlevel_controller.simulator.models.mesh_file import MeshFiles
from husky_highlevel_controller.simulator.models.sdf_xml import WorldError, parse_xml

VERSIONS = tuple(f"1.{minor}" for minor in range(3, 13))  # versions of SDF that can be read
NEWEST = 7  # minor version: SDF 1.7 is the newest version that is read completely

# For each element, the children that cause no warning, because they are read, or because a simulation without
# them is the same.
KNOWN = {
    "sdf": "world",
    "world": "model include frame state gravity physics light scene gui audio spherical_coordinates"
    " atmosphere magnetic_field",
    "include": "uri name pose static",
    "model": "pose static link model include frame joint self_collide allow_auto_disable enable_wind",
    "link": "pose inertial collision visual light gravity kinematic self_collide must_be_base_link"
    " velocity_decay enable_wind audio_source audio_sink",
    "inertial": "mass pose inertia",
    "collision": "pose geometry surface max_contacts laser_retro",
    "visual": "pose geometry material transparency cast_shadows laser_retro visibility_flags meta",
    "material": "script ambient diffuse specular emissive lighting shader",
}


Value = TypeVar("Value")


@dataclass
class Load:
    """State while one world or model is read: files, names that are in use, and notes for warnings."""

    # For each sentence of a warning, the places in the file that the sentence is about. Each place is stored
    # under the id of its element, so that an element that is read twice is named only once.
    notes: Dict[str, Dict[int, str]] = field(default_factory=dict)
    names: Set[str] = field(default_factory=set)  # names of models and bodies that are already used
    files: Dict[str, Node] = field(default_factory=dict)  # element <sdf> of each model file, by path
    # element <model> for each <include> that was read; None if the <include> adds no model
    included: Dict[ElementTree.Element, Optional[Node]] = field(default_factory=dict)
    # paths of the model files that are being read, each included by the file before it
    open_files: List[str] = field(default_factory=list)
    meshes: MeshFiles = field(default_factory=MeshFiles)
    # number of models in the world, also of models that are left out; ground planes do not count
    model_count: int = 0
    # number of shapes and models that are left out, for the warning that the lidar sees nothing. A <visual>
    # counts, too, although the lidar never sees a <visual>. The number need not be exact, because it is only
    # compared with 0.
    missed_by_lidar: int = 0
    include_count: int = 0  # number of included models so far; a model that is included twice counts twice


@dataclass(frozen=True)
class Node:
    """An XML element, and its place for messages: file, line, and the elements around it."""

    element: ElementTree.Element
    load: Load  # state of the world or model that is read
    source: str  # path of the file, or another name of the text
    trail: str = ""  # names of the element and of the elements around it, such as "model 'a' > link 'b'"

    @property
    def tag(self) -> str:
        """The element's name."""
        return self.element.tag

    @property
    def text(self) -> str:
        """Text of the element, without the space around the text."""
        return (self.element.text or "").strip()

    @property
    def where(self) -> str:
        """File, line and trail, for messages."""
        place = f"{self.source}:{getattr(self.element, 'line', 0)}"
        return f"{place}: {self.trail}" if self.trail else place

    def error(self, problem: str) -> WorldError:
        """Return an error about this element, to be raised."""
        return WorldError(f"{self.where}: {problem}")

    def note(self, sentence: str, value: str = "") -> None:
        """Add a note about this element; `value` is the part of its text that the note is about.

        Notes with the same sentence become one warning, which lists their places.
        """
        self._note_at(sentence, f"{self.where} '{value}'" if value else self.where)

    def _note_at(self, sentence: str, place: str) -> None:
        """Add a note about this element, with a text that says where the element is."""
        self.load.notes.setdefault(sentence, {})[id(self.element)] = place

    def unless_broken(self, read: Callable[[], Value], default: Value, sentence: str) -> Value:
        """Return the value that `read` returns; if `read` raises WorldError, add a note and return `default`.

        This is for elements that the simulation does not need, such as a colour.

        Args:
            read: function that reads a value of this element.
            default: value that is used if the element is broken.
            sentence: note, which says what is done instead; the text of the error is added.
        """
        try:
            return read()
        except WorldError as error:
            self._note_at(sentence, str(error))
            return default

    def note_unknown(self) -> None:
        """Add a note for every child that KNOWN does not list for this element."""
        known_tags = KNOWN[self.tag].split()
        for child in self.children():
            # Gazebo saves an empty <wind> in every world
            is_default_wind = child.tag == "wind" and not len(child.element)
            if child.tag not in known_tags and not is_default_wind:
                child.note(f"<{child.tag}> is not supported and is left out")

    def children(self, tag: Optional[str] = None) -> Iterator[Node]:
        """Yield all children, or only the children with one tag."""
        for element in self.element:
            if tag is not None and element.tag != tag:
                continue
            name = element.get("name")
            label = element.tag if name is None else f"{element.tag} '{name}'"
            trail = f"{self.trail} > {label}" if self.trail else label
            if element.tag == "world":
                trail = ""  # only one <world> of a file is read, so messages need not name it
            yield Node(element, self.load, self.source, trail)

    def child(self, tag: str) -> Optional[Node]:
        """Return the first child with a tag, or None."""
        return next(self.children(tag), None)

    def required(self, tag: str) -> Node:
        """Return the first child with a tag. Raises WorldError if there is no such child."""
        child = self.child(tag)
        if child is None:
            raise self.error(f"<{self.tag}> needs a <{tag}>")
        return child

    def named(self) -> str:
        """Return the name of the element.

        An element without a name gets one from its tag and line, and a note.
        """
        name = self.element.get("name", "").strip()
        if not name:
            name = f"{self.tag}_at_line_{getattr(self.element, 'line', 0)}"
            self.note(f"a <{self.tag}> without a name gets one", name)
        return name

    def numbers(self, *counts: int) -> Tuple[float, ...]:
        """Return the finite numbers in the text. Raises WorldError if their number is not in `counts`."""
        values = self._finite_numbers()
        if len(values) not in counts:
            amount = " or ".join(str(count) for count in counts)
            plural = "" if counts == (1,) else "s"
            raise self.error(f"needs {amount} finite number{plural}, not '{self.text}'")
        return values

    def _finite_numbers(self) -> Tuple[float, ...]:
        """Return the numbers in the text; empty if a word of the text is not a finite number."""
        try:
            values = tuple(map(float, self.text.split()))
        except ValueError:
            return ()
        return values if all(map(isfinite, values)) else ()

    def pose(self) -> Pose:
        """Return the pose that the text of a <pose> gives: x, y, z, roll, pitch, yaw; the identity if empty.

        The frame of the pose is not considered here, see `FrameScope.pose_of`. As in Gazebo, missing numbers
        are read as 0 and numbers after the sixth are left out, with a note.

        Raises:
            WorldError: a number of the pose is not finite.
        """
        if not self.text:
            return IDENTITY
        if self.element.get("rotation_format") == "quat_xyzw":  # SDF 1.9
            return self._quaternion_pose()
        # `_finite_numbers` is empty if a word is not a finite number; then `numbers` raises the error
        values = self._finite_numbers() or self.numbers(6)
        if len(values) != 6:
            self.note(
                "a <pose> needs 6 numbers; missing ones are read as 0, further ones are left out", self.text
            )
        x, y, z, *angles = (*values, *[0.0] * 6)[:6]  # zeros are added, and then the first 6 numbers count
        if self.element.get("degrees") in ("1", "true"):  # SDF 1.9
            angles = list(map(radians, angles))
        return Pose((x, y, z), quat_from_rpy(*angles))

    def _quaternion_pose(self) -> Pose:
        """Return the pose that the text gives as x, y, z and a quaternion xyzw of any length."""
        x, y, z, *quat = self.numbers(7)
        length = hypot(*quat)
        if not 0.0 < length < inf:
            raise self.error(f"needs a rotation in its last four numbers, not '{self.text}'")
        qx, qy, qz, qw = (part / length for part in quat)
        return Pose((x, y, z), (qx, qy, qz, qw))

    def positive(self, count: int = 1) -> Tuple[float, ...]:
        """Return the numbers in the text. Raises WorldError unless they are `count` numbers above zero."""
        values = self.numbers(count)
        if min(values) <= 0.0:
            raise self.error(f"must be greater than zero, not '{self.text}'")
        return values

    def flag(self) -> bool:
        """Return the truth value in the text. Raises WorldError for any other text."""
        values = {"1": True, "true": True, "0": False, "false": False}
        if self.text.lower() not in values:
            raise self.error(f"must be true, false, 1 or 0, not '{self.text}'")
        return values[self.text.lower()]


def minor_version(where: str, version: str) -> int:
    """Return the number behind the dot of an SDF version, such as 7 for 1.7.

    Raises WorldError if VERSIONS does not have the version.
    """
    if version not in VERSIONS:
        raise WorldError(
            f"{where}: SDF version '{version}' is not supported; {VERSIONS[0]} to {VERSIONS[-1]} are"
        )
    return int(version.partition(".")[2])


def open_sdf(data: Union[str, bytes], source: str, load: Load) -> Node:
    """Return the element <sdf> of a file. Raises WorldError if the file is not SDF of one of VERSIONS."""
    root = Node(parse_xml(data, source), load, source)
    if root.tag != "sdf":
        raise root.error(f"needs <sdf> as its outermost element, not <{root.tag}>")
    minor = minor_version(root.where, root.element.get("version", ""))
    if minor < 4:
        root.note("SDF 1.3 is read as SDF 1.4")
    elif minor > NEWEST:
        root.note(f"newer SDF is read as SDF 1.{NEWEST}", root.element.get("version", ""))
    return root
