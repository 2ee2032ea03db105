"""Stand-ins for Gazebo's packages, from compat/, joined with a workspace's copies of the same packages.

Run by its path it prints a ROS_PACKAGE_PATH for plain roslaunch.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Dict, Iterable, List, Set, Tuple, Union
from xml.etree.ElementTree import ParseError

from husky_highlevel_controller.missing_packages import end_if_missing

end_if_missing()  # a catkin workspace may have the system's Python, which lacks defusedxml

import rospkg  # noqa: E402
from defusedxml import ElementTree  # noqa: E402

COMPAT = Path(__file__).resolve().parents[1] / "compat"
# packages that a workspace may have a copy of, because courses hand them out; the copy's launch files need
# Gazebo or other packages that are not installed
COURSE_PACKAGES = (
    "husky_control", "husky_description", "husky_gazebo", "smb_control", "smb_description", "smb_gazebo",
)  # fmt: skip
OURS_FIRST = ("launch", "scripts")  # folders whose files need Gazebo
# arguments that people edit in a copy
SENSORS = {"laser_enabled", "kinect_enabled"}
WORLD_AND_POSE = {"world", "world_name", "world_file", "x", "y", "z", "yaw", *SENSORS}


def package_paths() -> List[str]:
    """Return the folders of ROS_PACKAGE_PATH."""
    return [path for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if path]


def package_path(paths: List[str], joined: Iterable[Path]) -> List[str]:
    """Return a ROS_PACKAGE_PATH: joined packages, `paths`, and stand-ins for packages that are in neither."""
    known = set(rospkg.RosPack(paths).list())
    stand_ins = [str(path) for path in sorted(COMPAT.iterdir()) if path.name not in known]
    return [*map(str, joined), *paths, *stand_ins]


def join_copies(paths: List[str]) -> Dict[str, Path]:
    """Join each copy of COURSE_PACKAGES in a ROS_PACKAGE_PATH with our package of the same name.

    The launch files of a copy need gazebo_ros, so nothing is joined if gazebo_ros is installed.

    Returns:
        Folders of the joined packages by name, ~/.ros/gazebo_packages/DIGEST/NAME. If the copy has gone, a
        later call removes the folder.
    """
    kept = Path(rospkg.get_ros_home()) / "gazebo_packages"
    for folder in kept.glob("[!.]*/*"):  # without the `scratch` folders, which another launch may use
        if not (folder / "package.xml").exists():  # a link to a copy that is gone
            shutil.rmtree(folder.parent, ignore_errors=True)
    packages = rospkg.RosPack(paths)
    known = packages.list()
    # in a shell of `./dev run`, our own stand-in of gazebo_ros is in the path
    if "gazebo_ros" in known and Path(packages.get_path("gazebo_ros")).resolve() != COMPAT / "gazebo_ros":
        return {}
    joined = {}
    for name in COURSE_PACKAGES:
        if name not in known:
            continue
        copy = (Path(packages.get_path(name)) / "package.xml").resolve().parent
        if copy == COMPAT / name:  # this is our own package, and not a copy
            continue
        kept.mkdir(parents=True, exist_ok=True)
        # the package is made in a folder of its own and then moved, so no other launch sees it half made
        with tempfile.TemporaryDirectory(prefix=".", dir=kept) as scratch:
            new = Path(scratch) / "new"
            join(copy, COMPAT / name, new / name)
            place = kept / digest(new)
            try:
                new.rename(place)
            except OSError:
                if not place.is_dir():  # otherwise another launch made the same folder
                    raise
        joined[name] = place / name
    return joined


def digest(folder: Path) -> str:
    """Return a fingerprint of the links and files in a folder."""
    content: List[Tuple[Path, Union[str, bytes]]] = []
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            content.append((path.relative_to(folder), os.readlink(path)))
        elif path.is_file():
            content.append((path.relative_to(folder), path.read_bytes()))
    return hashlib.sha256(repr(content).encode()).hexdigest()[:12]


def join(copy: Path, ours: Path, target: Path) -> None:
    """Make a package of links to the files of a copy; our launch files and scripts replace the copy's files.

    Our launch files keep the world, and the pose and sensors of the robot, that the copy's launch files give.
    """
    target.mkdir(parents=True)
    for name in sorted({path.name for path in (*copy.iterdir(), *ours.iterdir())}):
        sources = (copy, ours) if name in OURS_FIRST else (ours, copy)  # the second one replaces the first
        paths = [source / name for source in sources if (source / name).exists()]
        if len(paths) == 2 and all(path.is_dir() for path in paths):
            (target / name).mkdir()
            files: Dict[str, Path] = {}
            for path in paths:
                files.update({file.name: file for file in path.iterdir()})
            for file in files.values():
                (target / name / file.name).symlink_to(file.resolve())
                if file.suffix == ".launch" and file.parent == ours / name:
                    keep_world_and_pose(copy / name / file.name, target / name / file.name)
        elif paths:
            (target / name).symlink_to(paths[-1].resolve())


def references(text: str, names: Set[str]) -> Set[str]:
    """Return the names of arguments that a text of a launch file uses, in $(arg ...) or $(eval ...)."""
    commands = [text] if text.startswith("$(eval ") else re.findall(r"\$\(arg ([^)]*)\)", text)
    return names & set(re.findall(r"\w+", " ".join(commands)))


def world_and_pose(file: Path, depth: int = 4) -> Dict[str, str]:
    """Return the world, and the pose and sensors of the robot, that a launch file gives, by argument.

    The files of the same folder that it includes count, too, down to `depth` levels. A default of the file
    replaces a value of an included file. A fixed value that the file passes to an include replaces both.
    """
    root = ElementTree.parse(file).getroot()
    names = {arg.get("name", "") for arg in root.findall("arg")}
    given: Dict[str, str] = {}
    fixed: Dict[str, str] = {}  # values for an include that do not depend on an argument of this file
    for include in root.iter("include"):
        name = include.get("file", "")
        inner = file.parent / Path(name).name
        if depth and "gazebo_ros" not in name and inner.is_file():
            given.update(world_and_pose(inner, depth - 1))
        for arg in include.findall("arg"):
            value = arg.get("value", arg.get("default", ""))
            if not references(value, names):
                fixed[arg.get("name", "")] = value
    for arg in root.findall("arg"):
        default = arg.get("default", "")
        # a default that needs an argument outside of WORLD_AND_POSE is left out, because our launch file may
        # not have this argument
        if references(default, names) <= WORLD_AND_POSE:
            given[arg.get("name", "")] = default
    given.update(fixed)
    return {name: value for name, value in given.items() if name in WORLD_AND_POSE and value}


def keep_world_and_pose(copy: Path, link: Path) -> None:
    """Replace a link to our launch file by a file with the world, pose and sensors of the copy's file."""
    try:
        given = world_and_pose(copy)
    except (OSError, ParseError, ValueError, LookupError):
        return  # the copy has no such file, or it is not valid XML, has entities or an unknown encoding
    ours = world_and_pose(link)
    # Noetic's launch file reads from the environment whether there is a lidar; our file reads this, too, and
    # keeps its own default
    from_environment = {name for name in SENSORS if "$(" in given.get(name, "")}
    # an argument that our file does not have, or has with the same value, stays as it is
    given = {
        name: value
        for name, value in given.items()
        if name not in from_environment and name in ours and value != ours[name]
    }
    if not given:
        return
    tree = ElementTree.parse(link)
    for path, attribute in (("arg", "default"), (".//include/arg", "value")):
        for arg in tree.getroot().iterfind(path):
            # a value that passes on an argument of the file stays
            if arg.get("name") in given and (attribute == "default" or "$(arg" not in arg.get(attribute, "")):
                arg.set(attribute, given[arg.get("name", "")])
    link.unlink()
    tree.write(link)


def main() -> None:
    """Print a ROS_PACKAGE_PATH."""
    paths = package_paths()
    print(os.pathsep.join(package_path(paths, join_copies(paths).values())))


if __name__ == "__main__":
    main()
