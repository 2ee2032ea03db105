"""Neutral place of a marking: its folder of results under a path without any user's or machine's name.

CMake, make, catkin's setup files, `launch-prefix`, `args` and ROS_PACKAGE_PATH accept no quotes, blanks or
colons in a path, but a teacher's `--out` may have them. So the marking program has mounts of its own, in
which its folder of results is at a path that is always the same. A kept workspace stays valid there, even if
the folder of results was moved.
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
RESULTS = "hand_in"  # name of the neutral folder, which is in a folder of each user, see `make`
NEUTRAL_PATH = re.compile(rf"{FOLDER}/marking_\d+/{RESULTS}\b")  # pattern of the neutral path of any user
MS_BIND = 0x1000  # flag of mount(2)
SAFE = re.compile(r"[\w./+,=@~-]*")  # pattern of a path that CMake and roslaunch accept without quotes


def make() -> str:
    """Make the folder at which the marking programs of this user mount their results, and return its path.

    The path is empty if the folder cannot be made.
    """
    parent = Path(FOLDER, f"marking_{os.getuid()}")
    place = parent / RESULTS
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
    """Mount a folder of results at the neutral path, and return this path, or the own path if that fails.

    Raises:
        HuskyError: the folder cannot be mounted, and CMake does not accept the folder's own path.
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
