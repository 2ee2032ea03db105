"""Build of a submission: its packages in a catkin workspace of its own, in the sandbox."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import FrozenSet, List, NamedTuple, Optional, Set, Tuple

from husky_grading.hand_in.build_output import (
    build_error,
    has_compiler_error,
    misses_header,
    missing_packages,
    missing_return,
    needs_old_boost,
)
from husky_grading.hand_in.copies import Folders
from husky_grading.hand_in.dependencies import missing_note
from husky_grading.hand_in.packages import NotMarkableError
from husky_grading.isolation.files import (
    UnreadableFileError,
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
# Newer versions of ROS compile code such as publish(true) only with these headers. Students may hand in such
# code, because in ROS Noetic and older, a Release build compiles it without these headers.
PLAIN_TYPES = "\n".join(
    ["#if defined(ROS_PACKAGE_NAME) && __has_include(<std_msgs/builtin_bool.h>)"]
    + [f"#include <std_msgs/builtin_{kind}.h>" for kind in ("bool", "float", "double")]
    + [f"#include <std_msgs/builtin_{sign}int{bits}.h>" for sign in ("", "u") for bits in (8, 16, 32, 64)]
    + ["#endif\n"]
)
# this text lets code for old versions of Boost compile, because it makes _1 known without a namespace
OLD_BOOST = "#define BOOST_BIND_GLOBAL_PLACEHOLDERS\n#include <boost/bind.hpp>\n"
OLD_BOOST_NOTE = (
    "_1 of boost::bind was made to compile; newer versions of Boost call it boost::placeholders::_1"
)
# name of a function that is in a compiled program if it calls ros::Publisher::publish with a bool or a number
PLAIN_PUBLISH = re.compile(rb"_ZNK3ros9Publisher7publishI[abcdfhijlmstxy]EEvRKT_")
PLAIN_PUBLISH_NOTE = (
    "publish(true) and the like were made to compile; newer versions of ROS need a message, such as "
    "std_msgs::Bool"
)


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


def build(folders: Folders, needed: FrozenSet[str], underlay: Workspace) -> Build:
    """Build the needed packages of a submission; the other packages are used without a build.

    A build may fail here although the same code builds on the student's machine. So a failed build is
    repeated, first with empty packages in place of those that are not installed, and then with a repair for
    code that was written for an old version of Boost.

    Raises:
        NotMarkableError: the build has made a link that leads out of the workspace.
        MarkingError: nothing can be built here.
    """
    first_outcome, stand_ins, needed = _make_with_stand_ins(folders, needed, underlay)
    outcome, used_old_boost = _make_again_if_repairable(folders, needed, underlay, first_outcome)
    # if the build failed without an error of the compiler, the fault may be this machine's, so an empty
    # workspace is built as a test
    if outcome.code and not has_compiler_error(outcome.output):
        _check_machine_builds(folders.root.with_name("check"), underlay)
    if outcome.code == 0:
        # another process now imports the modules of the programs of a run, so that the run begins sooner;
        # after a failed build there is usually no run
        import_early()
    notes = _notes_on_build(folders.root, stand_ins, used_old_boost, outcome)
    return Build(_built_workspace(folders, underlay), tuple(notes))


def _make_with_stand_ins(
    folders: Folders, needed: FrozenSet[str], underlay: Workspace
) -> Tuple[BuildOutcome, Set[str], FrozenSet[str]]:
    """Build until CMake misses no further package, and return outcome, stand-ins and built packages.

    CMake stops at a package that it does not find. There are two cases:

    - The package is part of the submission, but is not among the needed packages, because a package.xml does
      not name it as a dependency. Then the next attempt builds it, too. On the student's computer, this
      fault has no effect, because catkin_make builds all packages there.
    - The package is not installed here. Then it gets a stand-in: an empty package of this name. Code that
      uses nothing of the package builds with the stand-in.

    Args:
        folders: workspace with the packages of the submission.
        needed: names of the packages that the first attempt builds.
        underlay: workspace below the submission.

    Returns:
        The outcome of the last attempt, the names of the stand-ins, and the names of all packages that were
        built.
    """
    handed_in = set(folders.packages)
    stand_ins: Set[str] = set()
    outcome = BuildOutcome("", None)
    for _ in range(MAX_BUILDS):
        outcome = _catkin_make(folders, needed, underlay, repair="")
        # the build has taken too long, or has succeeded
        if outcome.code is None or outcome.code == 0:
            break
        not_found = missing_packages(outcome.output)
        forgotten = (not_found & handed_in) - needed
        not_installed = not_found - handed_in - stand_ins
        # the stand-ins of all attempts together are at most MAX_STAND_INS
        new_stand_ins = sorted(not_installed)[: MAX_STAND_INS - len(stand_ins)]
        if not forgotten and not new_stand_ins:
            break  # the build fails for another reason
        needed |= forgotten
        stand_ins |= set(new_stand_ins)
        for name in new_stand_ins:
            _write_stand_in(folders, name)
    return outcome, stand_ins, needed


def _write_stand_in(folders: Folders, name: str) -> None:
    """Write an empty CMake package in place of a missing one."""
    place = folders.stand_ins / "share" / name / "cmake"
    place.mkdir(parents=True, exist_ok=True)
    write_whole(place / f"{name}Config.cmake", _STAND_IN.format(name=name))


def _make_again_if_repairable(
    folders: Folders, needed: FrozenSet[str], underlay: Workspace, outcome: BuildOutcome
) -> Tuple[BuildOutcome, bool]:
    """Build again if the first build, with this outcome, failed for a reason that can be repaired.

    If a header was missing, the first build may have generated it too late for the code that needs it, so
    the second build finds it. Code for an old version of Boost is compiled with OLD_BOOST.

    Returns:
        The outcome of the last build, and whether it used OLD_BOOST.
    """
    if not outcome.code:  # the build has succeeded or has taken too long
        return outcome, False
    if not needs_old_boost(outcome.output):
        if not misses_header(outcome.output):
            return outcome, False
        outcome = _catkin_make(folders, needed, underlay, repair="")
        # the errors of code for an old version of Boost may appear only in this second build
        if not outcome.code or not needs_old_boost(outcome.output):
            return outcome, False
    return _catkin_make(folders, needed, underlay, repair=OLD_BOOST), True


def _notes_on_build(root: Path, missing: Set[str], used_old_boost: bool, outcome: BuildOutcome) -> List[Note]:
    """Return notes for the student on what was replaced or repaired in the build, and on its errors.

    Args:
        root: workspace of the submission.
        missing: names of the packages that are not installed, and got an empty stand-in.
        used_old_boost: true if the build used OLD_BOOST.
        outcome: outcome of the last build.
    """
    notes = []
    if missing:
        notes.append(Note(Kind.MISSING_PACKAGE, missing_note(missing)))
    if len(missing) == MAX_STAND_INS:
        text = f"{MAX_STAND_INS} packages or more are missing; further ones got no stand-in"
        notes.append(Note(Kind.MISSING_PACKAGE, text))
    if used_old_boost:
        notes.append(Note(Kind.HAND_IN, OLD_BOOST_NOTE))
    # PLAIN_TYPES lets code such as publish(true) compile, so the student gets a note on such code
    if _publishes_plain_values(root / "devel" / "lib"):
        notes.append(Note(Kind.HAND_IN, PLAIN_PUBLISH_NOTE))
    if outcome.code is None:
        notes.append(Note(Kind.BUILD, f"it does not build within {BUILD_DEADLINE:g} s"))
    elif outcome.code:
        notes.append(Note(Kind.BUILD, f"it does not build: {build_error(outcome.output, root)}"))
    # a C++ function that must return a value, but does not
    if place := missing_return(outcome.output, root):
        text = f"{place}; a node crashes there, or continues anywhere"
        notes.append(Note(Kind.MISSING_RETURN, text))
    return notes


def _built_workspace(folders: Folders, underlay: Workspace) -> Workspace:
    """Return the workspace in which the submission's built packages are found, on top of the underlay.

    Raises:
        NotMarkableError: the build has put a link in place of a folder or file that marking uses.
    """
    # a failed build may have written no setup file
    new_setups = [folders.setup] if folders.setup.exists() else []
    # `build` leaves out packages that the launch file does not need; ROS finds these by their sources
    sources = folders.root / "src"
    # The build runs code of the student, which may replace a folder by a link that leads out of the
    # workspace. Then the sandbox would show the link's target to the submission, and marking would write into
    # the target.
    places = [sources, *new_setups, *folders.packages.values()]
    if not all(is_below(place, folders.root) for place in places):
        raise NotMarkableError("its build replaces src or devel/setup.bash by a link; remove that step")
    return Workspace(
        setups=(*underlay.setups, *new_setups),
        packages=(*underlay.packages, sources),
        hidden=underlay.hidden,
        own=VisibleCode.NOTHING,
    )


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


def _publishes_plain_values(libraries: Path) -> bool:
    """Return whether a built program publishes a bool or a number instead of a message.

    `libraries` is the folder with the built programs. Such a program contains a function of roscpp whose
    name PLAIN_PUBLISH matches.
    """
    with contextlib.suppress(UnreadableFileError):  # too many files
        for path in walk(libraries):
            with contextlib.suppress(UnreadableFileError):
                if PLAIN_PUBLISH.search(read_regular(path)):
                    return True
    return False


def _catkin_make(folders: Folders, needed: FrozenSet[str], underlay: Workspace, repair: str) -> BuildOutcome:
    """Run catkin_make once in the sandbox, for at most BUILD_DEADLINE, and return output and exit code.

    Only the packages with the names `needed` are built. `repair` is C++ code that is compiled before each
    source.
    """
    folders.stand_ins.mkdir(parents=True, exist_ok=True)
    # with PLAIN_TYPES, code such as publish(true) compiles
    write_whole(folders.stand_ins / PRELUDE, repair + PLAIN_TYPES)
    env = {**clean_environment(), "HOME": str(folders.root), "CPLUS_INCLUDE_PATH": str(folders.stand_ins)}
    # the empty packages that replace missing ones come last, so that a package that exists is found first
    prefixes = [env["CMAKE_PREFIX_PATH"]] if env.get("CMAKE_PREFIX_PATH") else []
    env["CMAKE_PREFIX_PATH"] = os.pathsep.join([*prefixes, str(folders.stand_ins)])
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
    """Return whether a node, package/type, exists as a built program or as an executable script.

    A node of a package that was not submitted counts as built, because it needs no build.
    """
    package, _, name = node.partition("/")
    if package not in folders.packages:
        return True
    candidates = [folders.root / "devel" / "lib" / package / name]
    candidates += [path for path in walk(folders.packages[package]) if path.name == name]
    return any(is_regular(path) and os.access(path, os.X_OK) for path in candidates)
