"""Folder of a class: each first-level entry is one submission, with a name for people and a name for paths.

In: a folder whose entries have any names, because students, browsers and Moodle choose them. Out: `HandIn`
records.

Paths with quotes, blanks or colons do not work in CMake, make, catkin, roslaunch and ROS_PACKAGE_PATH. So a
student's name is for people only, and paths use `HandIn.folder`.
"""

from __future__ import annotations

import hashlib
import os
import re
import unicodedata
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Sequence

from husky_grading.hand_in.archives import suffix_of

# [bytes] longest name of a folder with results; the rest of a longer name is cut off
MAX_FOLDER = 200
DIGITS = 8  # number of hexadecimal digits of the hash that makes the name of a folder unique
SAFE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")  # names that match this pattern are safe in any path


@dataclass(frozen=True)
class HandIn:
    """Submission of one student, as it was delivered."""

    name: str  # printable name of the student, as pages and marking.yaml show it
    path: Path  # folder or archive
    folder: str  # name of the folder of results, with only characters that are safe in a path
    # sentence that says that the student has two entries, such as bob and bob.zip; empty if there is only one
    problem: str = ""


def is_package(folder: Path) -> bool:
    """Return whether a folder of a class is itself a package, and so a single submission."""
    return (folder / "package.xml").is_file()


def find_hand_ins(folder: Path) -> List[HandIn]:
    """Return the submissions in a folder of a class, sorted by path; each folder or archive is one.

    A folder that is itself a package is one submission. If a student has two entries, such as `bob` and
    `bob.zip`, the submission has a problem, because only the teacher can decide which one counts.
    """
    if is_package(folder):
        return _named({folder.name: [folder]})
    # paths of the folders and archives of each student; the key is the student's name as it is on the disk
    entries: Dict[str, List[Path]] = {}
    for path in filter(_is_hand_in, sorted(folder.iterdir())):
        name = path.name if path.is_dir() else path.name[: -len(suffix_of(path.name))]
        entries.setdefault(name, []).append(path)
    return _named(entries)


def left_out(folder: Path) -> List[str]:
    """Return the names of the entries in a class's folder that are neither submissions nor hidden."""
    if is_package(folder):
        return []
    paths = sorted(path for path in folder.iterdir() if not _is_hidden(path))
    return [_decoded(path.name) for path in paths if not _is_hand_in(path)]


def _is_hidden(path: Path) -> bool:
    """Return whether an entry is hidden, or is the folder __MACOSX, which macOS adds to each zip."""
    return path.name.startswith(".") or path.name == "__MACOSX"


def _is_hand_in(path: Path) -> bool:
    """Return whether an entry in a folder of a class is a submission: a folder or an archive, but no link."""
    if _is_hidden(path) or path.is_symlink():
        return False
    return path.is_dir() or (bool(suffix_of(path.name)) and path.is_file())


def _named(entries: Dict[str, List[Path]]) -> List[HandIn]:
    """Return the submission of each student, with a name for people and a name for a folder.

    The keys of `entries` are names as they are on the disk. A student normally has a single path.
    """
    names, folders = _shown_names(list(entries)), _folder_names(list(entries))
    hand_ins = []
    for entry, paths in entries.items():
        problem = ""
        if len(paths) > 1:
            which = " and ".join(path.name for path in paths)
            problem = f"{which} are both the submission of {names[entry]}; leave one of them in the folder"
        hand_ins.append(HandIn(names[entry], paths[0], folders[entry], problem))
    return hand_ins


def _shown_names(entries: Sequence[str]) -> Dict[str, str]:
    """Return a printable name for each entry; no two names are equal.

    An umlaut is one character in a name, even if the entry has two characters (macOS) or a byte of Latin-1.
    If two entries would get the same name, the second one gets escapes in place of its umlauts.
    """
    names: Dict[str, str] = {}
    # printable text of each entry; two entries may have the same text
    as_shown = {entry: _printable(_decoded(entry)) for entry in entries}
    # entries whose names are shown unchanged come first, so they keep their names if another name would look
    # the same
    for entry in sorted(entries, key=lambda each: (as_shown[each] != each, each)):
        name = as_shown[entry]
        if name in names.values():
            # an escape for each character and byte beyond ASCII shows how the name is really written
            exact = os.fsencode(entry).decode("utf-8", "backslashreplace")
            name = exact.encode("ascii", "backslashreplace").decode()
        if name in names.values():  # another entry may have the name with the escapes
            name = f"{name}~{_digest(entry)}"
        names[entry] = name
    return names


def _printable(text: str) -> str:
    r"""Return a text with an escape such as \n in place of each character that cannot be printed."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


def _decoded(entry: str) -> str:
    """Return the name of an entry as text; its bytes may be UTF-8 or Latin-1. An umlaut is one character."""
    name = os.fsencode(entry)
    try:
        text = name.decode()
    except UnicodeDecodeError:
        text = name.decode("latin-1")
    return unicodedata.normalize("NFC", text)


def _folder_names(entries: Sequence[str]) -> Dict[str, str]:
    """Return a name of a folder for each entry; no two names are equal.

    An entry that is safe in a path keeps its name. In other names, unsafe characters become underscores. A
    hash is added only if two names are equal or a name is too long, so a folder's name rarely depends on
    other students.
    """
    # folder of each entry; a name that is safe in any path, and not too long, stays as it is
    folders = {entry: entry for entry in entries if SAFE.fullmatch(entry) and len(entry) <= MAX_FOLDER}
    underscored = {entry: _underscored(entry) for entry in entries if entry not in folders}
    counts = Counter([*folders, *underscored.values()])  # number of entries that would get the same folder
    for entry, folder in underscored.items():
        if counts[folder] > 1 or len(folder) > MAX_FOLDER:
            folder = f"{folder[: MAX_FOLDER - DIGITS - 1]}-{_digest(entry)}"
        while folder in folders.values():  # the folder of another student may already have this name
            folder = f"{folder[: MAX_FOLDER - DIGITS - 1]}-{_digest(folder)}"
        folders[entry] = folder
    return folders


def _underscored(entry: str) -> str:
    """Return a name that is safe in any path: `Müller` becomes `Muller`, `Ann Lee (1)` `Ann_Lee_1_`."""
    # NFKD splits an umlaut into a letter and its two dots, and "ignore" drops the dots
    letters = unicodedata.normalize("NFKD", _decoded(entry)).encode("ascii", "ignore").decode()
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", letters)
    return name if SAFE.fullmatch(name) else f"_{name}"


def _digest(name: str) -> str:
    """Return a short hash, which makes the folder's name of a student different from all others."""
    return hashlib.sha256(os.fsencode(name)).hexdigest()[:DIGITS]
