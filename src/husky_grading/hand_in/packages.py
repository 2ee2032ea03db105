"""Packages of a submission: unpacked, found by their manifests, and chosen for an exercise."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property, partial
from pathlib import Path, PurePosixPath
from typing import Any, Dict, FrozenSet, List, Mapping, Sequence, Set, Tuple

from husky_grading.hand_in.archives import Allowance, ArchiveError, suffix_of, unpack
from husky_grading.isolation.files import (
    UnreadableFileError,
    file_suffix,
    read_text,
    read_xml,
    texts_in,
    walk,
)
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.dependencies import dependencies_of

MAX_ARCHIVES, MAX_PACKAGES = 50, 200  # largest number of archives and of packages in one submission
MAX_TEXT = 1_000_000  # [bytes] largest package.xml, launch file or Python file that is read
# names of folders that programs make, such as a build; they have no work of the student
BUILT = frozenset({"build", "devel", "install", "logs", ".git", "__pycache__", "__MACOSX", ".catkin_tools"})
# packages of courses, of Debian and of the robot; a copy of such a package is not the student's work
PUBLIC = frozenset({
    "teleop_twist_keyboard", "teleop_twist_joy", "ros_package_template", "rqt_multiplot", "joy",
    "husky_base", "husky_bringup", "husky_control", "husky_description", "husky_desktop", "husky_gazebo",
    "husky_msgs", "husky_navigation", "husky_robot", "husky_simulator", "husky_viz",
    "smb_common", "smb_control", "smb_description", "smb_gazebo",
})  # fmt: skip
# packages of PUBLIC to which students add worlds and launch files
EXTENDED = {"husky_gazebo", "smb_gazebo"}
# folders with such a word in their name probably have an old copy of a package
_OLD = re.compile(r"(?<![a-z])(?:old|backup|bak|copy|archive?|alte?)(?![a-z])", re.IGNORECASE)
# Valid name of a package, which also becomes the name of a folder. It may begin with a digit, because the
# university ENSTA uses such a name, and catkin builds such a package, although it prints a warning.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
# name of a package that a line of Python imports
_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+([A-Za-z]\w*)", re.MULTILINE)
_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)
_ATTRIBUTE = re.compile(r"""\b(pkg|type)\s*=\s*["']([^"']*)""")
_NUMBERS = {"one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6}
# words for an exercise in several languages, also misspelt
_WORD = (
    r"(?:exc?er[cs]i[cs]es?|exo|exe?|course|session|uebung|\u00fcbung|aufgabe|task|homework|hw|lab|tp|sheet)"
)
_COUNT = r"0*([1-9]\d?|" + "|".join(_NUMBERS) + r")(?![\da-z])"
# pattern of names such as exercise_3, Ex3, 5th_ex, or a number alone. `session 2` does not match, because
# this session of the university ENSTA is about the pillar, which is exercise 3 here.
_EXERCISE = re.compile(
    rf"(?<![a-z])(?!session[ _.-]*0*2(?!\d)){_WORD}[ _.-]*(?:no|nr|n)?[ _.-]*{_COUNT}"
    rf"|(?<!\d)([1-9]\d?)(?:st|nd|rd|th)[ _.-]*{_WORD}(?![a-z])|\A{_COUNT}\Z"
)


class NotMarkableError(HuskyError):
    """A submission cannot be marked, so its result has a problem and no points, not even 0."""


@dataclass(frozen=True)
class Package:
    """Catkin package of a submission."""

    name: str
    path: Path
    # path of the package inside the submission, also inside archives; "." is the folder of the submission
    # itself
    place: PurePosixPath
    # names of the packages on which this package depends, by its package.xml
    needs: FrozenSet[str] = frozenset()

    @cached_property
    def imported(self) -> FrozenSet[str]:
        """Return the names of the modules that the package's Python files import.

        A module may belong to a package that is missing in package.xml.
        """
        # a Python node may have a name without an ending
        texts = texts_in(self.path, {".py", ""}, MAX_TEXT, skipped=BUILT)
        return frozenset(name for _, text in texts for name in _IMPORT.findall(text))


@dataclass(frozen=True)
class Contents:
    """Packages of a submission, where its files are, and notes on files that cannot be read."""

    packages: Tuple[Package, ...]
    # folders on this machine with files of the student, and the path of each folder inside the submission, as
    # the student knows it
    places: Mapping[Path, PurePosixPath] = field(default_factory=dict)
    notes: Tuple[str, ...] = ()


def open_hand_in(path: Path, scratch: Path) -> Contents:
    """Unpack all archives of a student's delivery, also nested ones, and find every catkin package in it.

    Args:
        path: folder or archive that the student has delivered.
        scratch: existing, empty folder into which archives are unpacked.

    Raises:
        NotMarkableError: the submission cannot be read.
    """
    allowance = Allowance()  # files and bytes that all archives together may still unpack
    notes: List[str] = []
    try:
        root = path  # folder of the delivered files
        if path.is_file():
            root = scratch / "hand_in"
            root.mkdir()
            notes += unpack(path, root, allowance)
        # folders on this machine with files of the student, and their paths inside the submission
        places = {root: PurePosixPath(".")}
        folders = [root]
        for folder in folders:  # the list grows, because archives may contain archives
            for archive in walk(folder, skipped=BUILT):
                if not suffix_of(archive.name):
                    continue
                if len(folders) > MAX_ARCHIVES:
                    break  # further archives are left out
                unpacked = scratch / str(len(folders))
                unpacked.mkdir()
                try:
                    notes += unpack(archive, unpacked, allowance)
                except ArchiveError as error:
                    # files that were unpacked before the error are graded
                    notes.append(str(error))
                places[unpacked] = places[folder] / archive.relative_to(folder).as_posix()
                folders.append(unpacked)
        packages: List[Package] = []
        for folder, place in places.items():
            packages += _packages_below(folder, place, notes)
    except (ArchiveError, UnreadableFileError, OSError) as error:
        raise NotMarkableError(f"the submission cannot be read: {error}") from error
    if len(packages) > MAX_PACKAGES:
        raise NotMarkableError(
            f"the submission has {len(packages)} packages, at most {MAX_PACKAGES} are read"
        )
    return Contents(tuple(packages), places, tuple(notes))


def _packages_below(folder: Path, place: PurePosixPath, notes: List[str]) -> List[Package]:
    """Return the packages below a folder, outer ones first, without packages inside of another one.

    `place` is the path of the folder in the submission. `notes` gets a note on each package.xml that cannot
    be read.
    """
    manifests = [path for path in walk(folder, skipped=BUILT) if path.name == "package.xml"]
    packages: Dict[Path, Package] = {}
    # outer folders come first, so that a package inside of another one is noticed
    for manifest in sorted(manifests, key=lambda path: (len(path.parts), path)):
        path = manifest.parent
        if any(parent in packages for parent in path.parents):
            continue
        package_place = place / path.relative_to(folder).as_posix()
        try:
            name, needs = read_manifest(manifest)
        except NotMarkableError as error:
            # the student reads the note, so the note has the path in the submission, not the path on this
            # machine
            notes.append(str(error).replace(str(manifest), str(package_place / "package.xml")))
            continue
        packages[path] = Package(name, path, package_place, needs)
    return list(packages.values())


def read_manifest(path: Path) -> Tuple[str, FrozenSet[str]]:
    """Return name and dependencies of a package.xml.

    Raises:
        NotMarkableError: the package.xml cannot be read, or its name is not a valid name of a package.
    """
    try:
        root = read_xml(path, MAX_TEXT)
    except UnreadableFileError as error:
        raise NotMarkableError(str(error)) from error
    name = str(root.findtext("name") or "").strip()
    if not _NAME.fullmatch(name):
        shown = f"{name[:80]!r}"  # only the beginning of the name, because a name may have any length
        if len(name) > 80:
            shown += f" and {len(name) - 80} more characters"
        raise NotMarkableError(
            f"{path}: <name> is {shown}, which is not a valid name of a package; it needs a letter or a "
            "digit, and at most 99 more letters, digits, _ and -"
        )
    return name, frozenset(dependencies_of(root))


def exercise_numbers(name: str) -> Set[int]:
    """Return the exercise numbers in the name of a file or folder, such as 3 in ex3.launch or course_03.

    A number counts only next to a word for exercise, or if it is the whole name. So tb3 and 5ro14 have none.
    """
    # an umlaut becomes one character, because macOS writes it as two
    name = unicodedata.normalize("NFC", name)
    # MyExercise3 becomes my_exercise3, so that words are found
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.replace(".launch", "")).lower()
    numbers = set()
    for groups in _EXERCISE.findall(text):
        # the pattern has a group for each way to write a number; only one of these groups is not empty
        word = "".join(groups)
        numbers.add(_NUMBERS[word] if word in _NUMBERS else int(word))
    return numbers


class Fit(Enum):
    """Fit of a path to an exercise, by the numbers of exercises in the path."""

    THIS_EXERCISE = "this exercise"  # the path has the number of this exercise
    NO_NUMBER = "no number"  # the path has no number of an exercise
    OTHER_EXERCISE = "other exercise"  # the path has the number of another exercise


def fit_of_path(place: PurePosixPath, exercise: int) -> Fit:
    """Return whether a path belongs to an exercise, to another one or to none, by numbers in its names.

    The innermost folder or file name that has a number decides. So ex2/ex3.launch belongs to exercise 3.
    """
    for part in reversed(place.parts):
        numbers = exercise_numbers(part)
        if numbers:
            return Fit.THIS_EXERCISE if exercise in numbers else Fit.OTHER_EXERCISE
    return Fit.NO_NUMBER


def choose_packages(
    packages: Sequence[Package], exercise: int, attempt: int = 0
) -> Tuple[List[Package], List[str]]:
    """Return the packages that belong to an exercise, each name once, and notes on packages left out.

    - Packages of PUBLIC are left out.
    - If several packages have the same name, one of them stays: the one for the exercise, or otherwise the
      one with a launch file that starts its node, or otherwise the one with more files. A package of another
      exercise is taken only if there are no others.
    - A package of another exercise stays only if a package that stays depends on it.

    The first call has `attempt` 0. If its packages cannot be built, attempt 1 takes the second best one of
    the packages with the same name, and so on.
    """
    notes: List[str] = []
    by_name: Dict[str, List[Package]] = {}  # all packages of each name
    for package in packages:
        by_name.setdefault(package.name, []).append(package)
    public_names = sorted(set(by_name) & PUBLIC)
    if public_names:
        notes.append(f"packages that are not the student's own are left out: {', '.join(public_names)}")
    chosen: Dict[str, Package] = {}  # the package of each name that stays
    for name in sorted(set(by_name) - PUBLIC):
        namesakes = by_name[name]
        if len(namesakes) > 1:
            namesakes = _chosen_first(namesakes, exercise, attempt)
            places = ", ".join(str(each.place) for each in namesakes[1:])
            notes.append(
                f"package {name} is taken from {namesakes[0].place}; these copies are left out: {places}"
            )
        chosen[name] = namesakes[0]
    names = _names_for_exercise(chosen, exercise)
    other_names = sorted(set(chosen) - names)
    if other_names:
        notes.append(f"packages of other exercises are left out: {', '.join(other_names)}")
    return [chosen[name] for name in sorted(names)], notes


def _names_for_exercise(packages: Dict[str, Package], exercise: int) -> Set[str]:
    """Return the names of the packages that do not belong to another exercise, with all their dependencies.

    If all packages belong to other exercises, the names of all of them are returned.
    """
    fitting = {
        name
        for name, package in packages.items()
        if fit_of_path(package.place, exercise) != Fit.OTHER_EXERCISE
    }
    return with_dependencies(fitting or set(packages), packages)


def _chosen_first(namesakes: Sequence[Package], exercise: int, attempt: int) -> List[Package]:
    """Return packages of the same name, the one that this attempt chooses first, then the others.

    Attempt 0 chooses the best package, attempt 1 the second best one, and so on. If there are fewer packages,
    the last one that may be chosen is chosen again.
    """
    ordered = sorted(namesakes, key=partial(_sort_key, exercise=exercise))  # the best package comes first
    # packages of another exercise come last, and are chosen only if there are no others
    fitting = [each for each in ordered if fit_of_path(each.place, exercise) != Fit.OTHER_EXERCISE]
    number_choosable = len(fitting) or len(ordered)
    chosen = ordered.pop(min(attempt, number_choosable - 1))
    return [chosen, *ordered]


def copies_of_public(packages: Sequence[Package]) -> List[Package]:
    """Return the packages of PUBLIC to which the student has probably added files, each name once.

    Students add files to the packages of EXTENDED, and to packages with a launch file that starts a node of
    the submission. Nothing builds these packages, but launch files find the files in them.
    """
    students_own = {each.name for each in packages} - PUBLIC
    extended: Dict[str, Package] = {}  # packages by name
    # in reversed order, the first of several copies of a package is put into the dict last, so it remains
    for package in reversed(packages):
        is_public = package.name in PUBLIC
        if package.name in EXTENDED or (is_public and _launched_packages(package) & students_own):
            extended[package.name] = package
    return list(extended.values())


def _launched_packages(package: Package) -> Set[str]:
    """Return the names of the packages whose nodes the launch files of a package start.

    The launch files are only searched as text, see `nodes_in`.
    """
    files = [path for path in walk(package.path, skipped=BUILT) if file_suffix(path) == ".launch"]
    return {node.partition("/")[0] for path in files for node in nodes_in(path)}


def with_dependencies(names: Set[str], packages: Dict[str, Package]) -> Set[str]:
    """Return these names, and the names of all packages on which they depend, directly or indirectly.

    `packages` has the packages of the submission by name. Other dependencies, such as rospy, do not count.
    """
    members = set(names)
    waiting = list(names)  # members whose dependencies must still be added
    while waiting:
        package = packages[waiting.pop()]
        not_members = set(packages) - members
        new_members = package.needs & not_members
        # package.xml may forget a package that a Python file imports. The Python files are read only if this
        # could add a package.
        if not_members - new_members:
            new_members |= package.imported & not_members
        members |= new_members
        waiting += new_members
    return members


def _sort_key(package: Package, exercise: int) -> Tuple[Any, ...]:
    """Return a key to sort packages of the same name; the best package has the smallest key.

    Each entry of the key says how bad the package is in one respect. An entry counts only if two packages are
    equal in all entries before it.
    """
    fit = fit_of_path(package.place, exercise)
    starts_own_node = package.name in _launched_packages(package)
    number_of_files = len(list(walk(package.path, skipped=BUILT)))
    return (
        fit == Fit.OTHER_EXERCISE,
        fit == Fit.NO_NUMBER,
        any(map(_OLD.search, package.place.parts)),  # the package is in a folder such as backup/
        not starts_own_node,  # the package is probably a library, and not a solution
        # an archive next to a folder is probably an older copy of the folder
        any(suffix_of(part) for part in package.place.parts),
        -number_of_files,  # a copy with fewer files is less complete
        len(package.place.parts),
        str(package.place),  # the path decides last, so that each run makes the same choice
    )


def nodes_in(launch_file: Path, in_comments: bool = False) -> Tuple[str, ...]:
    """Search the text of a launch file for <node> tags, and return their nodes as package/type, each once.

    This works without roslaunch, so also for a launch file that is broken. With `in_comments`, only the
    comments are searched. A file that cannot be read has no nodes.
    """
    try:
        text = read_text(launch_file, MAX_TEXT)
    except UnreadableFileError:
        return ()
    text = " ".join(_COMMENT.findall(text)) if in_comments else _COMMENT.sub("", text)
    # attributes of each node, by name
    nodes = [dict(_ATTRIBUTE.findall(node)) for node in re.findall(r"<node\b([^<>]{0,2000})", text)]
    # `dict.fromkeys` keeps each name once, in the order of the file
    return tuple(dict.fromkeys(f"{node['pkg']}/{node.get('type', '')}" for node in nodes if "pkg" in node))
