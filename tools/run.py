"""`./dev run`: a command in an environment in which ROS finds the packages that `./dev launch` finds.

roslaunch and rostest run in this process, so that they find a launch file's own package first, as `./dev
launch` does.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import List

import find_packages
import gazebo_packages
import rospkg

# commands that build a workspace; the caller's workspace is not sourced for them, because they may build it
BUILDS = ("catkin_make", "catkin_make_isolated", "catkin", "cmake")
LAUNCHES = ("roslaunch", "rostest")


def sees_neighbours(words: List[str]) -> bool:
    """Return whether a command finds the packages around the caller.

    A program of this package finds these packages only if an option names a package. `grade --all` must not
    find them, because each submission would then find the packages of all other submissions.
    """
    names = [word for word in words[1:] if word[0:1] != "-"]
    is_own = words[0] == "rosrun" and names[0:1] == [find_packages.PACKAGE]
    return not is_own or not {"--launch", "--node"}.isdisjoint(words)


def with_path(words: List[str], caller: Path) -> List[str]:
    """Return a command line, in which the path of a file replaces the words PACKAGE FILE."""
    for at, (package, file) in enumerate(zip(words, words[1:])):
        if not file.endswith((".launch", ".test")):
            continue
        # the first word may be an option, and either of them may be a path
        if "/" in package + file or package.startswith("-"):
            continue
        path = find_packages.find_file(package, file, caller)
        if path:
            return [*words[:at], str(path), *words[at + 2 :]]
    return words


def launch_here(words: List[str], caller: Path) -> None:
    """Run roslaunch or rostest, with the packages and stand-ins that the files in its command line need."""
    from launch import find_packages_for, start_own_master

    start_own_master()

    arguments = with_path(words[1:], caller)
    files = [word for word in arguments if Path(word).is_file()]
    # path of each file, or of the stand-in that replaces the file
    found = {word: str(find_packages_for(Path(word).absolute())) for word in files}
    sys.argv = [words[0], *(found.get(word, word) for word in arguments)]
    if words[0] == "rostest":
        from rostest import rostestmain

        rostestmain()
    else:
        import roslaunch

        roslaunch.main(sys.argv)


def package_of(words: List[str], paths: List[str]) -> List[Path]:
    """Return a list with the folder of the package in a command line of rosrun.

    The list is empty if the package is in none of the paths of a ROS_PACKAGE_PATH.
    """
    packages = rospkg.RosPack(paths)
    for word in words[1:3]:  # the package is the first word after rosrun, or the second one after an option
        if word in packages.list():
            return [Path(packages.get_path(word))]
    return []


def warn_of_dependencies(package: List[Path]) -> None:
    """Warn of the dependencies of a package that are missing here."""
    for sentence in find_packages.dependency_sentences(package):
        print(f"[dev] warning: {sentence}", file=sys.stderr, flush=True)


def main() -> None:
    """Run the command of the command line."""
    words, caller = sys.argv[1:], Path.cwd()
    if words[0] in LAUNCHES:
        launch_here(words, caller)
        return
    if sees_neighbours(words):
        if words[0] not in BUILDS:
            find_packages.source_workspace(caller)
        paths = find_packages.add_packages(gazebo_packages.package_paths(), caller)
        package = package_of(words, paths) if words[0] == "rosrun" else []
        # a compiled node is in the workspace of its package, which may lie next to this clone
        if package and find_packages.source_workspace(package[0]):
            paths = find_packages.add_packages(gazebo_packages.package_paths(), caller)
        joined = gazebo_packages.join_copies(paths)
        paths = gazebo_packages.package_path(paths, joined.values())
        os.environ["ROS_PACKAGE_PATH"] = os.pathsep.join(paths)
        warn_of_dependencies(package)
    try:
        os.execvp(words[0], words)
    except OSError as error:
        if error.errno != errno.ENOEXEC:
            raise
        sys.exit(
            f"[dev] error: the first line of {words[0]} does not name the program that runs it, such as "
            f"#!/usr/bin/env python3; add this line, or type: ./dev run python3 {words[0]}"
        )


if __name__ == "__main__":
    main()
