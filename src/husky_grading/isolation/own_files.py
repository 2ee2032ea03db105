"""Files of this package that an untrusted program sees; the package may be cloned, built or installed.

In: a `VisibleCode`. Out: folders that the sandbox hides, and files that it shows in them.

A submission reads this package's launch files, worlds and messages, and nothing else. It reads neither the
controllers, which would solve its exercise, nor other files of the clone, such as another student's results.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import FrozenSet, List, Set

from husky_highlevel_controller import paths
from husky_highlevel_controller.paths import search_path, share_folder


class VisibleCode(Enum):
    """Files of this package that an untrusted program sees besides launch files, worlds and messages."""

    NOTHING = "nothing"  # a normal submission must not see our controllers
    FILTER = "filter"  # a submission to exercise 4 sees our filter, which replaces robot_localization
    ALL = "all"  # our own launch file or node sees all files, if a teacher gives it to `grade`


# folder with the Python modules of husky_highlevel_controller; it is in the source tree, even if Python
# imports the package from catkin's devel space
MODULES = Path(paths.__file__).resolve().parent
NAME = MODULES.name
# our other Python packages, in the folder that contains MODULES
OTHER_PACKAGES = ("husky_evaluation", "husky_grading", "husky_web")
# files and folders that every submission sees, because its launch files and its build may need them
DATA = ("package.xml", "cmake", "compat", "config", "launch", "msg", "rviz", "srv", "urdf", "worlds")
# folders that a normal submission does not see; our own launch files and nodes see them
CODE = ("cfg", "examples", "scripts", "src", "tools", "web")
# program that starts the nodes of a submission
STARTER = Path(__file__).resolve().parents[1] / "nodes" / "submission.py"
# script that sources the workspace of a submission and starts a program in it
IN_WORKSPACE = (share_folder() / "tools" / "in_workspace.bash").resolve()
FILTER_PROGRAM = "planar_ekf"


@dataclass(frozen=True)
class OwnFiles:
    """Files of this package in a sandbox.

    The sandbox first covers each folder in `hidden` by an empty folder, and then mounts each path in `shown`,
    also inside of the covered folders.
    """

    hidden: FrozenSet[Path]  # folders in which the program sees only the paths in `shown`
    shown: FrozenSet[Path]  # files and folders that the program sees


def own_files(visible_code: VisibleCode) -> OwnFiles:
    """Return the files of this package that a program sees, and the folders in which it sees nothing else.

    The program sees a file in `shown` even if the file is inside of a folder in `hidden`, see `OwnFiles`.
    """
    share = share_folder()
    # The folder of this package is always hidden, because it may also have files such as the results of other
    # students. An entry of `share` may be a link into another folder, such as the source tree, so the folders
    # of the link targets are hidden, too.
    hidden: Set[Path] = {share.resolve(), *(entry.resolve().parent for entry in share.iterdir())}
    # some entries of the hidden folders are shown again
    entries = [*DATA, *CODE] if visible_code is VisibleCode.ALL else [*DATA]
    shown: Set[Path] = {STARTER, IN_WORKSPACE, *((share / name).resolve() for name in entries)}
    # folders of our Python packages, and folders of our programs
    code = {MODULES, *(MODULES.parent / name for name in OTHER_PACKAGES), *program_folders()}
    if visible_code is VisibleCode.ALL:
        shown |= code
    else:
        hidden |= code
        # the messages stay visible; in an installed package, they are in the same folder as the hidden
        # modules
        shown |= {MODULES / name for name in ("__init__.py", "msg", "srv")}
    if visible_code is VisibleCode.FILTER:  # the modules that our filter imports, and its program
        shown |= {*MODULES.glob("*.py"), MODULES / "cfg", MODULES / "estimation"}
        shown |= {*(MODULES / "ros").glob("*.py"), MODULES / "ros" / "estimation"}
        shown |= {folder / FILTER_PROGRAM for folder in program_folders()}
        shown.add((share / "scripts" / FILTER_PROGRAM).resolve())
    existing = {path for path in shown if os.path.exists(path)}
    return OwnFiles(frozenset(path for path in hidden if path.is_dir()), frozenset(existing))


def folders_on_python_path() -> List[Path]:
    """Return the folders of PYTHONPATH that contain this package, and the folder that contains MODULES.

    The sandbox removes these folders from PYTHONPATH, so that a submission cannot import our controllers. A
    folder that contains only a student's package of the same name does not count.
    """
    folders = search_path("PYTHONPATH")
    # files that only our package has; a folder with its generated messages has only the second file
    only_ours = ("paths.py", "msg/_HuskyStatus.py")
    found = [path for path in folders if any((path / NAME / file).is_file() for file in only_ours)]
    return [MODULES.parent, *found]


def program_folders() -> List[Path]:
    """Return folders of this package's programs in the workspaces that contain the package."""
    prefixes = search_path("CMAKE_PREFIX_PATH")
    package_folders = folders_on_python_path()
    # prefixes of the workspaces in which Python finds this package
    ours = [prefix for prefix in prefixes if any(prefix in folder.parents for folder in package_folders)]
    return [(prefix / "lib" / NAME).resolve() for prefix in ours if (prefix / "lib" / NAME).is_dir()]
