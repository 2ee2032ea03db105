"""Packages of a hand-in: unpacked, found by their manifests, and those that belong to an exercise."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, Dict, FrozenSet, List, Mapping, Sequence, Set, Tuple

from husky_grading.hand_in.archives import Allowance, ArchiveError, suffix_of, unpack
from husky_grading.isolation.files import (
    UnreadableFileError,
    file_suffix,
    read_text,
    read_xml,
    walk,
)
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.dependencies import dependencies_of

MAX_ARCHIVES, MAX_PACKAGES = 50, 200  # inside of one hand-in
MAX_MANIFEST = 1_000_000  # [bytes]
BUILT = frozenset({"build", "devel", "install", "logs", ".git", "__pycache__", "__MACOSX", ".catkin_tools"})
# packages that courses hand out or that Debian and the robot bring: a copy of one is not the student's work
KNOWN = frozenset({
    "teleop_twist_keyboard", "teleop_twist_joy", "ros_package_template", "rqt_multiplot", "joy",
    "husky_base", "husky_bringup", "husky_control", "husky_description", "husky_desktop", "husky_gazebo",
    "husky_msgs", "husky_navigation", "husky_robot", "husky_simulator", "husky_viz",
    "smb_common", "smb_control", "smb_description", "smb_gazebo",
})  # fmt: skip
COPIED = {"husky_gazebo", "smb_gazebo"}  # to put one's own worlds and launch files into
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,99}")  # it becomes the name of folders and files
_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)
_ATTRIBUTE = re.compile(r"""\b(pkg|type)\s*=\s*["']([^"']*)""")
_NUMBERS = {"one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6}
# also as it is misspelt
_WORD = (
    r"(?:exc?er[cs]i[cs]es?|exo|exe?|course|session|uebung|\u00fcbung|aufgabe|task|homework|hw|lab|tp|sheet)"
)
_COUNT = r"0*([1-9]\d?|" + "|".join(_NUMBERS) + r")(?![\da-z])"
# exercise_3, Ex3, 5th_ex, or a number alone; but ENSTA's session 2 is the pillar's
_EXERCISE = re.compile(
    rf"(?<![a-z])(?!session[ _.-]*0*2(?!\d)){_WORD}[ _.-]*(?:no|nr|n)?[ _.-]*{_COUNT}"
    rf"|(?<!\d)([1-9]\d?)(?:st|nd|rd|th)[ _.-]*{_WORD}(?![a-z])|\A{_COUNT}\Z"
)


class NotMarkableError(HuskyError):
    """A hand-in that cannot be marked; it gets no points, and is not 0 points either."""


@dataclass(frozen=True)
class Package:
    """Catkin package of a hand-in."""

    name: str
    path: Path
    place: PurePosixPath  # in the hand-in, through archives; "." is the hand-in itself
    needs: FrozenSet[str] = frozenset()  # names of packages that its manifest depends on


@dataclass(frozen=True)
class Contents:
    """Packages of a hand-in, and notes."""

    packages: Tuple[Package, ...]
    # of its folder, or that of the unpacked archive, and of those of archives in it
    places: Mapping[Path, PurePosixPath] = field(default_factory=dict)
    notes: Tuple[str, ...] = ()


def open_hand_in(path: Path, scratch: Path) -> Contents:
    """Unpack a folder's archives, or an archive, into an existing, empty folder, and find every package.

    Raises:
        NotMarkableError: it cannot be read.
    """
    allowance = Allowance()
    notes: List[str] = []
    try:
        root = path
        if path.is_file():
            root = scratch / "hand_in"
            root.mkdir()
            notes += unpack(path, root, allowance)
        places = {root: PurePosixPath(".")}
        folders = [root]
        for folder in folders:  # which grow: archives hold archives
            for archive in (path for path in walk(folder, BUILT) if suffix_of(path.name)):
                if len(folders) > MAX_ARCHIVES:
                    break
                unpacked = scratch / str(len(folders))
                unpacked.mkdir()
                try:
                    notes += unpack(archive, unpacked, allowance)
                except ArchiveError as error:
                    notes.append(str(error))
                places[unpacked] = places[folder] / archive.relative_to(folder).as_posix()
                folders.append(unpacked)
        packages = [each for folder, place in places.items() for each in _packages(folder, place, notes)]
    except (ArchiveError, UnreadableFileError, OSError) as error:
        raise NotMarkableError(f"it cannot be read: {error}") from error
    if len(packages) > MAX_PACKAGES:
        raise NotMarkableError(f"it holds {len(packages)} packages, more than {MAX_PACKAGES}")
    return Contents(tuple(packages), places, tuple(notes))


def _packages(folder: Path, place: PurePosixPath, notes: List[str]) -> List[Package]:
    """Packages below a folder, outer ones first; what lies inside of one belongs to it."""
    manifests = [path for path in walk(folder, BUILT) if path.name == "package.xml"]
    packages: Dict[Path, Package] = {}
    for manifest in sorted(manifests, key=lambda path: (len(path.parts), path)):
        path = manifest.parent
        if any(parent in packages for parent in path.parents):
            continue
        package_place = place / path.relative_to(folder).as_posix()
        try:
            name, needs = read_manifest(manifest)
        except NotMarkableError as error:
            # a student reads it: by the place in the hand-in, not by this machine's path
            notes.append(str(error).replace(str(manifest), str(package_place / "package.xml")))
            continue
        packages[path] = Package(name, path, package_place, needs)
    return list(packages.values())


def read_manifest(path: Path) -> Tuple[str, FrozenSet[str]]:
    """Name and dependencies in a package.xml.

    Raises:
        NotMarkableError: it cannot be read, or its name is not the name of a package.
    """
    try:
        root = read_xml(path, MAX_MANIFEST)
    except UnreadableFileError as error:
        raise NotMarkableError(str(error)) from error
    name = str(root.findtext("name") or "").strip()
    if not _NAME.fullmatch(name):
        shown = f"{name[:80]!r}" + (f" and {len(name) - 80} more letters" if len(name) > 80 else "")
        raise NotMarkableError(
            f"{path}: <name> is {shown}, which is not a valid name of a package: a letter, and at most 99 "
            "more letters, digits, _ and -"
        )
    return name, frozenset(dependencies_of(root))


def exercise_numbers(name: str) -> Set[int]:
    """Numbers of exercises in the name of a file or folder: ex3.launch, course_03, 5th_exercise, 3.

    A number counts only beside a word for exercise, or alone: tb3, ur3 and 5ro14 are names of other things.
    """
    name = unicodedata.normalize("NFC", name)  # macOS writes an umlaut as two letters
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.replace(".launch", "")).lower()
    numbers = [next(filter(None, groups)) for groups in _EXERCISE.findall(text)]
    return {_NUMBERS[word] if word in _NUMBERS else int(word) for word in numbers}


def fits_exercise(place: PurePosixPath, exercise: int) -> int:
    """2: the innermost number in the place is the exercise's; 1: there is none; 0: it is another one's."""
    for part in reversed(place.parts):
        numbers = exercise_numbers(part)
        if numbers:
            return 2 if exercise in numbers else 0
    return 1


def choose_packages(
    packages: Sequence[Package], exercise: int, attempt: int = 0
) -> Tuple[List[Package], List[str]]:
    """The packages that belong to an exercise, each name once; and notes on what is left aside.

    Known packages are left aside; of several with the same name the one of the exercise stays, of equals the
    one with a launch file that starts its node, then the one with more files; at a further attempt the next
    one, unless it is another exercise's. Packages of other exercises stay only if one that stays depends on
    them.
    """
    notes: List[str] = []
    by_name: Dict[str, List[Package]] = {}
    for package in packages:
        by_name.setdefault(package.name, []).append(package)
    known_names = sorted(set(by_name) & KNOWN)
    if known_names:
        notes.append(f"left aside, because not the student's own: {', '.join(known_names)}")
    package_by_name: Dict[str, Package] = {}
    for name in sorted(set(by_name) - KNOWN):
        namesakes = by_name[name]
        if len(namesakes) > 1:
            namesakes = sorted(namesakes, key=partial(_rank, exercise=exercise))
            fitting = sum(fits_exercise(each.place, exercise) > 0 for each in namesakes) or len(namesakes)
            namesakes.insert(0, namesakes.pop(min(attempt, fitting - 1)))
            places = ", ".join(str(each.place) for each in namesakes[1:])
            notes.append(f"package {name} is taken from {namesakes[0].place}; left aside: {places}")
        package_by_name[name] = namesakes[0]
    names = {name for name, package in package_by_name.items() if fits_exercise(package.place, exercise)}
    names = with_dependencies(names or set(package_by_name), package_by_name)
    aside = sorted(set(package_by_name) - names)
    if aside:
        notes.append(f"left aside, because of other exercises: {', '.join(aside)}")
    return [package_by_name[name] for name in sorted(names)], notes


def copies_of_known(packages: Sequence[Package]) -> List[Package]:
    """Known packages that a hand-in puts its own into, each name once: not built, but their files are found.

    These are COPIED, and those with a launch file that starts a node of the hand-in.
    """
    own = {each.name for each in packages} - KNOWN
    copies = [
        each for each in packages if each.name in COPIED or (each.name in KNOWN and _launched(each) & own)
    ]
    return list({each.name: each for each in reversed(copies)}.values())


def _launched(package: Package) -> Set[str]:
    """Names of the packages whose nodes the launch files of a package start, by their texts."""
    files = [path for path in walk(package.path, BUILT) if file_suffix(path) == ".launch"]
    return {node.partition("/")[0] for path in files for node in nodes_in(path)}


def with_dependencies(names: Set[str], packages: Dict[str, Package]) -> Set[str]:
    """Names of packages, and of all packages of the hand-in that they depend on."""
    members, waiting = set(names), list(names)
    while waiting:
        needs = packages[waiting.pop()].needs & set(packages) - members
        members |= needs
        waiting += needs
    return members


def _rank(package: Package, exercise: int) -> Tuple[Any, ...]:
    """Smaller is better: folders come before archives, outer ones before inner."""
    in_archive = any(suffix_of(part) for part in package.place.parts)
    fits, files = fits_exercise(package.place, exercise), list(walk(package.path, BUILT))
    return (
        -fits,
        package.name not in _launched(package),
        in_archive,
        -len(files),
        len(package.place.parts),
        str(package.place),
    )


def nodes_in(launch_file: Path, in_comments: bool = False) -> Tuple[str, ...]:
    """Nodes, package/type, that the text of a launch file names; or that its comments name."""
    try:
        text = read_text(launch_file, MAX_MANIFEST)
    except UnreadableFileError:
        return ()
    text = " ".join(_COMMENT.findall(text)) if in_comments else _COMMENT.sub("", text)
    nodes = [dict(_ATTRIBUTE.findall(node)) for node in re.findall(r"<node\b([^<>]{0,2000})", text)]
    return tuple(dict.fromkeys(f"{node['pkg']}/{node.get('type', '')}" for node in nodes if "pkg" in node))
