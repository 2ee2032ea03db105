"""Neutral place of a marking: its folder of results under a path without any user's or machine's name.

CMake, make, catkin's setup files, `launch-prefix`, `args` and ROS_PACKAGE_PATH take no quotes, blanks or
colons in a path, but a teacher's `--out` may have them. So the marking program sees its folder of results at
a place that is always the same, in mounts of its own. It builds and drives there, so it finds a kept one.
"""

from __future__ import annotations

import ctypes
import os
import re
import stat
from pathlib import Path

from husky_highlevel_controller.datatypes import HuskyError

# environment variable with the path at which the marking program sees its folder of results; empty if the
# program cannot mount the folder there
VARIABLE = "HUSKY_GRADE_PLACE"
FOLDER = "/var/tmp"
MS_BIND = 0x1000  # flag of mount(2)
SAFE = re.compile(r"[\w./+,=@~-]*")  # pattern of a path that CMake and roslaunch accept without quotes


def make() -> str:
    """Make a folder of this user's, at which a marking program can mount its results, and return its path.

    The path is empty if there can be no such folder.
    """
    parent = Path(FOLDER, f"marking_{os.getuid()}")
    place = parent / "hand_in"
    try:
        for folder in (parent, place):
            folder.mkdir(mode=0o755, exist_ok=True)
            status = folder.lstat()
            if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
                # another user has put a link or a folder there, and could exchange the files in it
                return ""
    except OSError:
        return ""
    return str(place)


def show_results_at(out: Path) -> Path:
    """Show a folder of results at the place, and return its path there, or its own path if there is no place.

    Raises:
        HuskyError: the results cannot be mounted, and nothing can be built at the path of the folder.
    """
    place = os.environ.get(VARIABLE, "")  # path for the results; empty if they cannot be mounted there
    if place:
        out.mkdir(parents=True, exist_ok=True)
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mount(os.fsencode(out), os.fsencode(place), None, MS_BIND, None) == 0:
            return Path(place)
    if not SAFE.fullmatch(str(out)):
        raise HuskyError(
            f"the path of --out has characters that CMake and roslaunch do not accept: {str(out)!r}. Choose "
            "another folder, because this machine allows no mount namespace that could hide them"
        )
    return out
