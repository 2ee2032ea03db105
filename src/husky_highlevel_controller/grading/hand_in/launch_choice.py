"""Launch file of a hand-in, found by its content: it starts a node of the hand-in, in the pillar's world."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, Dict, FrozenSet, Iterator, List, Optional, Sequence, Tuple

from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from husky_highlevel_controller.grading.hand_in.packages import (
    Contents,
    NotMarkableError,
    Package,
    copies_of_known,
    fits_exercise,
)
from husky_highlevel_controller.grading.isolation.files import (
    UnreadableFileError,
    is_below,
    is_regular,
    read_regular,
    walk,
)

MAX_LAUNCH = 1_000_000  # [bytes]
MAX_DEPTH = 8  # of includes
MAX_READS = 1000  # launch files that are read for one hand-in, includes counted each time
MAX_VALUE = 10_000  # letters of an attribute whose arguments are put in
PILLAR = re.compile(r"single_?pillar", re.IGNORECASE)
OTHER_USE = re.compile(  # trials, leftovers, and the course's exercise on localization
    r"test|example|demo|tutorial|template|turtle|old|backup|copy|ekf|locali[sz]|slam|mapping|bag",
    re.IGNORECASE,
)
FILTER = "robot_localization"  # package whose node exercise 4 is about; a bag is played to it
CONTROLLER = re.compile(r"high_?level|pillar|controller", re.IGNORECASE)
SCAN = re.compile(rb"LaserScan|PointCloud2")
SOURCES = {"", ".py", ".cpp", ".cc", ".cxx", ".hpp", ".h"}
UNREADABLE = (  # no XML, entities, an unknown encoding, elements nested deeper than any launch file's
    UnreadableFileError, ElementTree.ParseError, DefusedXmlException, ValueError, LookupError, RecursionError,
)  # fmt: skip
_ARGUMENT = re.compile(r"\$\(arg\s+([\w-]+)\s*\)")
_FIND = re.compile(r"\$\(find\s+([\w-]+)\s*\)")


@dataclass(frozen=True)
class LaunchFile:
    """A launch file of a hand-in, and what it starts."""

    path: Path
    place: PurePosixPath  # in the hand-in
    package: str  # that it lies in; else of the first node it starts that is the hand-in's
    nodes: Tuple[str, ...] = ()  # package/type, of the hand-in's packages
    uses: FrozenSet[str] = frozenset()  # packages of the hand-in that it names
    pillar: bool = False  # it names the course's world
    rviz: bool = False  # it starts RViz
    scans: bool = False  # a package of its nodes names the lidar's messages


def choose_launch_files(contents: Contents, packages: Sequence[Package], exercise: int) -> List[LaunchFile]:
    """Launch files that start a node of the hand-in, the one that fits best first.

    Raises:
        NotMarkableError: there is none.
    """
    copies = copies_of_known(contents.packages)
    reader = _Reader(*({each.name: each.path for each in group} for group in (packages, copies)))
    if exercise == 4:
        reader.counted = {FILTER, "rosbag"}
    places = list(_launch_files(contents, [*packages, *copies]))
    scanning = {name for name, folder in reader.folders.items() if _names_scans(folder)}
    fitting = [
        replace(file, scans=bool({node.partition("/")[0] for node in file.nodes} & scanning))
        for file in (reader.read(path, place) for path, place in places)
        if file.nodes
    ]
    if not fitting:
        names = ", ".join(sorted(str(place) for _, place in places)[:20]) or "none"
        what = "ekf_localization_node" if exercise == 4 else "a node of the hand-in"
        raise NotMarkableError(f"no launch file starts {what}; launch files: {names}")
    return sorted(fitting, key=lambda file: _rank(file, exercise))


def reasons(launch: LaunchFile, candidates: Sequence[LaunchFile], exercise: int) -> str:
    """A sentence that says why a launch file was chosen."""
    words = [f"starts {', '.join(launch.nodes)}"]
    if fits_exercise(launch.place, exercise) == 2:
        words.append(f"is named for exercise {exercise}")
    words += ["uses the world singlePillar"] * launch.pillar + ["starts RViz"] * launch.rviz
    choice = f" (chosen of {len(candidates)})" if len(candidates) > 1 else ""
    return f"launch file {launch.place}: {', '.join(words)}{choice}"


def _names_scans(folder: Path) -> bool:
    """Whether a source file of a package names the lidar's messages."""
    for path in walk(folder):
        if path.suffix in SOURCES:
            with contextlib.suppress(UnreadableFileError):
                if SCAN.search(read_regular(path, MAX_LAUNCH)):
                    return True
    return False


def named_launch_file(contents: Contents, packages: Sequence[Package], name: str) -> LaunchFile:
    """The launch file that a teacher named, by its place or the end of it.

    Raises:
        NotMarkableError: there is none, or more than one.
    """
    words = PurePosixPath(name).parts
    matches = [file for file in _launch_files(contents, packages) if file[1].parts[-len(words) :] == words]
    if len(matches) != 1:
        raise NotMarkableError(f"marking.yaml names the launch file {name!r}: {len(matches)} fit it")
    return _Reader({package.name: package.path for package in packages}).read(*matches[0])


def _launch_files(contents: Contents, packages: Sequence[Package]) -> Iterator[Tuple[Path, PurePosixPath]]:
    """Launch files inside the packages, and beside them in the folders above."""
    files = set()
    for package in packages:
        for path in walk(package.path):
            if path.name.endswith(".launch"):
                files.add(path)
                yield path, package.place / path.relative_to(package.path).as_posix()
        for root, place in contents.places.items():
            for folder in package.path.parents:
                if folder != root and root not in folder.parents:
                    break
                for path in sorted([*folder.glob("*.launch"), *folder.glob("launch/*.launch")]):
                    if (
                        path not in files
                        and path.is_file()
                        and not path.is_symlink()
                        and is_below(path, root)
                    ):
                        files.add(path)
                        yield path, place / path.relative_to(root).as_posix()


def _rank(file: LaunchFile, exercise: int) -> Tuple[Any, ...]:
    """Smaller is better. The pillar is exercise 3's world, so that it says less of another exercise."""
    fits, name = fits_exercise(file.place, exercise), str(file.place)
    content = (not file.pillar, not file.scans, not CONTROLLER.search(name))
    order = (content, -fits) if exercise == 3 else (-fits, content)
    starts_filter = any(node.startswith(f"{FILTER}/") for node in file.nodes)
    other_use = not starts_filter if exercise == 4 else bool(OTHER_USE.search(file.place.name))
    return (
        fits == 0, other_use, *order, not CONTROLLER.search(file.place.name),
        not file.rviz, len(file.place.parts), name,
    )  # fmt: skip


class _Reader:
    """Reads launch files and what they include, MAX_READS files in all."""

    def __init__(self, folders: Dict[str, Path], copies: Optional[Dict[str, Path]] = None) -> None:
        self.folders = folders  # of the hand-in's packages
        self._copies = copies or {}  # folders of packages that are not the student's own
        self._reads = 0
        self.counted = set(folders)  # packages whose nodes are looked for

    def read(self, path: Path, place: PurePosixPath) -> LaunchFile:
        """Nodes and packages of a launch file."""
        self._nodes: List[str] = []
        self._uses: List[str] = []
        self._pillar = self._rviz = False
        self._read(path, {}, 0)
        nodes = tuple(dict.fromkeys(self._nodes))
        uses = frozenset(self._uses) & frozenset(self.folders) if nodes else frozenset()
        inside = [name for name, folder in self.folders.items() if folder in path.parents]
        owners = [node.partition("/")[0] for node in nodes]
        package, *_ = [*inside, *(name for name in owners if name in self.folders), *self.folders]
        return LaunchFile(path, place, package, nodes, uses, self._pillar, self._rviz)

    def _read(self, path: Path, arguments: Dict[str, str], depth: int) -> None:
        self._reads += 1
        if self._reads <= MAX_READS:
            with contextlib.suppress(*UNREADABLE):
                root = ElementTree.fromstring(read_regular(path, MAX_LAUNCH))
                self._visit(root, path, dict(arguments), depth)

    def _visit(self, element: Any, path: Path, arguments: Dict[str, str], depth: int) -> None:
        if not _is_on(element, arguments):
            return
        if element.tag == "arg":
            arguments.setdefault(element.get("name", ""), element.get("value", element.get("default", "")))
        for value in element.attrib.values():
            value = _substituted(value, arguments)
            self._uses += _FIND.findall(value)
            self._pillar |= bool(PILLAR.search(value))
        if element.tag == "node":
            package = element.get("pkg", "")
            self._rviz |= package == "rviz"
            if package in self.counted:
                self._uses.append(package)
                self._nodes.append(f"{package}/{element.get('type', '')}")
        if element.tag != "include":
            for child in element:
                self._visit(child, path, arguments, depth)
        elif depth < MAX_DEPTH:
            folders = {**self._copies, **self.folders}
            file = _included(_substituted(element.get("file", ""), arguments), path, folders)
            values = {
                arg.get("name", ""): _substituted(arg.get("value", ""), arguments)
                for arg in element.iter("arg")
            }
            self._pillar |= any(map(PILLAR.search, values.values()))
            if file is not None:
                self._read(file, values, depth + 1)


def _included(file: str, path: Path, folders: Dict[str, Path]) -> Optional[Path]:
    """An included file of the hand-in's own."""
    package = _FIND.match(file)
    if package and package.group(1) in folders:
        inside, target = folders[package.group(1)], file[package.end() :]
    elif file.startswith("$(dirname)"):
        inside, target = path.parent, file[len("$(dirname)") :]
    else:
        return None
    place = inside / target.lstrip("/")
    return place if ".." not in place.parts and is_regular(place) and is_below(place, inside) else None


def _substituted(text: str, arguments: Dict[str, str]) -> str:
    value = _ARGUMENT.sub(lambda match: arguments.get(match.group(1), match.group()), text[:MAX_VALUE])
    return value[:MAX_VALUE]


def _is_on(element: Any, arguments: Dict[str, str]) -> bool:
    """Whether `if` and `unless` let an element be; what cannot be worked out here counts as on."""
    condition = _substituted(element.get("if", "true"), arguments).strip().lower()
    exception = _substituted(element.get("unless", "false"), arguments).strip().lower()
    return condition not in ("false", "0") and exception not in ("true", "1")
