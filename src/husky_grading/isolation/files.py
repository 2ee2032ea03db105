"""Reads files that untrusted programs wrote: regular files of bounded size only, without ever waiting.

In: paths. Out: bytes, or an error that names the file.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import stat
import subprocess
import threading
from pathlib import Path
from typing import Any, BinaryIO, Collection, Iterator, Optional, Tuple

import defusedxml.ElementTree
import yaml

from husky_highlevel_controller.datatypes import HuskyError

MAX_SIZE = 20_000_000  # [bytes] larger files are not read
# [bytes] larger YAML files are not read, because parsing takes a thousand times as much memory
MAX_YAML = 500_000
MAX_ENTRIES = 50_000  # folders with more files and folders than this are not read
SKIPPED = frozenset({".git"})  # names of folders that are not searched, unless the caller names others


class UnreadableFileError(HuskyError):
    """A file that is missing, too large, or a device, FIFO or socket."""


def read_regular(path: Path, max_size: int = MAX_SIZE) -> bytes:
    """Return the content of a regular file; a link, FIFO or device is rejected without a wait.

    Raises:
        UnreadableFileError: the file cannot be read, is not regular, or has more than `max_size` bytes.
    """
    try:
        # without O_NONBLOCK, opening a FIFO would wait; with O_NOFOLLOW, a link is an error
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC | os.O_NOFOLLOW)
        with open(descriptor, "rb") as file:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise UnreadableFileError(f"{path}: not a regular file")
            content = file.read(max_size + 1)  # one byte more shows that the file is too large
    except (OSError, ValueError) as error:  # a name with a NUL character raises ValueError
        raise UnreadableFileError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    if len(content) > max_size:
        raise UnreadableFileError(f"{path}: larger than {max_size} bytes")
    return content


def is_regular(path: Path) -> bool:
    """Return whether a path leads to a regular file, also through links; False for an impossible name."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def read_text(path: Path, max_size: int = MAX_SIZE) -> str:
    """Return the content of a regular file as UTF-8; other bytes become U+FFFD.

    Raises:
        UnreadableFileError: the file cannot be read, is not regular, or has more than `max_size` bytes.
    """
    return read_regular(path, max_size).decode(errors="replace")


def file_suffix(path: Path) -> str:
    """Return the suffix of a file; .launch.xml counts as .launch, because both are names of launch files."""
    return ".launch" if path.name.endswith(".launch.xml") else path.suffix


def texts_in(
    folder: Path, suffixes: Collection[str], max_size: int = MAX_SIZE, skipped: frozenset = SKIPPED
) -> Iterator[Tuple[Path, str]]:
    """Yield the files below a folder that have one of these suffixes and can be read, and their texts.

    Folders with a name in `skipped` are left out.

    Raises:
        UnreadableFileError: the folder has more than MAX_ENTRIES files and folders.
    """
    for path in walk(folder, skipped):
        if file_suffix(path) in suffixes:
            with contextlib.suppress(UnreadableFileError):
                yield path, read_text(path, max_size)


def read_xml(path: Path, max_size: int) -> Any:
    """Return the root element of an XML file.

    The parser of defusedxml rejects entities, because a few of them can expand to billions of characters.

    Raises:
        UnreadableFileError: the file is not a regular file of at most `max_size` bytes, is not XML, or has
            entities.
    """
    content = read_regular(path, max_size)
    try:
        return defusedxml.ElementTree.fromstring(content)
    except Exception as error:  # a parser may raise any error, such as LookupError for an unknown encoding
        raise UnreadableFileError(f"{path}: not XML that can be read: {error}") from error


class _PlainLoader(yaml.SafeLoader):
    """Loader that rejects YAML aliases, because a few can expand to billions of values, or form a loop."""

    def compose_node(self, parent: Optional[yaml.Node], index: Any) -> Optional[yaml.Node]:
        """Reject an alias; YAML calls this for each value."""
        if self.check_event(yaml.AliasEvent):
            problem = "YAML aliases are not allowed; write the value out"
            raise yaml.composer.ComposerError(None, None, problem, self.peek_event().start_mark)
        return super().compose_node(parent, index)


def read_yaml(path: Path) -> Any:
    """Return the content of a YAML file of plain values, at most MAX_YAML bytes and without aliases.

    Raises:
        UnreadableFileError: the file is not a regular file of at most MAX_YAML bytes, or is not YAML of plain
            values.
    """
    text = read_text(path, MAX_YAML)
    try:
        return yaml.load(text, _PlainLoader)
    except Exception as error:  # YAML may raise any error, such as KeyError for `!!bool x`
        raise UnreadableFileError(f"{path}: {' '.join(str(error).split())}") from error


def create(path: Path) -> BinaryIO:
    """Open a new file for writing; a file or link with its name is removed first, so no link is followed.

    Raises:
        OSError: the file cannot be made.
    """
    path.unlink(missing_ok=True)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    return open(os.open(path, flags, 0o644), "wb", buffering=0)


def copy(source: Path, target: Path) -> None:
    """Copy a regular file of bounded size; a file or link with the target's name is replaced, not followed.

    Raises:
        UnreadableFileError: the source cannot be read, is not regular, or is too large.
        OSError: the copy cannot be written.
    """
    content = read_regular(source)
    with create(target) as file:
        file.write(content)


def is_below(path: Path, root: Path) -> bool:
    """Return whether a path, after all its links are followed, is inside of a folder.

    A submission may contain links that lead to other files of this machine.
    """
    return root.resolve() in path.resolve().parents


def write_whole(path: Path, content: str) -> None:
    """Write a text file completely or not at all, so a full disk or a crash leaves no partial file.

    Raises:
        OSError: the file cannot be written; an earlier file with its name stays.
    """
    # the name has the ids of process and thread, because several of them may write the same file at the same
    # time
    partial = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}.partial")
    try:
        with partial.open("w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def walk(folder: Path, skipped: frozenset = SKIPPED) -> Iterator[Path]:
    """Yield the regular files below a folder in order, without those in folders with a name in `skipped`.

    Links are not followed. Folders that cannot be read are left out.

    Raises:
        UnreadableFileError: the folder has more than MAX_ENTRIES files and folders.
    """
    count = 0
    waiting = [str(folder)]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                # A folder may have so many entries that they would fill the memory. So at most one entry more
                # than allowed is read.
                inner = sorted(itertools.islice(entries, MAX_ENTRIES + 1), key=lambda entry: entry.name)
        except OSError:  # the folder was deleted, cannot be read, or has a path that is too long
            continue
        count += len(inner)
        if count > MAX_ENTRIES:
            raise UnreadableFileError(f"{folder}: more than {MAX_ENTRIES} files and folders")
        folders = []
        for entry in inner:
            if entry.is_file(follow_symlinks=False):
                yield Path(entry.path)
            elif entry.is_dir(follow_symlinks=False) and entry.name not in skipped:
                folders.append(entry.path)
        # `pop` takes the last folder, so the folders are reversed to read the first one first
        waiting += reversed(folders)


def remove_tree(folder: Path) -> None:
    """Remove a folder of any depth, or a file, if it exists; links are not followed."""
    subprocess.run(["rm", "-rf", "--", str(folder)], check=False, capture_output=True)
