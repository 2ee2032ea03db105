"""Folders of the marking machine in texts for students, who know only paths in their submission."""

from __future__ import annotations

import sys
from functools import lru_cache
from pathlib import Path
from typing import Iterable, Tuple

from husky_grading.isolation.place import NEUTRAL_PATH
from husky_highlevel_controller.paths import share_folder

ROOT = Path("/")


def hide_places(text: str, folders: Iterable[Path]) -> str:
    """Return a text without the paths of these folders, of this package, of Python and of the home folder.

    A path inside of a folder is cut to its part behind the folder. The path of a folder becomes its name.
    """
    # A marking sees the folder of its results at another path, the neutral folder, which counts, too. If the
    # marking of another user is judged again, the text has the path of that user's neutral folder.
    neutral_folders = map(Path, NEUTRAL_PATH.findall(text))
    # the root and the folder "." are not replaced, because "/" and "." are in most texts
    places = {*folders, *neutral_folders, *_own_places()} - {ROOT, Path()}
    for place in sorted(places, key=lambda place: len(str(place)), reverse=True):  # inner folders first
        text = text.replace(f"{place}/", "").replace(str(place), place.name)
    return text


@lru_cache(maxsize=1)
def _own_places() -> Tuple[Path, ...]:
    """Return the folders of this package and of Python, and the home folder."""
    sources = Path(__file__).resolve().parents[2]
    return (sources, share_folder(), Path(sys.prefix), Path.home())
