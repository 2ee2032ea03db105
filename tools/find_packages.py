"""Packages of a person's own, found in the same places by every command of ./dev.

The places, in this order: the folder where the person stands, the catkin workspace around it,
ROS_PACKAGE_PATH, and the folder that this clone lies in. tools/gazebo_packages.py adds the stand-ins of
compat/.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, Iterable, Iterator, List, Optional, Tuple
from xml.etree.ElementTree import ParseError

import gazebo_packages
import rospkg
from defusedxml import DefusedXmlException, ElementTree

from husky_highlevel_controller.dependencies import (
    dependencies_of,
    dependency_sentence,
    unknown_dependencies,
)

PACKAGE = "husky_highlevel_controller"
PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
NEIGHBOURHOOD = PACKAGE_FOLDER.parent  # folder that this clone lies in; packages next to the clone are found
DEPTH = 4  # levels of folders that are searched below a place, as in ~/catkin_ws/src/repository/package
MOST_FOLDERS = 20_000  # largest number of folders searched below a place; a home folder may have millions
SYSTEM = {Path("/usr"), Path("/opt")}  # folders of packages that are installed
# folders of a workspace and of other tools that hold no sources of packages
SKIPPED = {"build", "devel", "install", "logs", "log", "node_modules", "site-packages", "__pycache__"}


def _manifest_of(package: Path) -> Optional[Any]:
    """Return the ElementTree of the package.xml of a folder, or None if no package.xml can be read."""
    try:
        return ElementTree.parse(package / "package.xml")
    except (OSError, ParseError, DefusedXmlException, ValueError, LookupError):
        return None


def name_of(package: Path) -> str:
    """Return the name in the package.xml of a folder; empty if no package.xml can be read."""
    manifest = _manifest_of(package)
    return "" if manifest is None else (manifest.findtext("name") or "").strip()


def is_students(package: Path) -> bool:
    """Return whether a package is a person's own: not this one, not installed, and not handed out."""
    folder = (package / "package.xml").resolve().parent  # a workspace may hold links to its files
    inside = SYSTEM.intersection(folder.parents) or gazebo_packages.COMPAT in folder.parents
    return not (inside or folder == PACKAGE_FOLDER or name_of(package) in gazebo_packages.COURSE_PACKAGES)


def dependency_sentences(folders: Iterable[Path]) -> List[str]:
    """Return a sentence on each missing package on which a person's own package in `folders` depends."""
    own = [folder for folder in dict.fromkeys(folders) if is_students(folder)]
    if not own:
        return []
    manifests = {folder: (name_of(folder), _manifest_of(folder)) for folder in own}
    # names of the packages that are not missing
    known = {*rospkg.RosPack().list(), *(path.name for path in gazebo_packages.COMPAT.iterdir())}
    known.update(name for name, _ in manifests.values())
    sentences = []
    for name, manifest in manifests.values():
        if manifest is not None:
            findings = unknown_dependencies(name, dependencies_of(manifest), known)
            sentences += [dependency_sentence(finding) for finding in findings]
    return sentences


def package_around(path: Path) -> Optional[Path]:
    """Return the folder of the package around a file or folder, or None."""
    for folder in (path, *path.parents):
        if (folder / "package.xml").is_file():
            return folder
    return None


def workspace_around(path: Path) -> Optional[Path]:
    """Return the folder `src` of the catkin workspace around a file or folder, or None.

    A home folder is not a workspace.
    """
    for folder in (path, *path.parents):
        if folder == Path.home():
            return None
        if folder.name == "src" and folder.parent != Path.home():
            return folder
        if (folder / "src").is_dir() and any((folder / name).is_dir() for name in ("devel", "build")):
            return folder / "src"
    return None


def is_folder(entry: os.DirEntry[str]) -> bool:
    """Return whether an entry is a folder, or a link to a folder."""
    try:
        return entry.is_dir()
    except OSError:  # a link that leads to itself, or into another user's folder
        return False


def packages_below(place: Path) -> Iterator[Tuple[str, Path]]:
    """Return the name and folder of each package in a place, the packages near its top first.

    A package in the folder of another package is left out, as rospack does.
    """
    level = [place]  # folders at the present depth
    looked = 0  # number of folders that were searched
    for _ in range(DEPTH + 1):
        below: List[Path] = []
        for folder in level:
            looked += 1
            if looked > MOST_FOLDERS:
                return
            try:
                entries = {entry.name: entry for entry in os.scandir(folder)}
            except OSError:  # another user's folder
                continue
            if "CATKIN_IGNORE" in entries:
                continue
            if "package.xml" in entries:
                name = name_of(folder)
                if name:
                    yield name, folder
                continue
            for name in sorted(entries):
                if name[0] != "." and name not in SKIPPED and is_folder(entries[name]):
                    below.append(folder / name)
        level = below


def places(*starts: Path) -> List[Path]:
    """Return the folders in which packages are searched, for start folders such as the caller's folder."""
    found: List[Path] = []
    for start in starts:
        package, workspace = package_around(start), workspace_around(start)
        found += [folder for folder in (package, start, workspace) if folder]
    return list(dict.fromkeys(folder.resolve() for folder in found))


def find_file(package: str, file: str, caller: Path) -> Optional[Path]:
    """Return the path of a file in any folder of a package, as roslaunch finds it; None if there is none.

    If several packages have this name, the first one that has the file counts, in the order of the places in
    this module's docstring.
    """
    folders_of_package = []  # in the order in which they are searched
    for place in places(caller):
        folders_of_package += [folder for name, folder in packages_below(place) if name == package]
    if package == PACKAGE:
        folders_of_package.append(PACKAGE_FOLDER)
    packages = rospkg.RosPack(gazebo_packages.package_paths())
    if package in packages.list():
        folders_of_package.append(Path(packages.get_path(package)))
    if package != PACKAGE:  # another clone next to this one has the same files, but does not count
        next_to_clone = packages_below(NEIGHBOURHOOD)
        folders_of_package += [folder for name, folder in next_to_clone if name == package]
    folders_of_package.append(gazebo_packages.COMPAT / package)
    for folder in folders_of_package:
        # the folder `launch` first, because a folder beside it may hold the submissions of a class
        if (folder / "launch" / file).is_file():
            return folder / "launch" / file
        for path, inner_folders, files in os.walk(folder, followlinks=True):
            # `os.walk` goes only into the folders that stay in this list
            inner_folders[:] = sorted(inner for inner in inner_folders if inner[0] != ".")
            if file in files:
                return Path(path) / file
    return None


def add_packages(paths: Iterable[str], *starts: Path) -> List[str]:
    """Return a ROS_PACKAGE_PATH, followed by other packages around `starts` and next to this clone."""
    paths = list(paths)
    found: Dict[str, str] = {}
    for place in (*places(*starts), NEIGHBOURHOOD):
        for name, folder in packages_below(place):
            found.setdefault(name, str(folder))
    known = {*rospkg.RosPack(paths).list(), PACKAGE}
    return [*paths, *(folder for name, folder in found.items() if name not in known)]


def _setup_around(path: Path) -> Optional[Path]:
    """Return the setup.bash of the nearest built catkin workspace around a file or folder, or None."""
    for folder in (path, *path.parents):
        setup = folder / "devel" / "setup.bash"
        if setup.is_file():
            return setup
    return None


def source_workspace(path: Path) -> bool:
    """Source the built catkin workspace around a file or folder for this process.

    Return False if there is no such workspace, or if it cannot be sourced.
    """
    setup = _setup_around(path)
    if setup is None or PACKAGE_FOLDER / ".dev" in setup.parents:  # ./dev has sourced its own workspace
        return False
    # bash sources the file, and prints the variables that it then has
    script = 'source "$1" --extend >/dev/null && env -0'
    done = subprocess.run(["bash", "-c", script, "bash", str(setup)], stdout=subprocess.PIPE, check=False)
    if done.returncode != 0:
        return False
    variables = [line.partition("=") for line in os.fsdecode(done.stdout).split("\0") if line]
    os.environ.update({name: value for name, _, value in variables})
    # the workspace may have put another Python first
    os.environ["PATH"] = os.pathsep.join((os.path.dirname(sys.executable), os.environ.get("PATH", "")))
    return True


def main() -> None:
    """Print a sentence on each missing dependency of a person's packages around a folder, the argument."""
    caller = Path(sys.argv[1])
    os.environ["ROS_PACKAGE_PATH"] = os.pathsep.join(add_packages(gazebo_packages.package_paths(), caller))
    folders = [folder for place in places(caller) for _, folder in packages_below(place)]
    print("\n".join(dependency_sentences(folders)))


if __name__ == "__main__":
    main()
