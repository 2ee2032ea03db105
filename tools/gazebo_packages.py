"""Stand-ins for Gazebo's packages: those of compat/, joined with a workspace's copies of the same packages.

Run by its path it prints a ROS_PACKAGE_PATH for plain roslaunch.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path
from typing import Dict, List
from xml.etree.ElementTree import ParseError

import rospkg
from defusedxml import ElementTree

COMPAT = Path(__file__).resolve().parents[1] / "compat"
# that workspaces have copies of, with launch files that need Gazebo or other missing packages
COURSE_PACKAGES = (
    "husky_control", "husky_description", "husky_gazebo", "smb_control", "smb_description", "smb_gazebo",
)  # fmt: skip
OURS_FIRST = ("launch", "scripts")  # folders whose files need Gazebo
# arguments that people edit in a copy
WORLD_AND_POSE = ("world", "world_name", "world_file", "x", "y", "yaw")


def package_path(paths: List[str], folder: Path) -> List[str]:
    """A ROS_PACKAGE_PATH with stand-ins for packages that `paths` lacks, and for copies of COURSE_PACKAGES.

    Args:
        paths: a ROS_PACKAGE_PATH.
        folder: where packages are joined.
    """
    packages = rospkg.RosPack(paths)
    known = set(packages.list())
    stand_ins = [str(path) for path in sorted(COMPAT.iterdir()) if path.name not in known]
    joined: List[str] = []
    if "gazebo_ros" not in known:  # without it the launch files of a copy start nothing
        for name in COURSE_PACKAGES:
            if name in known and Path(packages.get_path(name)).resolve() != COMPAT / name:
                join(Path(packages.get_path(name)), COMPAT / name, folder / name)
                joined.append(str(folder / name))
    return [*joined, *paths, *stand_ins]


def join(copy: Path, ours: Path, target: Path) -> None:
    """Make a package of links to a copy's files and to ours, which replace its launch files and scripts.

    World and pose of the robot that a launch file of the copy gives stay.
    """
    target.mkdir(parents=True)
    for name in sorted({path.name for path in (*copy.iterdir(), *ours.iterdir())}):
        sources = (copy, ours) if name in OURS_FIRST else (ours, copy)  # the second one replaces the first
        paths = [source / name for source in sources if (source / name).exists()]
        if len(paths) == 2 and all(path.is_dir() for path in paths):
            (target / name).mkdir()
            files = {file.name: file for path in paths for file in path.iterdir()}
            for file in files.values():
                (target / name / file.name).symlink_to(file.resolve())
                if file.suffix == ".launch" and file.parent == ours / name:
                    keep_world_and_pose(copy / name / file.name, target / name / file.name)
        elif paths:
            (target / name).symlink_to(paths[-1].resolve())


def world_and_pose(file: Path, depth: int = 4) -> Dict[str, str]:
    """World and pose that a launch file gives its robot, with what it includes from the same folder."""
    root = ElementTree.parse(file).getroot()
    given: Dict[str, str] = {}
    fixed: Dict[str, str] = {}
    for include in root.iter("include"):
        name = include.get("file", "")
        inner = file.parent / Path(name).name
        if depth and "gazebo_ros" not in name and inner.is_file():
            given.update(world_and_pose(inner, depth - 1))
        values = {arg.get("name", ""): arg.get("value", "$(arg") for arg in include.findall("arg")}
        fixed.update({name: value for name, value in values.items() if "$(arg" not in value})
    given.update({arg.get("name", ""): arg.get("default", "") for arg in root.findall("arg")})
    given.update(fixed)
    return {name: value for name, value in given.items() if name in WORLD_AND_POSE and value}


def keep_world_and_pose(copy: Path, link: Path) -> None:
    """Make a link to a launch file of ours a file with the copy's world and pose, where they differ."""
    try:
        given = world_and_pose(copy)
    except (OSError, ParseError, ValueError, LookupError):
        return  # the copy has no such file, or one that is no XML, has entities or an unknown encoding
    ours = world_and_pose(link)
    given = {name: value for name, value in given.items() if value != ours.get(name, value)}
    if not given:
        return
    tree = ElementTree.parse(link)
    for path, attribute in (("arg", "default"), (".//include/arg", "value")):
        for arg in tree.getroot().iterfind(path):
            if arg.get("name") in given and (attribute == "default" or "$(arg" not in arg.get(attribute, "")):
                arg.set(attribute, given[arg.get("name", "")])
    link.unlink()
    tree.write(link)


def main() -> None:
    """Print a ROS_PACKAGE_PATH; packages are joined in a folder of ~/.ros."""
    paths = [path for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if path]
    name = hashlib.sha256(os.pathsep.join(paths).encode()).hexdigest()[:12]
    folder = Path(rospkg.get_ros_home()) / "gazebo_packages" / name
    shutil.rmtree(folder, ignore_errors=True)
    print(os.pathsep.join(package_path(paths, folder)))


if __name__ == "__main__":
    main()
