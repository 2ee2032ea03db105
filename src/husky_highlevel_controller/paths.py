"""Paths of the package's data files: worlds, launch files, configuration, robot description.

In: where this module lies. Out: a folder.
"""

from __future__ import annotations

from pathlib import Path

from husky_highlevel_controller.datatypes import HuskyError


def share_folder() -> Path:
    """The package's folder of data files: its source tree, or share/ beside the installed module's lib/.

    Catkin's devel space runs the modules of the source tree, so it needs no case of its own.

    Raises:
        HuskyError: neither has a folder urdf/.
    """
    here = Path(__file__).resolve()
    candidates = (here.parents[2], here.parents[4] / "share" / here.parent.name)
    for candidate in candidates:
        if (candidate / "urdf").is_dir():
            return candidate
    raise HuskyError("no folder urdf/ in " + " or ".join(map(str, candidates)))
