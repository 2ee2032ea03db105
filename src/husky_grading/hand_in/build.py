"""Build of a submission: its packages in a catkin workspace of its own, in the sandbox."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, FrozenSet, List, Match, NamedTuple, Optional, Sequence, Set, Tuple
from xml.sax.saxutils import escape

from catkin_pkg.package import parse_package

from husky_grading.hand_in.archives import MAX_BYTES, MAX_FILE, OWNER_EXECUTES, large_files_note
from husky_grading.hand_in.dependencies import debian_packages, missing_note
from husky_grading.hand_in.packages import BUILT, NotMarkableError, Package
from husky_grading.isolation.files import (
    UnreadableFileError,
    file_suffix,
    is_below,
    is_regular,
    read_regular,
    remove_tree,
    walk,
    write_whole,
)
from husky_grading.isolation.forked import import_early
from husky_grading.isolation.own_files import VisibleCode
from husky_grading.isolation.process import Process, wait_and_kill
from husky_grading.isolation.ros_network import MarkingError
from husky_grading.isolation.sandbox import Workspace, clean_environment
from husky_grading.notes import Kind, Note

BUILD_DEADLINE = 600.0  # [s] longest wall time of each build
MAX_TEXT = 1_000_000  # [bytes] paths of another computer are replaced only in launch files up to this size
# at most this number of builds look for missing packages; CMake reports only one missing package in each
# build
MAX_BUILDS = 10
# at most this number of missing packages get an empty replacement, because the output of a build can name any
# number of packages
MAX_STAND_INS = 50
# [kB] GCC collects garbage only if it uses more memory than this; compiling is then a tenth faster
LESS_COLLECTION = "--param ggc-min-heapsize=500000"
# The compiler includes this header first in each C++ source. If a build fails, the grader may repair it by a
# change of this header only, so CMake does not run again.
PRELUDE = "marking_prelude.h"
# with these headers, code such as publish(true) compiles; in ROS Noetic and older, a Release build compiles
# such code without them
PLAIN_TYPES = "\n".join(
    ["#if defined(ROS_PACKAGE_NAME) && __has_include(<std_msgs/builtin_bool.h>)"]
    + [f"#include <std_msgs/builtin_{kind}.h>" for kind in ("bool", "float", "double")]
    + [f"#include <std_msgs/builtin_{sign}int{bits}.h>" for sign in ("", "u") for bits in (8, 16, 32, 64)]
    + ["#endif\n"]
)
# this text lets code for old versions of Boost compile, because it makes _1 known without a namespace
OLD_BOOST = "#define BOOST_BIND_GLOBAL_PLACEHOLDERS\n#include <boost/bind.hpp>\n"
_PLACEHOLDER = re.compile(r"\b_[1-9]\b")  # placeholder of boost::bind in an error of the compiler
OLD_BOOST_NOTE = (
    "_1 of boost::bind was made to compile; newer versions of Boost call it boost::placeholders::_1"
)
# name of a function that is in a compiled program if it calls ros::Publisher::publish with a bool or a number
PLAIN_PUBLISH = re.compile(rb"_ZNK3ros9Publisher7publishI[abcdfhijlmstxy]EEvRKT_")
PLAIN_PUBLISH_NOTE = (
    "publish(true) and the like were made to compile; newer versions of ROS need a message, such as "
    "std_msgs::Bool"
)
# first line of a script that names python or python2, or that ends with a carriage return, as on Windows
_OTHER_PYTHON = re.compile(rb"#!.*\bpython(?:(?:2(?:\.\d+)?)?\s*|3\s+)")
_HOME = re.compile(r"/(?:home|Users)/[^\s\"'<>$]+")  # path below a home folder of Linux or macOS
# CMake's error for a missing package
_NOT_FOUND = re.compile(r'Could not find a package configuration file provided by\s+"([\w-]{1,100})"')
# the compiler's error, with file and line (`where`)
_ERROR = re.compile(r"^(?P<where>[^\s:][^:\n]*:\d+(?::\d+)?): (?:fatal )?error: (?P<what>.*)$", re.MULTILINE)
# the compiler's warning for a function that must return a value, but does not
_MISSING_RETURN = re.compile(
    r"^(?P<where>[^\s:][^:\n]*:\d+)(?::\d+)?: warning: "
    r"(?P<what>no return statement in function returning non-void|control reaches end of non-void function)",
    re.MULTILINE,
)
# pattern of the compiler's error for a missing header; a second build may find a header that the first one
# generated too late
_NO_HEADER = re.compile(r"fatal error: \S+: No such file or directory")
# CMake writes this line if a program that it calls fails
_PROGRAM_FAILED = re.compile(r"^CMake Error at .*/safe_execute_process\.cmake:")
# line of a Python traceback that is in a file of the submission; `build_error` makes only such paths relative
_TRACEBACK = re.compile(r'File "(?P<file>[^"/][^"]*)", line (?P<line>\d+)')


class BuildOutcome(NamedTuple):
    """Result of one call of catkin_make."""

    output: str
    code: Optional[int]  # exit code, 0 if the build succeeded; None if the build did not end in time


# configuration of a missing CMake package that satisfies CMake, but has no content
_STAND_IN = """# {name} is not installed; code that uses nothing of it builds without it
set({name}_FOUND TRUE)
set({name}_FOUND_CATKIN_PROJECT TRUE)
set({name}_INCLUDE_DIRS "")
set({name}_LIBRARIES "")
function(roslint_cpp)
endfunction()
function(roslint_python)
endfunction()
function(roslint_add_test)
endfunction()
"""


@dataclass(frozen=True)
class Build:
    """Result of the build of a submission."""

    workspace: Workspace
    # notes on the build; if the build failed, a note of kind BUILD has the reason
    notes: Tuple[Note, ...] = ()


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
    """Copy packages into a new workspace at `root`, and return its folders and notes for the student.

    Links, special files, build folders and too large files are left out. Copies are repaired if an archive or
    another computer has spoilt them: modes and interpreters of scripts, package.xml, paths in launch files.
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
    paths = [path for folder in copies.values() for path in _repair_paths(folder, copies)]
    if paths:
        shown = ", ".join(dict.fromkeys(paths))
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
    copied = _CopiedPackage(size=0, large=[], made_executable=[], other_interpreter=[])
    target.mkdir()
    # sizes of the contents, and not of the blocks on the disk, because the copy of a sparse file takes its
    # full size
    sizes = {path: path.stat().st_size for path in walk(package.path, BUILT)}
    for path, size in sorted(sizes.items(), key=lambda entry: entry[1]):
        # a file is left out if it is larger than one file may be, or larger than the bytes that are left
        if size > min(MAX_FILE, room - copied.size):
            copied.large.append(path.name)
            continue
        copied = copied._replace(size=copied.size + size)
        copy = target / path.relative_to(package.path)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
        is_executable = bool(path.stat().st_mode & OWNER_EXECUTES)
        with copy.open("rb") as file:
            is_script = file.read(2) == b"#!"
        if is_script and _repair_interpreter(copy):
            copied.other_interpreter.append(path.name)
        if is_script and not is_executable:
            copied.made_executable.append(path.name)
        copy.chmod(0o755 if is_executable or is_script else 0o644)
    return copied


def _repair_interpreter(script: Path) -> bool:
    """Let Python 3 run a script that names another Python, or whose first line ends as on Windows.

    Return whether the script was changed.
    """
    line, _, code = script.read_bytes().partition(b"\n")
    if _OTHER_PYTHON.fullmatch(line):
        script.write_bytes(b"#!/usr/bin/env python3\n" + code)
        return True
    return False


def _repair_paths(folder: Path, packages: Dict[str, Path]) -> List[str]:
    """Replace paths of the student's computer in launch files by $(find PACKAGE)/...

    A path is replaced only if one of the packages has such a file. The replaced paths are returned.
    """
    paths: List[str] = []

    def local_path(match: Match[str]) -> str:
        """Return the text that replaces a path below /home; the path itself if no package has the file."""
        for name, package in packages.items():
            # split the path at the name of the package: `place` is the part behind the name, and `separator`
            # is empty if the path does not contain the name
            _, separator, place = match.group().rpartition(f"/{name}/")
            if separator and ".." not in place and is_regular(package / place):
                paths.append(match.group())
                return f"$(find {name})/{place}"
        return match.group()

    for path in walk(folder):
        if file_suffix(path) == ".launch" and path.stat().st_size <= MAX_TEXT:
            text = path.read_bytes().decode("utf-8", "surrogateescape")
            path.write_bytes(_HOME.sub(local_path, text).encode("utf-8", "surrogateescape"))
    return paths


def _repair_manifest(folder: Path, package: Package) -> List[str]:
    """Replace a package.xml that catkin rejects, such as one without an e-mail address, and return notes."""
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


def build(folders: Folders, needed: FrozenSet[str], underlay: Workspace) -> Build:
    """Build the needed packages of a submission; the other packages are used without a build.

    A build may fail on another machine without a fault of the student. So it is repeated with stand-ins for
    packages that are not installed, and then with a repair for an old version of Boost.

    Raises:
        NotMarkableError: the build has made a link that leads out of the workspace.
        MarkingError: nothing can be built here.
    """
    first_outcome, missing, needed = _make_with_stand_ins(folders, needed, underlay)
    (output, code), used_old_boost = _make_again(folders, needed, underlay, first_outcome)
    # if the build failed without an error of the compiler, the fault may be this machine's, so an empty
    # workspace is built as a test
    if code and not _ERROR.search(output):
        _check_machine_builds(folders.root.with_name("check"), underlay)
    if code == 0:
        # The server process of `forked` imports its modules while the run is prepared, so the run begins
        # sooner. A submission that does not build normally has no run, so it does not need them.
        import_early()
    notes = _notes_on_missing(missing)
    if used_old_boost:
        notes.append(Note(Kind.HAND_IN, OLD_BOOST_NOTE))
    # PLAIN_TYPES lets code such as publish(true) compile, so the student gets a note on such code
    if _publishes_plain_values(folders.root / "devel" / "lib"):
        notes.append(Note(Kind.HAND_IN, PLAIN_PUBLISH_NOTE))
    notes += _notes_on_outcome(output, code, folders.root)
    return Build(_built_workspace(folders, underlay), tuple(notes))


def _make_with_stand_ins(
    folders: Folders, needed: FrozenSet[str], underlay: Workspace
) -> Tuple[BuildOutcome, Set[str], FrozenSet[str]]:
    """Build until CMake misses no further package, and return outcome, missing packages and built packages.

    CMake stops at a missing package. If this package is part of the submission, a package.xml does not name
    it as a dependency. So the next attempt builds it, too. The student's catkin_make builds all packages, so
    the student has not noticed this. Any other missing package gets an empty stand-in.
    """
    missing: Set[str] = set()
    outcome = BuildOutcome("", None)
    for _ in range(MAX_BUILDS):
        outcome = _catkin_make(folders, needed, underlay, repair="")
        not_found = set(_NOT_FOUND.findall(outcome.output))
        forgotten = not_found & set(folders.packages) - needed  # handed in, but not built yet
        # packages that CMake did not find, without those that already have a stand-in or are handed in
        unknown = not_found - missing - set(folders.packages)
        # all builds together replace at most MAX_STAND_INS missing packages
        new = sorted(unknown)[: MAX_STAND_INS - len(missing)]
        if not outcome.code or not (new or forgotten):
            break
        needed |= forgotten
        missing |= set(new)
        for name in new:
            place = folders.stand_ins / "share" / name / "cmake"
            place.mkdir(parents=True, exist_ok=True)
            write_whole(place / f"{name}Config.cmake", _STAND_IN.format(name=name))
    return outcome, missing, needed


def _make_again(
    folders: Folders, needed: FrozenSet[str], underlay: Workspace, outcome: BuildOutcome
) -> Tuple[BuildOutcome, bool]:
    """Build again if the first build failed for a reason that can be repaired.

    If a header was missing, the first build may have generated it too late for the code that needs it. Code
    for an old version of Boost is compiled with OLD_BOOST.

    Returns:
        The outcome of the last build, and whether it used OLD_BOOST.
    """
    # text that is compiled before each source
    repair = OLD_BOOST if outcome.code and needs_old_boost(outcome.output) else ""
    if outcome.code and (repair or _NO_HEADER.search(outcome.output)):
        outcome = _catkin_make(folders, needed, underlay, repair=repair)
    if outcome.code and not repair and needs_old_boost(outcome.output):
        # the errors of code for an old version of Boost may appear only in the second build
        repair = OLD_BOOST
        outcome = _catkin_make(folders, needed, underlay, repair=repair)
    return outcome, bool(repair)


def _notes_on_missing(missing: Set[str]) -> List[Note]:
    """Return notes on packages that are not installed."""
    notes = []
    if missing:
        notes.append(Note(Kind.MISSING_PACKAGE, missing_note(missing)))
    if len(missing) == MAX_STAND_INS:
        text = f"{MAX_STAND_INS} packages or more are missing; further ones got no stand-in"
        notes.append(Note(Kind.MISSING_PACKAGE, text))
    return notes


def _notes_on_outcome(output: str, code: Optional[int], root: Path) -> List[Note]:
    """Return notes on a failed build, and on a C++ function that forgets to return its value.

    `code` is the exit code of the build; None if the build did not end in time.
    """
    notes = []
    if code is None:
        notes.append(Note(Kind.BUILD, f"it does not build within {BUILD_DEADLINE:g} s"))
    elif code:
        notes.append(Note(Kind.BUILD, f"it does not build: {build_error(output, root)}"))
    if warning := _MISSING_RETURN.search(output.replace(f"{root}/src/", "")):
        text = f"{warning['where']}: {warning['what']}; a node crashes there, or continues anywhere"
        notes.append(Note(Kind.MISSING_RETURN, text))
    return notes


def _built_workspace(folders: Folders, underlay: Workspace) -> Workspace:
    """Return the workspace of the submission's packages on top of the underlay, after a build.

    Raises:
        NotMarkableError: the build has replaced a folder or file that marking uses by a link.
    """
    sources = folders.root / "src"
    new_setups = [folders.setup] if folders.setup.exists() else []  # a failed build may have written none
    # a link could lead out of the workspace; then the sandbox would show its target to the submission, and
    # marking would write into the target
    places = [sources, *new_setups, *folders.packages.values()]
    if not all(is_below(place, folders.root) for place in places):
        raise NotMarkableError("its build replaces src or devel/setup.bash by a link; remove that step")
    setups = (*underlay.setups, *new_setups)
    packages = (*underlay.packages, sources)
    return Workspace(setups, packages, hidden=underlay.hidden, own=VisibleCode.NOTHING)


def _check_machine_builds(folder: Path, underlay: Workspace) -> None:
    """Build an empty workspace. If this fails, too, the fault is this machine's and not the submission's.

    Raises:
        MarkingError: nothing can be built here.
    """
    empty = Folders(folder / "ws")
    (empty.root / "src").mkdir(parents=True, exist_ok=True)
    output, code = _catkin_make(empty, needed=frozenset(), underlay=underlay, repair="")
    remove_tree(folder)
    if code != 0:
        raise MarkingError(f"catkin_make cannot build even an empty workspace: {build_error(output, folder)}")


def needs_old_boost(output: str) -> bool:
    """Return whether a build has failed at a placeholder of an old version of Boost, such as _1."""
    errors = [line for line in output.splitlines() if "error:" in line or "was not declared" in line]
    return any(map(_PLACEHOLDER.search, errors))


def _publishes_plain_values(libraries: Path) -> bool:
    """Return whether a built program publishes a bool or a number instead of a message."""
    with contextlib.suppress(UnreadableFileError):  # too many files
        for path in walk(libraries):
            with contextlib.suppress(UnreadableFileError):
                if PLAIN_PUBLISH.search(read_regular(path)):
                    return True
    return False


def _catkin_make(folders: Folders, needed: FrozenSet[str], underlay: Workspace, repair: str) -> BuildOutcome:
    """Build the packages with the names `needed` once, for at most BUILD_DEADLINE.

    `repair` is text that is compiled before each C++ source.
    """
    folders.stand_ins.mkdir(parents=True, exist_ok=True)
    # with PLAIN_TYPES, code such as publish(true) compiles
    write_whole(folders.stand_ins / PRELUDE, repair + PLAIN_TYPES)
    env = {**clean_environment(), "HOME": str(folders.root), "CPLUS_INCLUDE_PATH": str(folders.stand_ins)}
    # the empty packages that replace missing ones come last, so that a package that exists is found first
    env["CMAKE_PREFIX_PATH"] = os.pathsep.join(
        filter(None, [env.get("CMAKE_PREFIX_PATH", ""), str(folders.stand_ins)])
    )
    command = [
        "catkin_make", "-C", str(folders.root), f"-DPYTHON_EXECUTABLE={sys.executable}",
        "-DCATKIN_ENABLE_TESTING=0", f"-DCATKIN_WHITELIST_PACKAGES={';'.join(sorted(needed))}",
        # with -g1, valgrind gives the lines of the code; with LESS_COLLECTION, GCC compiles faster
        f"-DCMAKE_CXX_FLAGS=-g1 {LESS_COLLECTION} -include {PRELUDE}",
        "-DCMAKE_C_COMPILER_WORKS=1", "-DCMAKE_CXX_COMPILER_WORKS=1",  # saves CMake's test of the compilers
        # with -k, make builds other programs after an error; no option -l, because with -l make waits while
        # other programs use the CPU
        "--make-args", "-k", f"-j{os.cpu_count()}",
    ]  # fmt: skip
    process = Process(command, folders.log, env, folders.root, underlay)
    in_time = wait_and_kill(process, BUILD_DEADLINE, period=0.2)
    output = process.output + (f"\n{process.problem}" if process.problem else "")
    return BuildOutcome(output, process.popen.returncode if in_time else None)


def is_built(node: str, folders: Folders) -> bool:
    """Return whether a node, package/type, can be started, as a built program or an executable script.

    A node of a package that was not submitted counts as built.
    """
    package, _, name = node.partition("/")
    if package not in folders.packages:
        return True  # a node that does not belong to the submission needs no build
    candidates = [folders.root / "devel" / "lib" / package / name]
    candidates += [path for path in walk(folders.packages[package]) if path.name == name]
    return any(is_regular(path) and os.access(path, os.X_OK) for path in candidates)


def build_error(output: str, root: Path) -> str:
    """Return the compiler's first error; if there is none, the most informative line of the output."""
    # the student knows only paths inside the submission
    output = output.replace(f"{root}/src/", "").replace(f"{root}/", "")
    match = _ERROR.search(output)
    if match:
        # a header such as `tf2/utils.h` belongs to the ROS package tf2, which apt may have
        missing_header = re.match(r"([\w-]+)/[\w./-]+: No such file", match["what"])
        debian = debian_packages([missing_header.group(1)]).values() if missing_header else ()
        hint = "".join(f" (apt install {package})" for package in debian)
        return f"{match['where']}: {match['what']}"[:300] + hint
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    for number, line in enumerate(lines):
        # This line of CMake reports that a program of the build has failed. The line before it is the last
        # output of the program, and gives the cause. A Python traceback gives file and line.
        if number and _PROGRAM_FAILED.search(line):
            entries = [entry for entry in map(_TRACEBACK.search, lines[:number]) if entry]
            innermost = entries[-1] if entries else None
            place = f"{innermost['file']}:{innermost['line']}: " if innermost else ""
            return f"{place}{lines[number - 1]}"[:300]
    # patterns of lines with errors, the most informative pattern first
    for pattern in (r"^CMake Error", r"undefined reference", r"\bError\b|error"):
        for number, line in enumerate(lines):
            if re.search(pattern, line):
                return " ".join(lines[number : number + 2])[:300]  # the next line often gives the cause
    return " ".join(lines[-2:])[:300]
