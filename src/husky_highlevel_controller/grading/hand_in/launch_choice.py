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
    fits_exercise,
)
from husky_highlevel_controller.grading.isolation.files import (
    UnreadableFileError,
    is_regular,
    read_regular,
    walk,
)

MAX_LAUNCH = 1_000_000  # [bytes]
MAX_DEPTH = 8  # of includes
MAX_READS = 1000  # launch files that are read for one hand-in, includes counted each time
MAX_VALUE = 10_000  # letters of an attribute whose arguments are put in
PILLAR = re.compile(r"single_?pillar", re.IGNORECASE)
TRIAL = re.compile(r"test|example|demo|tutorial|template|turtle|old|backup|copy", re.IGNORECASE)
CONTROLLER = re.compile(r"high_?level|pillar|controller", re.IGNORECASE)
SCAN = re.compile(rb"LaserScan|PointCloud2")
SOURCES = {"", ".py", ".cpp", ".cc", ".cxx", ".hpp", ".h"}
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


@dataclass
class _Seen:
    nodes: List[str]
    uses: List[str]
    pillar: bool = False
    rviz: bool = False


@dataclass
class _Budget:
    reads: int = MAX_READS


def choose_launch_files(contents: Contents, packages: Sequence[Package], exercise: int) -> List[LaunchFile]:
    """Launch files that start a node of the hand-in, the one that fits best first.

    Raises:
        NotMarkableError: there is none.
    """
    folders = {package.name: package.path for package in packages}
    found = list(_launch_files(contents, packages))
    budget = _Budget()
    scanning = {name for name, folder in folders.items() if _names_scans(folder)}
    fitting = [
        replace(read, scans=bool({node.partition("/")[0] for node in read.nodes} & scanning))
        for read in (_read(path, place, folders, budget) for path, place in found)
        if read is not None
    ]
    if not fitting:
        names = ", ".join(sorted(str(place) for _, place in found)[:20]) or "none"
        raise NotMarkableError(f"no launch file starts a node of the hand-in; launch files: {names}")
    return sorted(fitting, key=lambda each: _rank(each, exercise))


def reasons(chosen: LaunchFile, candidates: Sequence[LaunchFile], exercise: int) -> str:
    """A sentence that says why a launch file was chosen."""
    words = [f"starts {', '.join(chosen.nodes)}"]
    if fits_exercise(chosen.place, exercise) == 2:
        words.append(f"is named for exercise {exercise}")
    words += ["uses the world singlePillar"] * chosen.pillar + ["starts RViz"] * chosen.rviz
    others = f" (chosen of {len(candidates)})" if len(candidates) > 1 else ""
    return f"launch file {chosen.place}: {', '.join(words)}{others}"


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
    folders = {package.name: package.path for package in packages}
    wanted = PurePosixPath(name).parts
    fitting = [
        (path, place)
        for path, place in _launch_files(contents, packages)
        if place.parts[-len(wanted) :] == wanted
    ]
    if len(fitting) != 1:
        raise NotMarkableError(f"marking.yaml names the launch file {name!r}: {len(fitting)} fit it")
    path, place = fitting[0]
    read = _read(path, place, folders, _Budget())
    if read is not None:
        return read
    inside = [name for name, folder in folders.items() if folder in path.parents]
    return LaunchFile(path, place, (inside or list(folders))[0])


def _launch_files(contents: Contents, packages: Sequence[Package]) -> Iterator[Tuple[Path, PurePosixPath]]:
    """Launch files inside the packages, and beside them in the folders above."""
    seen = set()
    for package in packages:
        for path in walk(package.path):
            if path.name.endswith(".launch"):
                seen.add(path)
                yield path, package.place / path.relative_to(package.path).as_posix()
        for root, place in contents.places.items():
            if root not in package.path.parents:
                continue
            for folder in (
                parent for parent in package.path.parents if parent == root or root in parent.parents
            ):
                for path in sorted([*folder.glob("*.launch"), *folder.glob("launch/*.launch")]):
                    if path not in seen and path.is_file() and not path.is_symlink():
                        seen.add(path)
                        yield path, place / path.relative_to(root).as_posix()


def _rank(file: LaunchFile, exercise: int) -> Tuple[Any, ...]:
    """Smaller is better. The pillar is exercise 3's world, so that it says less of another exercise."""
    fits, name = fits_exercise(file.place, exercise), str(file.place)
    content = (not file.pillar, not file.scans, not CONTROLLER.search(name))
    order = (content, -fits) if exercise == 3 else (-fits, content)
    return (
        fits == 0, bool(TRIAL.search(file.place.name)), *order, not file.rviz, len(file.place.parts), name,
    )  # fmt: skip


def _read(
    path: Path, place: PurePosixPath, folders: Dict[str, Path], budget: _Budget
) -> Optional[LaunchFile]:
    """Nodes and packages of a launch file; None if it starts no node of the hand-in."""
    seen = _Seen([], [])
    with contextlib.suppress(RecursionError):  # elements nested deeper than any launch file's
        _look_into(path, folders, {}, seen, budget, 0)
    if not seen.nodes:
        return None
    nodes = tuple(dict.fromkeys(seen.nodes))
    uses = frozenset(seen.uses) & frozenset(folders)
    inside = [name for name, folder in folders.items() if folder in path.parents]
    file = LaunchFile(path, place, (inside or [nodes[0].partition("/")[0]])[0], nodes, uses)
    return replace(file, pillar=seen.pillar, rviz=seen.rviz)


def _look_into(
    path: Path, folders: Dict[str, Path], arguments: Dict[str, str], seen: _Seen, budget: _Budget, depth: int
) -> None:
    budget.reads -= 1
    if budget.reads < 0:
        return
    try:
        content = read_regular(path, MAX_LAUNCH)
        root = ElementTree.fromstring(content)
    except (UnreadableFileError, ElementTree.ParseError, DefusedXmlException):
        return
    except (ValueError, LookupError, RecursionError):
        return
    arguments = dict(arguments)

    def visit(element: Any) -> None:
        if not _is_on(element, arguments):
            return
        if element.tag == "arg":
            default = element.get("value", element.get("default", ""))
            arguments.setdefault(element.get("name", ""), default)
        for value in element.attrib.values():
            value = _substituted(value, arguments)
            seen.uses += _FIND.findall(value)
            seen.pillar |= bool(PILLAR.search(value))
        if element.tag == "node":
            package = element.get("pkg", "")
            seen.rviz |= package == "rviz"
            if package in folders:
                seen.uses.append(package)
                seen.nodes.append(f"{package}/{element.get('type', '')}")
        if element.tag == "include" and depth < MAX_DEPTH:
            file = _included(_substituted(element.get("file", ""), arguments), path, folders)
            passed = {
                arg.get("name", ""): _substituted(arg.get("value", ""), arguments)
                for arg in element.iter("arg")
            }
            for arg in element.iter("arg"):
                seen.pillar |= bool(PILLAR.search(_substituted(arg.get("value", ""), arguments)))
            if file is not None:
                _look_into(file, folders, passed, seen, budget, depth + 1)
            return
        for child in element:
            visit(child)

    visit(root)


def _included(file: str, path: Path, folders: Dict[str, Path]) -> Optional[Path]:
    """An included file of the hand-in's own."""
    found = _FIND.match(file)
    if found and found.group(1) in folders:
        inside = folders[found.group(1)]
        target = inside / file[found.end() :].lstrip("/")
    elif file.startswith("$(dirname)"):
        inside, target = path.parent, path.parent / file[len("$(dirname)") :].lstrip("/")
    else:
        return None
    return target if ".." not in target.parts and is_regular(target) else None


def _substituted(text: str, arguments: Dict[str, str]) -> str:
    value = _ARGUMENT.sub(lambda match: arguments.get(match.group(1), match.group()), text[:MAX_VALUE])
    return value[:MAX_VALUE]


def _is_on(element: Any, arguments: Dict[str, str]) -> bool:
    """Whether `if` and `unless` let an element be; what cannot be worked out here counts as on."""
    condition = _substituted(element.get("if", "true"), arguments).strip().lower()
    exception = _substituted(element.get("unless", "false"), arguments).strip().lower()
    return condition not in ("false", "0") and exception not in ("true", "1")
