"""Paths of data files: the package's worlds, launch files, configuration and robots; PyBullet's meshes.

In: the place of the modules. Out: folders.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import List, Optional

from husky_highlevel_controller.datatypes import HuskyError


def share_folder() -> Path:
    """Return the folder of the package's data files.

    The folder is the source tree, or share/ inside a package that pip installed, or a folder in share/ of
    catkin's install space. Catkin's devel space runs the modules of the source tree, so it needs no case of
    its own.

    Raises:
        HuskyError: none of these folders has a folder urdf/.
    """
    module = Path(__file__).resolve()
    package = module.parent
    # paths from this file in the source tree, in pip's package, and in catkin's install space
    candidates = (module.parents[2], package / "share", module.parents[4] / "share" / package.name)
    for candidate in candidates:
        if (candidate / "urdf").is_dir():
            return candidate
    raise HuskyError("no folder urdf/ in " + " or ".join(map(str, candidates)))


def search_path(variable: str) -> List[Path]:
    """Return the folders in an environment variable such as GAZEBO_MODEL_PATH; empty if it is not set."""
    return [Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def mesh_folder() -> Optional[Path]:
    """Return the folder of the Husky's meshes that come with PyBullet; None if PyBullet is not installed."""
    spec = importlib.util.find_spec("pybullet_data")  # finds PyBullet without loading it
    if spec is None or spec.origin is None:
        return None
    meshes = Path(spec.origin).resolve().parent / "husky" / "meshes"
    return meshes if meshes.is_dir() else None
