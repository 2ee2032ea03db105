"""Sandbox for untrusted programs: bubblewrap if the machine allows it, otherwise a process namespace.

In: folders that a program may see and write. Out: a command that runs inside.

With bubblewrap a program sees the system's programs and settings, and the folders of its workspace, all
read-only. It does not see files in /etc that not every user may read. It can write only its own folder and
folders of temporary files. It sees only its own processes. docs/sandbox.md has the guarantees without
bubblewrap.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Dict, List, NamedTuple, Sequence, Set, Tuple

from husky_grading.isolation.limits import TEMPORARY, TEMPORARY_FILES, THREADS
from husky_grading.isolation.own_files import (
    IN_WORKSPACE,
    VisibleCode,
    folders_on_python_path,
    own_files,
)
from husky_highlevel_controller.datatypes import HuskyError

BUBBLEWRAP, NAMESPACE, NONE = "bubblewrap", "process namespace", "none"
# [bytes] largest file, and largest memory of one process
FILE_SIZE, PROCESS_MEMORY = 500_000_000, 4_000_000_000
# largest number of open files and sockets of one process; sockets are limited because they use memory of the
# kernel
DESCRIPTORS = 1024
PROBE_DEADLINE = 30.0  # [s] longest wall time of a test whether a kind of sandbox works on this machine
SEARCH_PATHS = ("PATH", "LD_LIBRARY_PATH", "PYTHONPATH", "CMAKE_PREFIX_PATH", "ROS_PACKAGE_PATH")
SYSTEM = ("bin", "etc", "lib", "lib32", "lib64", "libx32", "nix", "opt", "sbin", "sys", "usr")  # below /
# folders that are never shown as a whole, because they also have files that have nothing to do with ROS
NEVER_WHOLE = ("/", "/home", "/media", "/mnt", "/root", "/run", "/srv", "/tmp", "/var", "/var/tmp")
# environment variables of `grade` that a submission gets, too; it gets no others, because they may contain
# tokens or passwords
KEPT_VARIABLES = (
    *SEARCH_PATHS, "PKG_CONFIG_PATH", "LANG", "LC_ALL", "TZ", "ROSLISP_PACKAGE_DIRECTORIES",
    "ROS_DISTRO", "ROS_ETC_DIR", "ROS_PYTHON_VERSION", "ROS_ROOT", "ROS_VERSION", "PYTHONNOUSERSITE",
    "PYTHONDONTWRITEBYTECODE", "OPENBLAS_NUM_THREADS", "CMAKE_POLICY_VERSION_MINIMUM",
)  # fmt: skip

# In a private network (see `private_network`), the user who runs `grade` counts as root. Without --cap-drop,
# the submission would have the rights of root, too, and could undo the mounts that hide files from it.
_BUBBLEWRAP = [
    "--die-with-parent", "--new-session", "--unshare-user", "--unshare-pid", "--unshare-ipc",
    "--cap-drop", "ALL",
]  # fmt: skip
# option that forbids namespaces inside of the sandbox; versions of bubblewrap before 0.8 do not have it
_NO_NESTED_NAMESPACES = ["--disable-userns"]
# options of unshare(1) for a machine without bubblewrap: the program sees only its own processes
_NAMESPACE = ["--user", "--map-root-user", "--pid", "--fork", "--kill-child=SIGKILL", "--mount-proc", "--"]


def clean_environment() -> Dict[str, str]:
    """Return the environment of an untrusted program: only KEPT_VARIABLES of our environment, and USER.

    USER is set, because roslaunch rejects $(env USER) without it.
    """
    return {"USER": "student", **{name: os.environ[name] for name in KEPT_VARIABLES if name in os.environ}}


@dataclass(frozen=True)
class Workspace:
    """Setup files and folders that an untrusted program uses, and folders that it must not see."""

    setups: Tuple[Path, ...] = ()  # setup.bash files that are sourced in the sandbox, in this order
    # folders in which ROS finds packages that are not built; they are added to ROS_PACKAGE_PATH
    packages: Tuple[Path, ...] = ()
    # folders that the program must not see, such as other submissions and results
    hidden: Tuple[Path, ...] = ()
    own: VisibleCode = VisibleCode.ALL  # files of the grader's package that the program sees


def sandboxed(workspace: Workspace, command: Sequence[str], folder: Path, env: Dict[str, str]) -> List[str]:
    """Return the command line that runs `command` in the sandbox, with its workspace sourced there.

    `command` may write only the existing `folder`; `env` is its environment.
    """
    kind = kind_of_sandbox()
    limits = [
        system_program("prlimit"), f"--fsize={FILE_SIZE}", f"--data={PROCESS_MEMORY}", "--core=0",
        f"--nofile={DESCRIPTORS}",
    ]  # fmt: skip
    if kind != NONE:  # the limit would count all processes of this user if there were no sandbox
        limits.append(f"--nproc={THREADS}")
    # folders that the script removes from PYTHONPATH, so a submission cannot import our package
    removed = folders_on_python_path() if workspace.own is VisibleCode.NOTHING else []
    # arguments of the script: folders of packages, folders to remove, and setup files that it sources
    packages_list = os.pathsep.join(map(str, workspace.packages))
    removed_list = os.pathsep.join(map(str, removed))
    setups = [str(path.resolve()) for path in workspace.setups]
    source = [system_program("bash"), str(IN_WORKSPACE), packages_list, removed_list, *setups]
    # The command line from left to right: prlimit sets limits, bash sources the workspace, and stdbuf lets
    # the command write each line of its output at once.
    inner = [*limits, *source, "--", system_program("stdbuf"), "-oL", *command]
    if kind == BUBBLEWRAP:
        return [system_program("bwrap"), *_bubblewrap(), *_mounts(workspace, folder, env), "--", *inner]
    if kind == NAMESPACE:
        return [system_program("unshare"), *_NAMESPACE, *inner]
    return inner


@lru_cache(maxsize=1)
def kind_of_sandbox() -> str:
    """Return the strongest kind of sandbox that this machine allows: BUBBLEWRAP, NAMESPACE or NONE."""
    if works("bwrap", *_BUBBLEWRAP, *_system(), "true"):
        return BUBBLEWRAP
    if works("unshare", *_NAMESPACE, "true"):
        return NAMESPACE
    return NONE


@lru_cache(maxsize=1)
def _bubblewrap() -> List[str]:
    """Return bubblewrap's options for every sandbox, as far as this machine's version knows them."""
    options = [*_BUBBLEWRAP, *_NO_NESTED_NAMESPACES]
    return options if works("bwrap", *options, *_system(), "true") else _BUBBLEWRAP


def works(program: str, *arguments: str) -> bool:
    """Run a program that only tests what this machine allows, and return whether its exit code is 0.

    Raises:
        HuskyError: the program does not end in time. A slow machine must not get a weaker sandbox.
    """
    try:
        command = [system_program(program), *arguments]
        subprocess.run(command, capture_output=True, timeout=PROBE_DEADLINE, check=True)
    except subprocess.TimeoutExpired:
        raise HuskyError(
            f"{program} has not answered within {PROBE_DEADLINE:g} s, so it is unknown which sandbox this "
            "machine allows; run the command again when the machine is less busy"
        ) from None
    except (OSError, subprocess.CalledProcessError):
        return False
    return True


@lru_cache(maxsize=None)
def system_program(name: str) -> str:
    """Return the absolute path of a system program, by the search path with which marking was started."""
    return shutil.which(name) or f"/usr/bin/{name}"


def _system() -> List[str]:
    """Return bubblewrap's arguments that show the system's folders, read-only, and hide secrets in /etc.

    /tmp and the like become empty folders in memory, which the program may write.
    """
    arguments = ["--proc", "/proc", "--dev", "/dev"]
    for path in (Path("/", name) for name in SYSTEM):
        if path.is_symlink():
            arguments += ["--symlink", os.readlink(path), str(path)]
        elif path.is_dir():
            arguments += ["--ro-bind", str(path), str(path)]
    for path in _secrets("/etc"):
        if path.is_dir():  # an empty, read-only folder covers it
            arguments += ["--tmpfs", str(path), "--remount-ro", str(path)]
        else:  # the empty file /dev/null covers it
            arguments += ["--ro-bind", os.devnull, str(path)]
    for folder in TEMPORARY:  # the program may write here, in memory
        arguments += ["--size", str(TEMPORARY_FILES), "--tmpfs", folder]
    # /dev becomes read-only last, because one of the temporary folders is mounted in it
    return [*arguments, "--remount-ro", "/dev"]


def _secrets(folder: str) -> List[Path]:
    """Return the files and folders below a folder that not every user may read, such as keys in /etc."""
    secrets, waiting = [], [folder]
    while waiting:
        # OSError means that the folder was deleted, or that this user cannot read it. Then the sandbox cannot
        # read it either, because it runs as this user.
        with contextlib.suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                try:
                    mode = entry.stat(follow_symlinks=False).st_mode
                except OSError:  # the entry was deleted after the folder was listed
                    continue
                if stat.S_ISLNK(mode):  # a link is open to everyone, but the rights of its target count
                    continue
                # rights that every user needs; a folder also needs the right to enter it
                needed = stat.S_IROTH | (stat.S_IXOTH if stat.S_ISDIR(mode) else 0)
                if mode & needed != needed:
                    secrets.append(Path(entry.path))
                elif stat.S_ISDIR(mode):
                    waiting.append(entry.path)
    return secrets


class _Purpose(IntEnum):
    """Purpose of a mount; of paths with the same number of folders, those with a smaller value come first."""

    HIDE = 0  # an empty folder covers the folder
    SHOW = 1  # the program can read the path
    WRITE = 2  # the program can write the folder


class _Mount(NamedTuple):
    """Mount of a path in the sandbox."""

    path: Path
    purpose: _Purpose
    options: List[str]  # options of bubblewrap


def _mounts(workspace: Workspace, folder: Path, env: Dict[str, str]) -> List[str]:
    """Return bubblewrap's options for all mounts: hidden folders, read-only files, and the writable folder.

    Args:
        workspace: files that the program may read, and folders that it must not see.
        folder: the only folder that the program may write.
        env: environment of the program; its search paths name further folders that the program reads.
    """
    writable = folder.resolve()
    needed = _needed_folders(workspace, env)
    hidden, shown = _hidden_and_shown(workspace, writable, needed, _homes_to_hide(env))
    mounts = [_Mount(path, _Purpose.HIDE, ["--tmpfs", str(path)]) for path in hidden]
    mounts += [_Mount(path, _Purpose.SHOW, ["--ro-bind", str(path), str(path)]) for path in shown]
    visible = {*shown, *(Path("/", name) for name in SYSTEM)}  # the system's folders are always shown
    # a search path may lead through a symbolic link, so the link must exist in the sandbox, too
    for link in _missing_links(needed, visible, hidden):
        mounts.append(_Mount(link, _Purpose.SHOW, ["--symlink", os.readlink(link), str(link)]))
    mounts.append(_Mount(writable, _Purpose.WRITE, ["--bind", str(writable), str(writable)]))
    # Mounts of outer folders are made first, because inner paths are mounted into them. If a path is both
    # hidden and shown, it is hidden first, so it is shown in the end.
    mounts.sort(key=lambda mount: (len(mount.path.parts), mount.purpose))
    options = chain.from_iterable(mount.options for mount in mounts)
    # / and the hidden folders are empty at first, so bubblewrap creates the folders in which it mounts the
    # other paths. The program must not write into these new folders.
    read_only = [option for path in (Path("/"), *hidden) for option in ("--remount-ro", str(path))]
    return [*_system(), *options, *read_only]


def _hidden_and_shown(
    workspace: Workspace, writable: Path, needed: Sequence[Path], homes: Set[Path]
) -> Tuple[Set[Path], Set[Path]]:
    """Return the folders that the sandbox hides, and the files and folders that it shows read-only.

    A hidden folder is empty in the sandbox, except for the shown paths inside of it. In the same way, a
    hidden folder inside of a shown folder is empty.

    Args:
        workspace: its `hidden` and `own` say what the program must not see.
        writable: folder that the program may write.
        needed: folders that the program reads.
        homes: home folders, which are hidden.
    """
    our_files = own_files(workspace.own)
    to_hide = {*homes, *(path.resolve() for path in workspace.hidden), *our_files.hidden}
    # a folder is not hidden if it is the writable folder or inside of it
    hidden = {path for path in to_hide if path.is_dir() and writable not in (path, *path.parents)}
    # A needed folder that is hidden itself stays hidden. Folders such as /home are never shown as a whole,
    # even if a search path names them.
    shown = {path.resolve() for path in needed} - hidden - {*map(Path, NEVER_WHOLE)}
    # the files of the grader's package that the program may see are shown, although their folder is hidden
    shown |= our_files.shown
    # home folders stay hidden, so a folder that contains a home folder is not shown either
    shown = {path for path in shown if not any(path in home.parents for home in homes)}
    return hidden, shown


def _homes_to_hide(env: Dict[str, str]) -> Set[Path]:
    """Return the home folders of this user and of a program with the environment `env`, as real paths."""
    homes = {Path(os.path.expanduser("~")), Path(env.get("HOME", "/root"))}
    # the sandbox has root and temporary folders of its own, so they need not be hidden
    return {path.resolve() for path in homes} - {Path("/"), *map(Path, TEMPORARY)}


def _missing_links(paths: Sequence[Path], shown: Set[Path], hidden: Set[Path]) -> List[Path]:
    """Return the symbolic links on the way to some paths that the sandbox does not show yet.

    The sandbox shows the target of such a link. But the link itself is in a folder that is hidden, or that is
    not mounted at all. So a program could not follow its search path through the link.

    Args:
        paths: paths that a program reads.
        shown: folders and files that the sandbox shows.
        hidden: folders that the sandbox hides.
    """
    links = {each for path in paths for each in (path, *path.parents) if each.is_symlink()}
    missing = []
    for link in links:
        # the innermost mount at or above a link decides whether the sandbox shows the link
        mounts = [each for each in (link, *link.parents) if each in shown or each in hidden]
        if not mounts or mounts[0] not in shown:
            missing.append(link)
    return missing


def _needed_folders(workspace: Workspace, env: Dict[str, str]) -> List[Path]:
    """Return the folders that the sandbox must show to a program, because it reads files in them.

    These are the folders of Python, of the program's search paths in `env`, and of its workspace.
    """
    folders = {Path(sys.prefix), Path(sys.base_prefix), Path(sysconfig.get_paths()["purelib"])}
    for name in SEARCH_PATHS:
        folders |= {Path(word) for word in env.get(name, "").split(os.pathsep) if word.startswith("/")}
    for prefix in env.get("CMAKE_PREFIX_PATH", "").split(os.pathsep):
        # files in WORKSPACE/devel refer to launch files and scripts in WORKSPACE/src; without this folder,
        # the whole WORKSPACE is shown
        if prefix.startswith("/"):
            sources = Path(prefix).parent / "src"
            folders.add(sources if os.path.isdir(sources) else Path(prefix).parent)
    # a setup file is WORKSPACE/devel/setup.bash, and refers to the whole workspace
    folders |= {setup.resolve().parents[1] for setup in workspace.setups} | set(workspace.packages)
    # `os.path.exists`, because `Path.exists` raises an error for a folder that this user may not enter
    return sorted(path for path in folders if os.path.exists(path))
