"""Reader of the output of a build: missing packages and headers, errors, and hints.

In: the text that catkin_make, CMake and the compiler print. Out: names, and sentences for the student.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Optional, Sequence, Set

from husky_grading.hand_in.dependencies import debian_packages

_PLACEHOLDER = re.compile(r"\b_[1-9]\b")  # placeholder of boost::bind in an error of the compiler
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
# Line of a Python traceback with the relative path of a file. `build_error` has made the paths of the
# submission's files relative, so files of other programs do not match.
_TRACEBACK = re.compile(r'File "(?P<file>[^"/][^"]*)", line (?P<line>\d+)')


def missing_packages(output: str) -> Set[str]:
    """Return the names of the packages that CMake did not find."""
    return set(_NOT_FOUND.findall(output))


def has_compiler_error(output: str) -> bool:
    """Return whether the compiler has found an error in the code."""
    return bool(_ERROR.search(output))


def misses_header(output: str) -> bool:
    """Return whether the compiler did not find a header; a second build may find a generated one."""
    return bool(_NO_HEADER.search(output))


def needs_old_boost(output: str) -> bool:
    """Return whether a build has failed at a placeholder of an old version of Boost, such as _1."""
    errors = [line for line in output.splitlines() if "error:" in line or "was not declared" in line]
    return any(map(_PLACEHOLDER.search, errors))


def missing_return(output: str, root: Path) -> Optional[str]:
    """Return file, line and warning of the first C++ function that forgets to return its value, or None.

    `root` is the workspace of the submission; the student knows only paths inside it.
    """
    warning = _MISSING_RETURN.search(output.replace(f"{root}/src/", ""))
    return f"{warning['where']}: {warning['what']}" if warning else None


def _compiler_error(output: str) -> str:
    """Return the compiler's first error in the output of a build; empty if there is none.

    If a header of a ROS package is missing, and apt has this package, the text ends with the command that
    installs the package.
    """
    match = _ERROR.search(output)
    if not match:
        return ""
    error = f"{match['where']}: {match['what']}"[:300]
    # a missing header such as `tf2/utils.h` belongs to the ROS package tf2, which apt may have
    missing_header = re.match(r"([\w-]+)/[\w./-]+: No such file", match["what"])
    if missing_header:
        package = missing_header.group(1)
        debian = debian_packages([package])
        if package in debian:
            return f"{error} (apt install {debian[package]})"
    return error


def _traceback_place(lines: Sequence[str]) -> str:
    """Return file and line of a Python error, such as "setup.py:3: "; empty if there is no traceback."""
    entries = [entry for entry in map(_TRACEBACK.search, lines) if entry]
    if not entries:
        return ""
    last = entries[-1]  # the last entry of a traceback is the place of the error
    return f"{last['file']}:{last['line']}: "


def build_error(output: str, root: Path) -> str:
    """Return the reason for a failed build, for the student: the compiler's first error, if there is one.

    Otherwise, the most informative line of the output is returned. `root` is the workspace of the submission.
    """
    # the student knows only paths inside the submission
    output = output.replace(f"{root}/src/", "").replace(f"{root}/", "")
    compiler_error = _compiler_error(output)
    if compiler_error:
        return compiler_error
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    for number, line in enumerate(lines):
        # This line of CMake reports that a program of the build has failed. The line before it is the last
        # output of the program, and gives the cause.
        if number and _PROGRAM_FAILED.search(line):
            return f"{_traceback_place(lines[:number])}{lines[number - 1]}"[:300]
    # patterns of lines with errors, the most informative pattern first
    for pattern in (r"^CMake Error", r"undefined reference", r"\bError\b|error"):
        for number, line in enumerate(lines):
            if re.search(pattern, line):
                return " ".join(lines[number : number + 2])[:300]  # the next line often gives the cause
    return " ".join(lines[-2:])[:300]
