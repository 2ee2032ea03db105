"""Copies of a submission's packages in a catkin workspace of its own, repaired for this machine."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Match, NamedTuple, Sequence, Tuple
from xml.sax.saxutils import escape

from catkin_pkg.package import parse_package

from husky_grading.hand_in.archives import MAX_BYTES, MAX_FILE, OWNER_EXECUTES, large_files_note
from husky_grading.hand_in.packages import BUILT, Package
from husky_grading.isolation.files import file_suffix, is_regular, remove_tree, walk

MAX_TEXT = 1_000_000  # [bytes] paths of another computer are replaced only in launch files up to this size
# First line of a Python script. It may name a program that exists only on the student's computer, such as
# python2 or /home/ann/anaconda3/bin/python3. An editor on Windows adds a carriage return to the name.
_PYTHON = re.compile(rb"#!.*\bpython[\d.]*(?:\s.*)?")
# first lines of a Python script that are right on every machine with ROS Noetic
_USUAL_PYTHON = {b"#!/usr/bin/env python3", b"#!/usr/bin/python3"}
_HOME = re.compile(r"/(?:home|Users)/[^\s\"'<>$]+")  # path below a home folder of Linux or macOS


@dataclass(frozen=True)
class Folders:
    """A catkin workspace on disk."""

    root: Path
    # folder of each package's sources, by the name of the package
    packages: Dict[str, Path] = field(default_factory=dict)

    @property
    def setup(self) -> Path:
        """Return the setup file that the build writes."""
        return self.root / "devel" / "setup.bash"

    @property
    def stand_ins(self) -> Path:
        """Return the folder of empty CMake packages in place of missing ones; the build cannot write it."""
        return self.root.with_name("stand_ins") / "prefix"

    @property
    def log(self) -> Path:
        """Return the file with the output of the build, which the build itself cannot write."""
        return self.root.with_name("build.log")


def copy_packages(packages: Sequence[Package], root: Path) -> Tuple[Folders, List[str]]:
    """Copy packages into a new catkin workspace at `root`, and return its folders and notes for the student.

    Links, special files, build folders and too large files are left out. The copies are repaired where they
    work only on the student's computer: modes and first lines of scripts, package.xml, paths in launch files.
    """
    remove_tree(root)
    (root / "src").mkdir(parents=True)
    notes: List[str] = []
    large: List[str] = []  # names of files that are too large, and are left out
    room = MAX_BYTES  # [bytes] packages that are not copied yet may have this size together
    copies: Dict[str, Path] = {}
    for package in packages:
        copies[package.name] = root / "src" / package.name
        copied = _copy_package(package, copies[package.name], room)
        room -= copied.size
        large += copied.large
        if copied.made_executable:
            names = ", ".join(copied.made_executable)
            notes.append(f"scripts were made executable, because an archive may lose this: {names}")
        if copied.other_interpreter:
            names = ", ".join(copied.other_interpreter)
            notes.append(f"scripts run by Python 3 instead of the program in their first line: {names}")
        notes += _repair_manifest(copies[package.name], package)
    notes += large_files_note(large)
    paths: List[str] = []
    for folder in copies.values():
        paths += _repair_paths(folder, copies)
    if paths:
        shown = ", ".join(dict.fromkeys(paths))  # each path once
        notes.append(f"paths of another computer were replaced by files of the submission: {shown}")
    (root / "src" / ".catkin_workspace").touch()  # marks a workspace, as catkin does
    return Folders(root, copies), notes


class _CopiedPackage(NamedTuple):
    """Facts of a copy of a package; files are given by their names."""

    size: int  # [bytes] size of all files that were copied
    large: List[str]  # names of files that were too large to be copied
    made_executable: List[str]  # scripts that the copy has made executable
    other_interpreter: List[str]  # scripts whose first line was changed, so that Python 3 runs them


def _copy_package(package: Package, target: Path, room: int) -> _CopiedPackage:
    """Copy the files of a package into a new folder, and make scripts executable.

    A file of more than MAX_FILE bytes is left out. A file that does not fit into the rest of `room` [bytes]
    is left out, too. The smallest files are copied first, so that large files are left out before small ones.
    """
    copied_size = 0  # [bytes] size of all files that were copied so far
    large: List[str] = []
    made_executable: List[str] = []
    other_interpreter: List[str] = []
    target.mkdir()
    # sizes of the contents, and not of the blocks on the disk, because the copy of a sparse file takes its
    # full size
    sizes = {path: path.stat().st_size for path in walk(package.path, BUILT)}
    for path, size in sorted(sizes.items(), key=lambda entry: entry[1]):
        if size > MAX_FILE or size > room - copied_size:
            large.append(path.name)
            continue
        copied_size += size
        copy = target / path.relative_to(package.path)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
        is_executable = bool(path.stat().st_mode & OWNER_EXECUTES)
        with copy.open("rb") as file:
            is_script = file.read(2) == b"#!"
        if is_script and _repair_interpreter(copy):
            other_interpreter.append(path.name)
        if is_script and not is_executable:
            made_executable.append(path.name)
        copy.chmod(0o755 if is_executable or is_script else 0o644)
    return _CopiedPackage(copied_size, large, made_executable, other_interpreter)


def _repair_interpreter(script: Path) -> bool:
    """Let the usual Python 3 run a Python script whose first line names another program.

    This machine may not have the other program. Returns whether the script was changed.
    """
    line, _, code = script.read_bytes().partition(b"\n")
    is_usual = line.replace(b"#! ", b"#!") in _USUAL_PYTHON  # a blank after #! has no effect
    if not _PYTHON.fullmatch(line) or is_usual:
        return False
    script.write_bytes(b"#!/usr/bin/env python3\n" + code)
    return True


def _repair_paths(folder: Path, packages: Dict[str, Path]) -> List[str]:
    """Replace paths such as /home/ann/ws/src/PACKAGE/FILE in launch files by $(find PACKAGE)/FILE.

    Such a path exists only on the student's computer. It is replaced only if one of the packages has such a
    file.

    Args:
        folder: package whose launch files are changed.
        packages: folders of all packages of the submission, by name.

    Returns:
        The paths that were replaced.
    """
    paths: List[str] = []

    def local_path(match: Match[str]) -> str:
        """Return the text that replaces a path below /home; the path itself if no package has the file."""
        path = match.group()
        for name, package in packages.items():
            # split the path at the name of the package: `place` is the part behind the name, and `separator`
            # is empty if the path does not contain the name
            _, separator, place = path.rpartition(f"/{name}/")
            if separator and ".." not in place and is_regular(package / place):
                paths.append(path)
                return f"$(find {name})/{place}"
        return path

    for file in walk(folder):
        if file_suffix(file) == ".launch" and file.stat().st_size <= MAX_TEXT:
            # with "surrogateescape", bytes that are not UTF-8 are written back unchanged
            text = file.read_bytes().decode("utf-8", "surrogateescape")
            file.write_bytes(_HOME.sub(local_path, text).encode("utf-8", "surrogateescape"))
    return paths


def _repair_manifest(folder: Path, package: Package) -> List[str]:
    """Replace a package.xml that catkin rejects, such as one without an e-mail address, and return notes.

    The new file has only the package's name and dependencies, which are enough to build it. With the old
    file, catkin would build no package at all. `folder` is the copy of the package.
    """
    manifest = folder / "package.xml"
    # `read_manifest` has already read this file, and would have rejected XML entities, so catkin's parser is
    # safe here
    try:
        parse_package(str(manifest), warnings=[])
        return []
    except Exception as error:  # catkin's parser may raise any error for a hostile file
        refusal = str(error)
    depends = "".join(f"<depend>{escape(name)}</depend>" for name in sorted(package.needs) if name)
    manifest.write_text(
        f'<package format="2"><name>{package.name}</name><version>0.0.0</version>'
        '<description>Marked with this manifest.</description><maintainer email="a@b.org">a</maintainer>'
        f"<license>unknown</license><buildtool_depend>catkin</buildtool_depend>{depends}</package>\n"
    )
    # the last line of the error, with single blanks
    reason = " ".join((refusal.strip().splitlines() or ["unknown"])[-1].split())[:200]
    return [f"catkin rejects the package.xml of {package.name} ({reason}); a corrected copy was used"]
